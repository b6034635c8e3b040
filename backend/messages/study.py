"""Studies as the page and the command line show them."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Field

from backend.experiments.parser import MAX_CHARACTERS
from backend.messages.base import Schema, quantity
from backend.models.run import Value

MapPick = Annotated[
    Literal["worst", "mean", "least", "largest", "deviation", "p5", "median", "p95"],
    Field(description="what a cell of a map shows of several runs; p5 and p95 are percentiles"),
]


class StudyText(Schema):
    """A study as YAML or JSON, see docs/studies.md."""

    text: str = Field(min_length=1, max_length=MAX_CHARACTERS)


class CheckedStudy(Schema):
    """What a text says, and whether it is a study that could be begun now."""

    document: dict[str, Any] | None = Field(description="what the text says as plain data, null where it says none")
    points: int | None = Field(description="runs that it has, null where it is refused")
    problem: str = Field(description="why it is refused, with its line; empty where it is not")
    path: list[int | str] = Field(description="where in the document it is refused")


class PlantNumber(Schema):
    """A number of the plant that a study can vary."""

    name: str = Field(description='by section and entry, such as "motor.c0"')
    value: float
    unit: str


class PlantNumbers(Schema):
    """All of them, by section."""

    numbers: list[PlantNumber]


class StudyView(Schema):
    """A study, and how far it is. ``state`` is running, stopping, stopped or done."""

    id: int
    name: str
    title: str
    who: str
    created: datetime
    state: str
    points: int = Field(description="runs that it has")
    done: int = Field(description="runs that are computed")
    ends: dict[str, int] = Field(description="how many of these ended how")
    left_s: float | None = quantity("s", "time left, as fast as it went so far")
    problem: str = Field(description="what the last attempt to compute it ended of, where that went wrong")


class StudyList(Schema):
    """Studies, newest first."""

    studies: list[StudyView]


class StudyFigure(Schema):
    """How a figure is spread over the runs that gave it, in SI; null where ``unstable`` ones leave no number.

    ``deviation`` is the standard deviation (n - 1), null for a single run too; ``p5`` and ``p95`` are percentiles.
    """

    name: str
    label: str
    unit: str
    count: int
    missing: int = Field(description="how many computed runs gave no number")
    unstable: int = Field(description="how many of those that gave one are of an unstable loop")
    least: float | None
    p5: float | None
    median: float | None
    mean: float | None
    p95: float | None
    largest: float | None
    deviation: float | None


class StudyShare(Schema):
    """A share of runs with its 95 % confidence interval (Wilson score), null where there is no run to count."""

    name: str
    label: str
    count: int = Field(description="runs that did not complete, or whose criteria do not all hold")
    of: int = Field(description="runs of which that is known")
    left_out: int = Field(description="computed runs of which it is not known: they were not judged")
    percent: float | None = quantity("%", "share")
    low: float | None = quantity("%", "lower end of the interval")
    high: float | None = quantity("%", "upper end of the interval")


class StudyPoint(Schema):
    """A row of the table: what was varied, how the run ended, what it gave. Numbers are in SI."""

    number: int
    values: dict[str, Value]
    state: str
    detail: str
    passed: bool | None
    figures: dict[str, float | Literal["unstable"] | None]


class StudyAxis(Schema):
    """What was gone through, and its values in SI."""

    name: str
    symbol: str
    unit: str
    values: list[Value]


class StudyMap(Schema):
    """A figure over two axes; ``cells`` by place of y, then of x, null where no run gave a number."""

    figure: str
    pick: str = Field(
        description="what a cell shows of several runs; where the worst was asked for, least, largest or mean, which "
        "is the worst; of a share always share"
    )
    x: str
    y: str
    cells: list[list[float | None]]
    unstable: list[list[bool]] = Field(description="by the same places, where null stands for an unstable loop")
    counts: list[list[int]] = Field(description="by the same places, how many runs gave a number")
    runs: list[list[int]] = Field(description="by the same places, how many runs are computed")
    intervals: list[list[list[float] | None]] = Field(
        description="by the same places, both ends of the 95 % confidence interval of a share [%]; null elsewhere"
    )


class StudyDetail(Schema):
    """A study with its figures, maps and the first rows of its table."""

    study: StudyView
    text: str
    axes: list[StudyAxis]
    shares: list[StudyShare]
    figures: list[StudyFigure]
    maps: list[StudyMap]
    rows: list[StudyPoint]
