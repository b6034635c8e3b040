"""Schemas of stored runs: samples, search, flight records, log, figures, history."""

from datetime import datetime
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import AwareDatetime, Field

from backend.models import DeclaredValue, Outcome, RunHeadline
from backend.schemas.base import ANY_SIZE, HUGE, Schema, quantity
from backend.storage import LONGEST, TAG_MAX, LogEntry

# Flight --------------------------------------------------------------------------------------------
#
# Flight records: the seconds around each trip and each trigger.


class FlightView(Schema):
    """One trip or trigger, and the extent of what was kept around it."""

    id: int
    at: datetime
    kind: Literal["trip", "trigger"]
    who: str = Field(description="who pressed STOP or armed the trigger; empty where nobody did")
    fault: str = Field(description="what tripped; of a trigger the word trigger")
    text: str
    run: int | None
    tick: int = Field(description="tick of the trip or trigger, of the loop that ran then")
    before_s: float = quantity("s", "length kept before it")
    after_s: float = quantity("s", "length kept from it on")


class FlightList(Schema):
    """Flight records, newest first."""

    flights: list[FlightView]


class FlightMoment(Schema):
    """The moment of a flight record to show."""

    t: float = quantity("s", "time since the trip or trigger", ge=-1e6, le=1e6)


# History -------------------------------------------------------------------------------------------
#
# Where things came from, what happened in a run, and how far the set-up has got.


LONGEST_S = 1e9
"""Longer than any recording [s]: thirty years."""


class LineageBank(Schema):
    """A bank that a run used or that was built from it."""

    id: int
    name: str
    version: int


class LineageEntry(Schema):
    """Where an entry of the bank in use came from."""

    name: str = Field(description="what the entry is called, by its tension")
    S_nominal: float = quantity("N·m/rad", "nominal point")
    run: int | None = Field(description="identification run; null for data from elsewhere or from geometry")


class LineageKind(StrEnum):
    """What a box of the lineage is about."""

    RUN = "run"
    GAINS = "gains"
    BANK = "bank"
    IDENTIFICATION = "identification"
    DATA = "data"
    PARAMETERS = "parameters"
    CALIBRATION = "calibration"


class LineageNode(Schema):
    """A box of the lineage; ``run``, ``bank`` and ``identification`` say which page tells more of it."""

    id: str
    kind: LineageKind
    title: str
    detail: str
    sha256: str | None = Field(description="digest of its content, in hex")
    no_sha256: str = Field(description="why there is no digest")
    out_of_date: str = Field(description="what holds no more, empty where all does")
    run: int | None = Field(description="the run it is, or the run whose samples it is")
    bank: int | None
    identification: int | None = Field(description="the identification by the number of its run")
    origins: list[str] = Field(description="ids of what it came from")


class Lineage(Schema):
    """Back to raw data and forth to what came of it."""

    run: int
    software: str
    parameters: str
    parameters_as_now: bool = Field(description="the plant's parameters are still those of this run")
    bank: LineageBank | None = Field(description="bank in use; null while the gains came from geometry")
    entries: list[LineageEntry]
    banks_built: list[LineageBank] = Field(description="banks with an entry that was identified from this run")
    runs_with_them: list[int] = Field(description="newest runs that used these banks")
    nodes: list[LineageNode] = Field(description="the same as boxes, each with a digest of its content")


class RunMark(Schema):
    """Something that happened during a run."""

    t: float = quantity("s", "time since the run's first sample")
    kind: str
    text: str
    who: str


class RunMarks(Schema):
    """What happened during a run, in order."""

    marks: list[RunMark]


class PlannedPart(Schema):
    """A named part of a program."""

    title: str
    start_s: float = quantity("s", "begin, from that of the program")
    end_s: float = quantity("s", "end, from the begin of the program")


class PlannedLine(Schema):
    """What is asked for of one signal of the sample."""

    name: str = Field(description="of the sample's column")
    unit: str
    values: list[float | None] = Field(description="null where the plan leaves it open")


class PlannedSignals(Schema):
    """What a program asks for over its whole length, known before it plays.

    Of an experiment the references and pushes, where it has any; of an identification its set points and excitation:
    motor references without the force loop's trim, the voltage of steps, the tension that motor references give at
    q = 0.
    """

    t: list[float] = Field(description="times since the program began [s]")
    lines: list[PlannedLine]
    parts: list[PlannedPart]


class ReplayRequest(Schema):
    """The moment to show."""

    t: float = quantity("s", "time since the run's first sample", ge=0.0, le=LONGEST_S)


class ChecklistState(StrEnum):
    """How far a step of the set-up is."""

    MISSING = "missing"
    DONE = "done"
    OUTDATED = "outdated"
    UNUSABLE = "unusable"


class ChecklistStep(Schema):
    """One step from pretension to report."""

    name: str
    state: ChecklistState
    detail: str = Field(description="what there is, or why it no longer holds")
    run: int | None
    at: datetime | None


class Checklist(Schema):
    """The set-up in order; each step builds on those before."""

    steps: list[ChecklistStep]


# Run -----------------------------------------------------------------------------------------------
#
# Stored runs and their samples.


class EvaluationView(StrEnum):
    """Whether a run has its result."""

    NONE = "none"
    """of a session, and of a run that is not over"""
    UNDER_WAY = "under_way"
    DONE = "done"
    MISSING = "missing"
    """it could not be computed; asked for again, it may be"""


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
    settings: list[DeclaredValue]
    note: str
    tags: list[str]
    station: str = Field(description="the rig whose service made it; empty where a database has one only")
    origin: str = Field(description="where it was imported from; empty where it was made here")
    evaluation: EvaluationView
    evaluation_problem: str = Field(description="why the run has no result, where that is known")
    outcome: Outcome | None = Field(description="how it counts; null for a session and for a run that is not over")
    headline: RunHeadline | None = Field(
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


class SignalEnvelope(Schema):
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
    signals: dict[str, SignalEnvelope]


# Run search ----------------------------------------------------------------------------------------
#
# Finding runs: searches, tags, metrics over dates.


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


# Sheet ---------------------------------------------------------------------------------------------
#
# A sheet of charts, as the page has drawn it.


LONGEST_SHEET = 2 * 1024 * 1024
"""Characters, and bytes of a body with them: sixty curves of four thousand points each, as the page sends them."""


class ChartSheet(Schema):
    """A drawing to be made a PDF of its size."""

    svg: str = Field(
        min_length=1,
        max_length=LONGEST_SHEET,
        description="SVG of one sheet: lines and letters, its size in mm; nothing in it may lead elsewhere",
    )


# Timeline ------------------------------------------------------------------------------------------
#
# Everything that happened, as the log shows it.


Instant = Annotated[AwareDatetime, Field(json_schema_extra={"maxLength": 40})]
"""A time with its zone; what is longer than that is none."""


class Timeline(Schema):
    """A page of it, newest first."""

    entries: list[LogEntry]
    total: int = Field(description="how many there are of what is asked for, these included")
    more_before: datetime | None = Field(description="ask for what was before this; null where there is no more")


class EventNote(Schema):
    """What a person says of an event; with neither note nor tags it is taken off."""

    note: str = Field(default="", max_length=10_000)
    tags: list[Annotated[str, Field(max_length=10 * TAG_MAX)]] = Field(
        default=[], max_length=100, description=f"words of at most {TAG_MAX} characters"
    )


# Figures -------------------------------------------------------------------------------------------
#
# What is computed from every sample of a range of a recorded run.


class ReadRange(Schema):
    """The range that was read: its first and last tick, and how many samples it has."""

    run: int
    from_s: float = quantity("s", "first tick of the range since the run's first sample")
    to_s: float = quantity("s", "last tick of the range since the run's first sample")
    period_s: float = quantity("s", "sampling period")
    samples: int = Field(description="samples that the recording has within the range")
    missing: int = Field(description="ticks of the range that the recording lacks")


class SignalStatistics(Schema):
    """Statistics of one signal; null where no sample has a value."""

    unit: str
    values: int = Field(description="samples that have a value: the statistics are computed from all of them")
    without_value: int = Field(description="samples that have none: not measured, or not in force at that time")
    minimum: float | None
    minimum_s: float | None = quantity("s", "when the minimum is reached first, since the run's first sample")
    maximum: float | None
    maximum_s: float | None = quantity("s", "when the maximum is reached first, since the run's first sample")
    mean: float | None
    deviation: float | None = Field(description="standard deviation about the mean, divided by the number of values")


class RecordedStatistics(ReadRange):
    """Statistics of signals over every sample of a range."""

    signals: dict[str, SignalStatistics]


class SignalSpectrum(Schema):
    """Power spectral density of one signal at 1, 2, ... times ``step_Hz``; without ``reason`` there is one."""

    unit: str
    reason: str = Field(description="why there is no spectrum, empty where there is one")
    values: int = Field(description="samples of the range that have a value")
    without_value: int = Field(description="samples that have none: not measured, or not in force at that time")
    used: int = Field(description="samples that lie in a segment; those of shorter stretches between gaps do not")
    segment: int = Field(description="length of a segment in samples")
    segments: int
    step_Hz: float = quantity("Hz", "distance of the frequencies")
    noise_bandwidth_Hz: float = quantity(
        "Hz", "equivalent noise bandwidth; a sine has the amplitude sqrt(2 density bandwidth)"
    )
    density: list[float] = Field(description="one-sided [unit²/Hz]")


class RecordedSpectra(ReadRange):
    """Spectra of signals over every sample of a range, by Welch's method."""

    method: str = "Welch"
    window: str = "Hann"
    overlap: float = Field(default=0.5, description="share of a segment that the next one overlaps")
    signals: dict[str, SignalSpectrum]


class StatisticsLine(Schema):
    """One line of the answer: how much has been read; the last line has the result."""

    share: float = Field(description="share of the range that has been read, 0 to 1")
    result: RecordedStatistics | None = None


class SpectraLine(Schema):
    """One line of the answer: how much has been read; the last line has the result."""

    share: float = Field(description="share of the range that has been read, 0 to 1")
    result: RecordedSpectra | None = None


class Moment(Schema):
    """The values of signals at the sample at or before a time."""

    at_s: float = quantity("s", "time that was asked for, since the run's first sample")
    t: float = quantity("s", "time of the sample")
    values: dict[str, float | None] = Field(description="SI; null where the sample has no value")


class RecordedValues(Schema):
    """The values of signals at some times of a recorded run."""

    run: int
    period_s: float = quantity("s", "sampling period; an older sample means that later ones are missing")
    moments: list[Moment]


# Player --------------------------------------------------------------------------------------------
#
# The player of a recording that stands in place of a plant: where it is, and what it is asked for.


class PlayerView(Schema):
    """Where the player stands; ``t`` holds for ``tick``, and grows by ``speed`` from there on while it plays."""

    title: str = Field(description="what is played: the run, else the name of the file")
    t: float = quantity("s", "time in the recording, from its first sample")
    tick: int
    duration_s: float = quantity("s", "time of its last sample")
    playing: bool
    ended: bool = Field(description="whether it stands at the last sample")
    speed: float = Field(description="seconds of the recording in a second")
    speed_min: float
    speed_max: float


class PlayerOrder(Schema):
    """What the player is to do; null leaves a thing as it is."""

    playing: bool | None = None
    speed: float | None = Field(
        default=None, ge=-HUGE, le=HUGE, description="seconds of the recording in a second; its bounds are in the state"
    )
    t: float | None = quantity("s", "time in the recording to go to", default=None, **ANY_SIZE)


class PlayedRecording(Schema):
    """The recording that is played, and what happened in it."""

    title: str
    run: int | None = Field(description="number of the run that the file says it holds; null where it says none")
    duration_s: float = quantity("s", "time of its last sample")
    marks: list[RunMark] = Field(description="what happened, in order; t from the first sample")
