"""Schemas of experiments, the queue, stored experiments and studies."""

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

# Experiments ---------------------------------------------------------------------------------------


SettingName = Annotated[str, Field(max_length=40)]
SettingValue = bool | Finite | Annotated[str, Field(max_length=100_000)]


class ExperimentKind(Schema):
    """An experiment that can be started."""

    name: str
    title: str
    description: str
    run_kind: str = Field(description="kind of its runs")
    duration_s: float = quantity("s", "duration with default settings")
    settings: list[Setting]
    why_not: str = Field(description="why the present plant cannot run it, except as a preview; else empty")


class ExperimentKindList(Schema):
    """All experiments."""

    experiments: list[ExperimentKind]


class ExperimentRequest(Schema):
    """Experiment to start, with settings that differ from the defaults."""

    name: str = Field(
        min_length=1,
        max_length=60,
        description="name of a built-in or stored experiment, or name@2 for a version of a stored one; the name "
        "`sequence`, with a JSON list of segments as the setting `segments`, is deprecated",
    )
    settings: dict[SettingName, SettingValue] = Field(default_factory=dict, max_length=50)


class Criterion(Schema):
    """A metric with a bound, and whether it passed."""

    name: str
    label: str
    value: float | None
    bound: float
    relation: str = Field(description="'<' or '>'")
    unit: str
    passed: bool | None = Field(description="null if it was not measured, or too little of it for a verdict")
    reason: str = Field(description="why it was not measured, or only in part; else empty")


class QueuedView(Schema):
    """An experiment in the queue."""

    id: int
    name: str
    settings: dict[str, SettingValue]
    who: str
    kept: bool = Field(default=False, description="whether it was queued before this service started")


class QueueView(Schema):
    """The queue, in order."""

    items: list[QueuedView]
    running: bool = Field(description="whether the next experiment starts automatically")
    run: int | None = Field(description="current run of the queue")
    problem: str = Field(description="why the queue is paused; else empty")


class QueuePlace(Schema):
    """New position of an experiment in the queue."""

    place: int = Field(ge=0, le=1000, description="position in the queue; 0 is the next experiment to start")


class DryRunView(Schema):
    """Preview of an experiment, simulated without storing anything."""

    status: str
    message: str
    duration_s: float = quantity("s", "duration of the experiment")
    settings: dict[str, SettingValue] = Field(description="all settings, with those of the control loop")
    outcome: Outcome
    verdict: str = Field(description="verdict in one sentence")
    metrics: list[MeasuredFigure]
    criteria: list[Criterion]
    samples: SamplesView | None


class DryRunProgress(Schema):
    """Progress of a user's dry run."""

    under_way: bool
    doing: RunPhase = Field(description="current phase; starting while the dry run waits")
    played_s: float = quantity("s", "simulated time of the experiment")
    duration_s: float = quantity("s", "duration of the experiment")


class ExperimentView(Schema):
    """A run of an experiment and, after its end, its result."""

    id: int
    name: str
    title: str = Field(description="title of the experiment")
    status: str
    created: datetime
    progress: float = Field(ge=0.0, le=1.0)
    settings: dict[str, SettingValue | None]
    outcome: Outcome
    verdict: str = Field(description="verdict in one sentence")
    metrics: list[MeasuredFigure]
    criteria: list[Criterion]
    message: str


# Stored experiments --------------------------------------------------------------------------------


class ExperimentText(Schema):
    """An experiment as YAML or JSON text.

    ``GET /api/experiments/schema`` returns its schema.
    """

    text: str = Field(min_length=1, max_length=MAX_CHARACTERS)


class ExperimentCheckRequest(ExperimentText):
    """An experiment to check."""

    play: bool = Field(default=True, description="whether to simulate it as well, which takes some time")


class WrittenExperiment(ExperimentText):
    """The text of an experiment, and the same as parsed data."""

    document: dict[str, Any]


class RecordedExperiment(WrittenExperiment):
    """An experiment that repeats a recorded run."""

    left_out: list[str] = Field(description="events of the run that the experiment does not repeat")


class CheckedExperiment(Schema):
    """Result of the check of an experiment with default settings."""

    name: str
    title: str
    duration_s: float = quantity("s", "duration of its program")
    segments: int = Field(description="number of segments of its program")
    changes_of_tuning: int
    phases: list[str] = Field(description="titles of its phases")
    criteria: int = Field(description="number of its criteria")
    peak_voltage_V: float | None = quantity("V", "largest voltage on the simulator")
    min_tension_N: float | None = quantity("N", "smallest tension on the simulator")
    max_tension_N: float | None = quantity("N", "largest tension on the simulator")
    not_predicted: str = Field(description="why peaks are missing; else empty")
    busy: bool = Field(description="whether other simulations prevented this one; repeat the request")
    document: dict[str, Any] = Field(description="its text as parsed data")
    parts: list[PlayedPart] = Field(description="parts in the order of their first execution")
    dry_run: DryRunView | None = Field(description="simulation; null if it was not simulated")


class OwnExperiment(Schema):
    """A version of a stored experiment."""

    name: str
    version: int
    title: str = Field(description="empty if this version of Sinew no longer accepts its text")
    who: str
    created: datetime


class OwnExperimentList(Schema):
    """Stored experiments by name, or the versions of one, newest first."""

    experiments: list[OwnExperiment]


# Studies -------------------------------------------------------------------------------------------


MapPick = Annotated[
    Literal["worst", "mean", "least", "largest", "deviation", "p5", "median", "p95"],
    Field(description="statistic of several runs that a cell of a map shows; p5 and p95 are percentiles"),
]


class StudyText(Schema):
    """A study as YAML or JSON, see docs/how-to/studies.md."""

    text: str = Field(min_length=1, max_length=MAX_CHARACTERS)


class CheckedStudy(Schema):
    """Result of the check of a study."""

    document: dict[str, Any] | None = Field(description="its text as parsed data; null if it cannot be parsed")
    points: int | None = Field(description="number of its runs; null if it is rejected")
    problem: str = Field(description="why it is rejected, with the line; else empty")
    path: list[int | str] = Field(description="path of the rejected value in the document")


class PlantNumber(Schema):
    """A parameter of the plant that a study can vary."""

    name: str = Field(description='section and entry, such as "motor.c0"')
    value: float
    unit: str


class PlantNumbers(Schema):
    """All parameters of the plant that a study can vary, by section."""

    numbers: list[PlantNumber]


class StudyView(Schema):
    """A study and its progress. ``state`` is running, stopping, stopped or done."""

    id: int
    name: str
    title: str
    who: str
    created: datetime
    state: str
    points: int = Field(description="number of its runs")
    done: int = Field(description="number of computed runs")
    ends: dict[str, int] = Field(description="number of computed runs by end state")
    left_s: float | None = quantity("s", "estimated remaining time")
    problem: str = Field(description="error that ended the last computation; else empty")


class StudyList(Schema):
    """Studies, newest first."""

    studies: list[StudyView]


class StudyAxis(Schema):
    """A varied quantity with its values in SI."""

    name: str
    symbol: str
    unit: str
    values: list[Value]


class StudyDetail(Schema):
    """A study with its metrics, maps and the first rows of its table."""

    study: StudyView
    text: str
    axes: list[StudyAxis]
    shares: list[Share]
    figures: list[Spreading]
    maps: list[Map]
    rows: list[StudyPoint]
