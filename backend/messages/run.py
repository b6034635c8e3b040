"""Stored runs and their samples."""

from datetime import datetime
from enum import StrEnum

from pydantic import Field

from backend.messages.base import Schema, quantity
from backend.models.run import Outcome


class Evaluation(StrEnum):
    """Whether a run has its result."""

    NONE = "none"
    """of a session, and of a run that is not over"""
    UNDER_WAY = "under_way"
    DONE = "done"
    MISSING = "missing"
    """it could not be computed; asked for again, it may be"""


class UsedSetting(Schema):
    """What a run was set to in one respect."""

    name: str
    symbol: str
    unit: str = Field(description="SI, 1 for what has none")
    meaning: str
    value: bool | float | str


class Headline(Schema):
    """The figure of a result that a list of runs shows beside the verdict."""

    name: str
    label: str
    value: float
    unit: str = Field(description="SI, 1 for what has none")
    relation: str = Field(description="of the criterion it was judged by, < or >; empty without a criterion")
    bound: float | None = Field(description="bound of that criterion, null without one")


class RunView(Schema):
    """One stored run."""

    id: int
    kind: str
    title: str = Field(description="what was run, in words")
    plant: str
    parameters: str
    who: str
    started: datetime
    ended: datetime | None
    end_state: str
    end_reason: str
    duration_s: float = quantity("s", "length of what was recorded")
    samples: int
    missing_samples: int | None = Field(
        description="ticks that the recording lacks; more than 0 is an error of the run; null where the service died "
        "while it recorded, so that how many were still to be stored is not known"
    )
    samples_deleted: datetime | None = Field(description="when a person had the samples deleted to make room")
    settings: list[UsedSetting]
    note: str
    tags: list[str]
    station: str = Field(description="the rig whose service made it; empty where a database has one only")
    origin: str = Field(description="where it was imported from; empty where it was made here")
    evaluation: Evaluation
    evaluation_problem: str = Field(description="why the run has no result, where that is known")
    outcome: Outcome | None = Field(description="how it counts; null for a session and for a run that is not over")
    headline: Headline | None = Field(
        description="the first criterion that failed, else the first measured criterion, else the lower fit of an "
        "identified actuator, else the first measured figure"
    )


class RunList(Schema):
    """Runs, newest first, one page of them."""

    runs: list[RunView]
    total: int


class NoteRequest(Schema):
    """What a person wants to remember about a run."""

    note: str = Field(max_length=4000)


class Envelope(Schema):
    """One signal over the times of the answer. Raw: minimum and maximum are the same values."""

    unit: str
    minimum: list[float | None]
    maximum: list[float | None]


class SamplesView(Schema):
    """Samples of a run between two times, raw when few enough, else the min/max envelope."""

    run: int
    raw: bool
    width_s: float = quantity("s", "length of a bucket; of raw samples, their period")
    t: list[float] = quantity("s", "time since the run's first sample")
    signals: dict[str, Envelope]
