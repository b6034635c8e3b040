"""What is computed from every sample of a range of a recorded run."""

from pydantic import Field

from backend.messages.base import Schema, quantity


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
