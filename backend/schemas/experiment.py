"""Schemas of experiments, of experiments as texts, and of studies."""

from datetime import datetime
from typing import Annotated, Any, Literal

from pydantic import Field

from backend.execution import RunPhase
from backend.experiments import MAX_CHARACTERS, PlayedPart
from backend.models import MeasuredFigure, Outcome, Setting, Value
from backend.schemas.base import Finite, Schema, quantity
from backend.schemas.run import SamplesView
from backend.storage import StudyPoint
from backend.studies import Map, Share, Spreading

# Experiment ----------------------------------------------------------------------------------------
#
# Experiments: which there are, their settings, and how they went.


SettingName = Annotated[str, Field(max_length=40)]
SettingValue = bool | Finite | Annotated[str, Field(max_length=100_000)]


class ExperimentKind(Schema):
    """A kind of experiment that can be started."""

    name: str
    title: str
    description: str
    run_kind: str = Field(description="kind of its runs")
    duration_s: float = quantity("s", "length with the settings at their defaults")
    settings: list[Setting]
    why_not: str = Field(description="why what is driven cannot play it, only a dry run; empty where it can")


class ExperimentKindList(Schema):
    """The kinds of experiments there are."""

    experiments: list[ExperimentKind]


class ExperimentRequest(Schema):
    """Which experiment to start, with settings that differ from the defaults."""

    name: str = Field(
        min_length=1,
        max_length=60,
        description="of one that is offered, or of a version, name@2; deprecated is sequence, of which the setting "
        "segments is a list of segments as JSON: keep an experiment in its place",
    )
    settings: dict[SettingName, SettingValue] = Field(default_factory=dict, max_length=50)


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
    metrics: list[MeasuredFigure]
    criteria: list[Criterion]
    samples: SamplesView | None


class DryRunProgress(Schema):
    """How far the dry run of a person is."""

    under_way: bool
    doing: RunPhase = Field(description="what is being done for it; starting while it waits for its turn")
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
    metrics: list[MeasuredFigure]
    criteria: list[Criterion]
    message: str


# Own experiment ------------------------------------------------------------------------------------
#
# Experiments as texts: written, looked over, kept in versions.


class ExperimentText(Schema):
    """An experiment as YAML or JSON; what is taken says ``GET /api/experiments/schema``."""

    text: str = Field(min_length=1, max_length=MAX_CHARACTERS)


class ExperimentCheckRequest(ExperimentText):
    """An experiment that is looked over."""

    play: bool = Field(default=True, description="play it on the simulator too, which takes its time")


class WrittenExperiment(ExperimentText):
    """An experiment as it was written, and what its text says as plain data."""

    document: dict[str, Any]


class RecordedExperiment(WrittenExperiment):
    """A run as an experiment."""

    left_out: list[str] = Field(description="what happened in the run that the experiment does not repeat")


class CheckedExperiment(Schema):
    """What can be told of an experiment before it is kept or started, its settings at their defaults."""

    name: str
    title: str
    duration_s: float = quantity("s", "length of its program")
    segments: int = Field(description="pieces that the loop plays")
    changes_of_tuning: int
    phases: list[str] = Field(description="titles of its stretches")
    criteria: int = Field(description="bounds that its runs are judged by")
    peak_voltage_V: float | None = quantity("V", "largest voltage on the simulator")
    min_tension_N: float | None = quantity("N", "least tension on the simulator")
    max_tension_N: float | None = quantity("N", "largest tension on the simulator")
    not_predicted: str = Field(description="why there are no peaks, where there are none")
    busy: bool = Field(description="there was no place to play it dry: ask again")
    document: dict[str, Any] = Field(description="what its text says as plain data")
    parts: list[PlayedPart] = Field(description="in the order in which they first play")
    dry_run: DryRunView | None = Field(description="how it went on the simulator, None where it was not played")


class OwnExperiment(Schema):
    """A version of an own experiment."""

    name: str
    version: int
    title: str = Field(description="empty where this version of Sinew does not take it any more")
    who: str
    created: datetime


class OwnExperimentList(Schema):
    """Own experiments by name, or the versions of one, the newest first."""

    experiments: list[OwnExperiment]


# Study ---------------------------------------------------------------------------------------------
#
# Studies as the page and the command line show them.


MapPick = Annotated[
    Literal["worst", "mean", "least", "largest", "deviation", "p5", "median", "p95"],
    Field(description="what a cell of a map shows of several runs; p5 and p95 are percentiles"),
]


class StudyText(Schema):
    """A study as YAML or JSON, see docs/how-to/studies.md."""

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


class StudyAxis(Schema):
    """What was gone through, and its values in SI."""

    name: str
    symbol: str
    unit: str
    values: list[Value]


class StudyDetail(Schema):
    """A study with its figures, maps and the first rows of its table."""

    study: StudyView
    text: str
    axes: list[StudyAxis]
    shares: list[Share]
    figures: list[Spreading]
    maps: list[Map]
    rows: list[StudyPoint]
