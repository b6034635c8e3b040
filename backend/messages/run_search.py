"""Finding runs: searches, tags, metrics over dates."""

from datetime import datetime

from pydantic import Field

from backend.messages.base import Schema
from backend.storage.orm import TAG_MAX
from backend.storage.search import LONGEST

SEARCH_NAME_MAX = 60


class SearchWords(Schema):
    """What runs can be searched by at present."""

    station: str = Field(description="the station of this service")
    stations: list[str] = Field(description="all that have made runs")
    fields: list[str] = Field(description="what every run has")
    kinds: list[str]
    ends: list[str]
    verdicts: list[str]
    tags: list[str]
    values: dict[str, list[str]] = Field(description="names by what they are of: parameter, setting, metric")


class SearchText(Schema):
    """A search, as it is typed."""

    where: str = Field(max_length=LONGEST)


class SavedSearch(SearchText):
    """A search under a name."""

    name: str
    who: str


class SavedSearchList(Schema):
    """All of them, by name."""

    searches: list[SavedSearch]


class TagRequest(Schema):
    """A tag."""

    tag: str = Field(max_length=10 * TAG_MAX)


class TagList(Schema):
    """The tags in use."""

    tags: list[str]


class MetricName(Schema):
    """A metric that runs of a kind have."""

    name: str
    label: str
    unit: str


class MetricPoint(Schema):
    """A metric of one run."""

    run: int
    at: datetime
    value: float


class MetricHistory(Schema):
    """A metric of one kind of runs over their dates, oldest first."""

    kind: str
    metric: MetricName | None = Field(description="null where no run of the kind was evaluated")
    metrics: list[MetricName] = Field(description="those that can be asked for, as the newest evaluated run has them")
    points: list[MetricPoint]
    without: int = Field(description="runs that fit but have no value of it")
    left_out: int = Field(description="older points that are not told, as there are too many")
