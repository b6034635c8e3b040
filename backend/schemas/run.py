"""Schemas of stored runs and their samples.

Flight records, lineage, search, event log, statistics and replay.
"""

from datetime import datetime
from enum import StrEnum
from typing import Annotated, Literal

from pydantic import AwareDatetime, Field

from backend.models import DeclaredValue, Outcome, RunHeadline
from backend.schemas.base import ANY_SIZE, HUGE, Schema, quantity
from backend.storage import LONGEST, TAG_MAX, LogEntry

# Flight records ------------------------------------------------------------------------------------


class FlightView(Schema):
    """Record of the samples around a trip or a trigger."""

    id: int
    at: datetime
    kind: Literal["trip", "trigger"]
    who: str = Field(description="person who pressed STOP or armed the trigger; else empty")
    fault: str = Field(description="code of the fault; 'trigger' for a trigger")
    text: str
    run: int | None
    tick: int = Field(description="tick of the trip or trigger, as counted by the control loop process that ran then")
    before_s: float = quantity("s", "recorded time before the trip or trigger")
    after_s: float = quantity("s", "recorded time after the trip or trigger")


class FlightList(Schema):
    """Flight records, newest first."""

    flights: list[FlightView]


class FlightMoment(Schema):
    """The moment of a flight record to show."""

    t: float = quantity("s", "time since the trip or trigger", ge=-1e6, le=1e6)


# Lineage, events and set-up ------------------------------------------------------------------------


LONGEST_S = 1e9
"""Bound of times in a recording [s], thirty years."""


class LineageBank(Schema):
    """A bank that a run used or that was built from it."""

    id: int
    name: str
    version: int


class LineageEntry(Schema):
    """Origin of an operating point of the bank of a run."""

    name: str = Field(description="name of the operating point, from its tension")
    S_nominal: float = quantity("N·m/rad", "stiffness of the operating point")
    run: int | None = Field(description="identification run; null for imported data and geometric gains")


class LineageKind(StrEnum):
    """Kind of a node of the lineage."""

    RUN = "run"
    GAINS = "gains"
    BANK = "bank"
    IDENTIFICATION = "identification"
    DATA = "data"
    PARAMETERS = "parameters"
    CALIBRATION = "calibration"


class LineageNode(Schema):
    """A node of the lineage.

    ``run``, ``bank`` and ``identification`` link to its page.
    """

    id: str
    kind: LineageKind
    title: str
    detail: str
    sha256: str | None = Field(description="digest of its content, in hex")
    no_sha256: str = Field(description="why there is no digest")
    out_of_date: str = Field(description="why it is out of date; empty if it is not")
    run: int | None = Field(description="its run, or the run of its samples")
    bank: int | None
    identification: int | None = Field(description="run number of its identification")
    origins: list[str] = Field(description="ids of the nodes that it depends on")


class Lineage(Schema):
    """Data that a run depends on, and results that depend on the run."""

    run: int
    software: str
    parameters: str
    parameters_as_now: bool = Field(description="whether the active plant parameters equal those of this run")
    bank: LineageBank | None = Field(description="bank of the run; null for geometric gains")
    entries: list[LineageEntry]
    banks_built: list[LineageBank] = Field(description="banks with an operating point identified from this run")
    runs_with_them: list[int] = Field(description="newest runs that used these banks")
    nodes: list[LineageNode] = Field(description="nodes of the lineage, each with a digest of its content")


class RunMark(Schema):
    """An event during a run."""

    t: float = quantity("s", "time since the run's first sample")
    kind: str
    text: str
    who: str


class RunMarks(Schema):
    """Events during a run, in order."""

    marks: list[RunMark]


class PlannedPart(Schema):
    """A named part of a program."""

    title: str
    start_s: float = quantity("s", "start of the part, since the start of the program")
    end_s: float = quantity("s", "end of the part, since the start of the program")


class PlannedLine(Schema):
    """Planned values of one signal."""

    name: str = Field(description="name of the sample column")
    unit: str
    values: list[float | None] = Field(description="null where the program does not set the signal")


class PlannedSignals(Schema):
    """Signals that a program sets over its whole duration, known before its start.

    For an experiment, references and pushes. For an identification, operating points and excitation: motor references
    without the trim of the force loop, the voltage of steps, the tension of the motor references at q = 0.
    """

    t: list[float] = Field(description="times since the program began [s]")
    lines: list[PlannedLine]
    parts: list[PlannedPart]


class ReplayRequest(Schema):
    """Time in a replay to show."""

    t: float = quantity("s", "time since the run's first sample", ge=0.0, le=LONGEST_S)


class ChecklistState(StrEnum):
    """State of a step of the setup."""

    MISSING = "missing"
    DONE = "done"
    OUTDATED = "outdated"
    UNUSABLE = "unusable"


class ChecklistStep(Schema):
    """One step from pretension to report."""

    name: str
    state: ChecklistState
    detail: str = Field(description="present result, or why it is missing or out of date")
    run: int | None
    at: datetime | None


class Checklist(Schema):
    """Steps of the setup in order; each builds on the earlier ones."""

    steps: list[ChecklistStep]


# Runs and samples ----------------------------------------------------------------------------------


class EvaluationView(StrEnum):
    """State of the evaluation of a run."""

    NONE = "none"
    """A session, or a run that has not ended."""
    UNDER_WAY = "under_way"
    DONE = "done"
    MISSING = "missing"
    """It failed, and may succeed when repeated."""


class RunView(Schema):
    """One stored run."""

    id: int
    kind: str
    title: str = Field(description="title of the experiment, identification or session")
    plant: str
    parameters: str
    who: str
    started: datetime
    ended: datetime | None
    end_state: str
    end_reason: str
    duration_s: float = quantity("s", "duration of the recording")
    samples: int
    missing_samples: int | None = Field(
        description="number of samples missing from the recording; more than 0 is an error of the run; "
        "null if unknown because the service died during the recording"
    )
    samples_deleted: datetime | None = Field(description="time at which a person deleted the samples to free space")
    settings: list[DeclaredValue]
    note: str
    tags: list[str]
    station: str = Field(description="station of the run; empty for a database without stations")
    origin: str = Field(description="installation it was imported from; empty if it was recorded here")
    evaluation: EvaluationView
    evaluation_problem: str = Field(description="why the run has no result, if known")
    outcome: Outcome | None = Field(description="outcome by the criteria; null for a session and a run not yet ended")
    headline: RunHeadline | None = Field(
        description="the first failed criterion, else the first measured criterion, else the lower fit of an "
        "identified actuator, else the first measured metric"
    )


class RunList(Schema):
    """One page of runs, newest first."""

    runs: list[RunView]
    total: int


class NoteRequest(Schema):
    """Note of a person about a run."""

    note: str = Field(max_length=4000)


class SignalEnvelope(Schema):
    """Minimum and maximum of one signal per bucket.

    Both are the samples themselves if these are raw.
    """

    unit: str
    minimum: list[float | None]
    maximum: list[float | None]


class SamplesView(Schema):
    """Samples of a run: raw if there are few, else minimum and maximum per bucket."""

    run: int
    raw: bool
    width_s: float = quantity("s", "width of a bucket; the sampling period for raw samples")
    t: list[float] = quantity("s", "time since the run's first sample")
    signals: dict[str, SignalEnvelope]


# Search, tags and metrics over time ----------------------------------------------------------------


SEARCH_NAME_MAX = 60


class SearchWords(Schema):
    """Fields and values that a search of the stored runs can use."""

    station: str = Field(description="the station of this service")
    stations: list[str] = Field(description="all stations with runs")
    fields: list[str] = Field(description="fields of every run")
    kinds: list[str]
    ends: list[str]
    verdicts: list[str]
    tags: list[str]
    values: dict[str, list[str]] = Field(description="names of parameters, settings and metrics, by these kinds")


class SearchText(Schema):
    """A search as typed."""

    where: str = Field(max_length=LONGEST)


class SavedSearch(SearchText):
    """A search with a name."""

    name: str
    who: str


class SavedSearchList(Schema):
    """All saved searches, by name."""

    searches: list[SavedSearch]


class TagRequest(Schema):
    """A tag to add or remove."""

    tag: str = Field(max_length=10 * TAG_MAX)


class TagList(Schema):
    """The tags in use."""

    tags: list[str]


class MetricName(Schema):
    """A metric of runs of a kind."""

    name: str
    label: str
    unit: str


class MetricPoint(Schema):
    """A metric of one run."""

    run: int
    at: datetime
    value: float


class MetricHistory(Schema):
    """A metric of the runs of one kind by date, oldest first."""

    kind: str
    metric: MetricName | None = Field(description="null if no run of the kind was evaluated")
    metrics: list[MetricName] = Field(description="available metrics: those of the newest evaluated run")
    points: list[MetricPoint]
    without: int = Field(description="number of matching runs without a value")
    left_out: int = Field(description="number of older points omitted because there are too many")


# Chart sheet ---------------------------------------------------------------------------------------


LONGEST_SHEET = 2 * 1024 * 1024
"""Maximum size in characters and in bytes: sixty curves of four thousand points each."""


class ChartSheet(Schema):
    """A drawing of the page to convert to a PDF of the same size."""

    svg: str = Field(
        min_length=1,
        max_length=LONGEST_SHEET,
        description="SVG of one sheet: lines and text, with its size in mm; external references are not allowed",
    )


# Event log -----------------------------------------------------------------------------------------


Instant = Annotated[AwareDatetime, Field(json_schema_extra={"maxLength": 40})]
"""A time with time zone; its text has at most 40 characters."""


class Timeline(Schema):
    """A page of the event log, newest first."""

    entries: list[LogEntry]
    total: int = Field(description="number of all entries that match the query")
    more_before: datetime | None = Field(description="time before which to request the next page; null on the last one")


class EventNote(Schema):
    """Note and tags of a person about an event; both empty remove them."""

    note: str = Field(default="", max_length=10_000)
    tags: list[Annotated[str, Field(max_length=10 * TAG_MAX)]] = Field(
        default=[], max_length=100, description=f"words of at most {TAG_MAX} characters"
    )


# Statistics and spectra ----------------------------------------------------------------------------


class ReadRange(Schema):
    """Range of a recording that was read."""

    run: int
    from_s: float = quantity("s", "time of the first tick of the range since the run's first sample")
    to_s: float = quantity("s", "time of the last tick of the range since the run's first sample")
    period_s: float = quantity("s", "sampling period")
    samples: int = Field(description="number of recorded samples within the range")
    missing: int = Field(description="number of samples of the range that are missing from the recording")


class SignalStatistics(Schema):
    """Statistics of one signal; null if no sample has a value."""

    unit: str
    values: int = Field(description="number of samples with a value; the statistics use all of them")
    without_value: int = Field(
        description="number of samples without a value: not measured, or not active at that time"
    )
    minimum: float | None
    minimum_s: float | None = quantity("s", "time of the first minimum since the run's first sample")
    maximum: float | None
    maximum_s: float | None = quantity("s", "time of the first maximum since the run's first sample")
    mean: float | None
    deviation: float | None = Field(description="standard deviation about the mean, normalized by the number of values")


class RecordedStatistics(ReadRange):
    """Statistics of signals over every sample of a range."""

    signals: dict[str, SignalStatistics]


class SignalSpectrum(Schema):
    """Power spectral density of one signal at 1, 2, ... times ``step_Hz``."""

    unit: str
    reason: str = Field(description="why there is no spectrum; else empty")
    values: int = Field(description="number of samples of the range with a value")
    without_value: int = Field(
        description="number of samples without a value: not measured, or not active at that time"
    )
    used: int = Field(
        description="number of samples used in segments; a range between gaps that is "
        "shorter than a segment is not used"
    )
    segment: int = Field(description="length of a segment in samples")
    segments: int
    step_Hz: float = quantity("Hz", "frequency resolution")
    noise_bandwidth_Hz: float = quantity(
        "Hz", "equivalent noise bandwidth; the amplitude of a sine is sqrt(2 density bandwidth)"
    )
    density: list[float] = Field(description="one-sided power spectral density [unit²/Hz]")


class RecordedSpectra(ReadRange):
    """Spectra of signals over every sample of a range, by Welch's method."""

    method: str = "Welch"
    window: str = "Hann"
    overlap: float = Field(default=0.5, description="share of a segment that the next one overlaps")
    signals: dict[str, SignalSpectrum]


class StatisticsLine(Schema):
    """One line of the streamed response: the progress; the last line has the result."""

    share: float = Field(description="share of the range that has been read, 0 to 1")
    result: RecordedStatistics | None = None


class SpectraLine(Schema):
    """One line of the streamed response: the progress; the last line has the result."""

    share: float = Field(description="share of the range that has been read, 0 to 1")
    result: RecordedSpectra | None = None


class Moment(Schema):
    """The values of signals at the sample at or before a time."""

    at_s: float = quantity("s", "requested time since the run's first sample")
    t: float = quantity("s", "time of the sample")
    values: dict[str, float | None] = Field(description="SI; null if the sample has no value")


class RecordedValues(Schema):
    """The values of signals at some times of a recorded run."""

    run: int
    period_s: float = quantity(
        "s",
        "sampling period; if a sample is older than the requested time by "
        "more than this period, later samples are missing",
    )
    moments: list[Moment]


# Replay --------------------------------------------------------------------------------------------


class PlayerView(Schema):
    """Position of a replay.

    ``t`` is the time at ``tick``, and grows by ``speed`` per second during playback.
    """

    title: str = Field(description="title of the run, or name of the file")
    t: float = quantity("s", "time in the recording, from its first sample")
    tick: int
    duration_s: float = quantity("s", "time of the last sample of the recording")
    playing: bool
    ended: bool = Field(description="whether the position is the last sample")
    speed: float = Field(description="playback speed: seconds of the recording per second")
    speed_min: float
    speed_max: float


class PlayerOrder(Schema):
    """Changes of a replay; null changes nothing."""

    playing: bool | None = None
    speed: float | None = Field(
        default=None,
        ge=-HUGE,
        le=HUGE,
        description="playback speed: seconds of the recording per second; the state contains its bounds",
    )
    t: float | None = quantity("s", "time in the recording to seek to", default=None, **ANY_SIZE)


class PlayedRecording(Schema):
    """The recording of a replay, and its events."""

    title: str
    run: int | None = Field(description="number of the run in the file; null if the file has none")
    duration_s: float = quantity("s", "time of the last sample of the recording")
    marks: list[RunMark] = Field(description="events in order; t from the first sample")
