"""Experiments: which there are, their settings, and how they went."""

from datetime import datetime
from typing import Annotated

from pydantic import Field

from backend.execution.runner import Doing
from backend.messages.base import Finite, Schema, quantity
from backend.messages.run import SamplesView
from backend.models.run import Outcome

SettingName = Annotated[str, Field(max_length=40)]
SettingValue = bool | Finite | Annotated[str, Field(max_length=100_000)]


class SettingView(Schema):
    """One setting of an experiment."""

    name: str
    symbol: str
    meaning: str
    unit: str
    default: SettingValue | None
    minimum: float | None = None
    maximum: float | None = None
    choices: list[str] | None = None


class ExperimentKind(Schema):
    """A kind of experiment that can be started."""

    name: str
    title: str
    description: str
    run_kind: str = Field(description="kind of its runs")
    duration_s: float = quantity("s", "length with the settings at their defaults")
    settings: list[SettingView]
    why_not: str = Field(description="why what is driven cannot play it, only a dry run; empty where it can")


class ExperimentKindList(Schema):
    """The kinds of experiments there are."""

    experiments: list[ExperimentKind]


class ExperimentRequest(Schema):
    """Which experiment to start, with settings that differ from the defaults."""

    name: str = Field(min_length=1, max_length=60)
    settings: dict[SettingName, SettingValue] = Field(default_factory=dict, max_length=50)


class Metric(Schema):
    """One number of the result."""

    name: str
    label: str
    value: float | None
    unit: str


class MeasuredMetric(Metric):
    """One number of a result that was measured, or that could not be."""

    definition: str
    reason: str = Field(description="why it was not measured; with a value: why not on all steps, so at least that")


class Criterion(Schema):
    """A bound that a metric had to keep."""

    name: str
    label: str
    value: float | None
    bound: float
    relation: str = Field(description="'<' or '>'")
    unit: str
    passed: bool | None = Field(description="null when it was not measured")
    reason: str = Field(description="why it was not measured")


class QueuedView(Schema):
    """An experiment that waits for its turn."""

    id: int
    name: str
    settings: dict[str, SettingValue]
    who: str
    kept: bool = Field(default=False, description="it waited already when the service was started")


class QueueView(Schema):
    """What waits, in order."""

    items: list[QueuedView]
    running: bool = Field(description="the next one starts by itself")
    run: int | None = Field(description="run that the queue has started and that is under way")
    problem: str = Field(description="why the queue was held")


class QueuePlace(Schema):
    """Where in the queue an experiment is to wait."""

    place: int = Field(ge=0, le=1000, description="from 0, the next one to be started")


class DryRunView(Schema):
    """What an experiment would give, played on a simulator of its own; nothing is stored."""

    status: str
    message: str
    duration_s: float = quantity("s", "length of the experiment")
    settings: dict[str, SettingValue] = Field(description="all it was played with, those of the loop included")
    outcome: Outcome
    verdict: str = Field(description="what it came to, in a sentence")
    metrics: list[MeasuredMetric]
    criteria: list[Criterion]
    samples: SamplesView | None


class DryRunProgress(Schema):
    """How far the dry run of a person is."""

    under_way: bool
    doing: Doing = Field(description="what is being done for it; starting while it waits for its turn")
    played_s: float = quantity("s", "how much of the experiment is played")
    duration_s: float = quantity("s", "length of the experiment")


class ExperimentView(Schema):
    """One experiment run and, once it has ended, its result."""

    id: int
    name: str
    title: str = Field(description="what was run, in words")
    status: str
    created: datetime
    progress: float = Field(ge=0.0, le=1.0)
    settings: dict[str, SettingValue | None]
    outcome: Outcome
    verdict: str = Field(description="what it came to, in a sentence")
    metrics: list[MeasuredMetric]
    criteria: list[Criterion]
    message: str
