"""Statistics and spectra over every sample of a range of a recording."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from backend.errors import OutOfRangeError, check_range
from backend.recording import messages
from backend.recording.derived_signals import compute_signal, load_geometry_lengths
from backend.recording.reader import read_samples
from backend.sample import COMBINED_SIGNAL_BY_NAME
from backend.storage import Database, Session, recordings

# Spectrum ------------------------------------------------------------------------------------------
# Power spectral density of samples by Welch's method.


Array = NDArray[np.float64]

LEAST_SAMPLES = 64
"""Fewest consecutive samples for a spectrum."""

USUAL_SEGMENT, LONGEST_SEGMENT = 8192, 32768
"""Largest segment lengths [samples]: normally, and for ranges of at least ``_MANY`` such segments."""

_LEAST_SEGMENTS, _MANY = 2, 8
_AT_ONCE = 32
"""Segments that are transformed together."""


@dataclass(frozen=True)
class Spectrum:
    """One-sided ``density`` [unit²/Hz] at 1, 2, ... times ``step_Hz``.

    Without half the sampling rate. ``segment`` is the length of a segment [samples], ``segments`` their number,
    ``used`` the number of samples in at least one segment. The amplitude of a sine is sqrt(2 density
    ``noise_bandwidth_Hz``).
    """

    step_Hz: float
    noise_bandwidth_Hz: float
    segment: int
    segments: int
    used: int
    density: Array


def welch_spectrum(values: Array, period_s: float) -> Spectrum | None:
    """Return the spectrum of samples, of which some may be missing (NaN).

    None without LEAST_SAMPLES consecutive ones. Hann windows overlap by half; the mean of each segment is removed. No
    segment contains a missing sample.
    """
    stretches = list(_unbroken(values))
    longest = max((end - begin for begin, end in stretches), default=0)
    if longest < LEAST_SAMPLES:
        return None
    segment = compute_segment_length(longest)
    hop = segment // 2
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(segment) / segment)
    squares, segments, used = np.zeros(hop - 1), 0, 0
    for begin, end in stretches:
        if end - begin < segment:
            continue
        frames = sliding_window_view(values[begin:end], segment)[::hop]
        segments += len(frames)
        used += (len(frames) - 1) * hop + segment
        for first in range(0, len(frames), _AT_ONCE):
            some = frames[first : first + _AT_ONCE]
            lines = np.fft.rfft((some - some.mean(axis=1, keepdims=True)) * window, axis=1)[:, 1:hop]
            squares += np.sum(lines.real**2 + lines.imag**2, axis=0)
    power = float(np.sum(window**2))
    return Spectrum(
        step_Hz=1.0 / (segment * period_s),
        noise_bandwidth_Hz=power / (float(np.sum(window)) ** 2 * period_s),
        segment=segment,
        segments=segments,
        used=used,
        density=2.0 * period_s / power * squares / segments,
    )


def compute_segment_length(samples: int) -> int:
    """Return the segment length for a number of consecutive samples."""

    def largest(most: int, least: int) -> int:
        return min(most, 1 << (samples // least).bit_length() - 1)

    return max(largest(USUAL_SEGMENT, _LEAST_SEGMENTS), largest(LONGEST_SEGMENT, _MANY))


def _unbroken(values: Array) -> Iterator[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.isfinite(values).astype(np.int8), prepend=0, append=0))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


# Range reading -------------------------------------------------------------------------------------
# Reading of every sample of a range of a recording in parts, including computed signals.


SLAB_TICKS = 50_000
"""Ticks read together: all their columns take 6 MB."""

_EXACT = 1e-6
"""Fraction of a period by which a time may miss its tick: 0.3 / 0.001 is slightly less than 300."""


@dataclass(frozen=True)
class TickInterval:
    """Ticks ``begin`` to ``end`` (exclusive) of a run, relative to its first sample."""

    run_id: int
    begin: int
    end: int
    period_s: float

    @property
    def ticks(self) -> int:
        """Number of ticks; the recording may lack some of them."""
        return self.end - self.begin

    @property
    def from_s(self) -> float:
        """Time of the first tick since the first sample of the run [s]."""
        return self.begin * self.period_s

    @property
    def to_s(self) -> float:
        """Time of the last tick since the first sample of the run [s]."""
        return (self.end - 1) * self.period_s

    def tick_at(self, time_s: float) -> int:
        """Return the tick at or before a time, relative to the run's first sample."""
        return int(np.floor(time_s / self.period_s + _EXACT))


@dataclass(frozen=True)
class Slab:
    """Consecutive samples: their ``ticks`` [n] and a column [n] per signal (SI).

    Ticks are relative to the first sample of the run.
    """

    ticks: NDArray[np.int64]
    columns: dict[str, NDArray[np.float64]]


def find_tick_range(session: Session, run_id: int, from_s: float = 0.0, to_s: float | None = None) -> TickInterval:
    """Return the ticks with from_s <= t <= to_s.

    Without ``to_s`` up to the last sample. Raises UnknownRecordError if the run has no recording, and OutOfRangeError
    for a range that exceeds the recording or has no tick.
    """
    recording, span = recordings.get(session, run_id), recordings.span(session, run_id)
    period_s = recording.period_s
    last = span.end_tick - span.first_tick - 1
    last_s = last * period_s
    slack_s = _EXACT * period_s
    within = messages.range_beyond_recording(run_id=run_id, end_s=last_s)
    if not -slack_s <= from_s <= last_s + slack_s:
        check_range(
            "from", from_s, minimum=0.0, maximum=last_s, unit="s", remedy=within, label=messages.start_of_range()
        )
    if to_s is None:
        to_s = last_s
    if not from_s <= to_s <= last_s + slack_s:
        check_range("to", to_s, minimum=from_s, maximum=last_s, unit="s", remedy=within, label=messages.end_of_range())
    begin = int(np.ceil(from_s / period_s - _EXACT))
    end = int(np.floor(to_s / period_s + _EXACT)) + 1
    if end <= begin:
        raise OutOfRangeError(
            quantity="range",
            value=to_s - from_s,
            minimum=period_s,
            maximum=None,
            unit="s",
            remedy=messages.range_between_samples(),
            label=messages.length_of_range(),
        )
    return TickInterval(run_id, begin, min(end, last + 1), period_s)


def read_slabs(database: Database, stretch: TickInterval, names: Sequence[str]) -> Iterator[Slab]:
    """Yield the samples of a range in parts of at most ``SLAB_TICKS``.

    Parts without samples are omitted. Each slab is read in its own transaction. Raises UnknownRecordError,
    UnknownSignalError, CodecError.
    """
    for begin in range(stretch.begin, stretch.end, SLAB_TICKS):
        end = min(begin + SLAB_TICKS, stretch.end)
        with database.reading() as session:
            slab = _read_columns(session, stretch, names, begin, end)
        if slab.ticks.size:
            yield slab


def _read_columns(session: Session, stretch: TickInterval, names: Sequence[str], begin: int, end: int) -> Slab:
    combined = [COMBINED_SIGNAL_BY_NAME[name] for name in dict.fromkeys(names) if name in COMBINED_SIGNAL_BY_NAME]
    recorded = recordings.get(session, stretch.run_id).fields
    terms = [term.column for one in combined for term in one.terms if term.column in recorded]
    stored = [name for name in names if name not in COMBINED_SIGNAL_BY_NAME]
    read = list(dict.fromkeys([*stored, *terms])) or recorded[:1]
    samples = read_samples(session, stretch.run_id, read, begin * stretch.period_s, end * stretch.period_s)
    columns = {name: samples.columns[name].astype(np.float64) for name in read}
    lengths = load_geometry_lengths(session, stretch.run_id, combined)
    columns |= {one.name: compute_signal(one, columns, lengths, samples.t.size) for one in combined}
    ticks = np.rint(samples.t / stretch.period_s).astype(np.int64)
    return Slab(ticks, {name: columns[name] for name in names})


# Statistics ----------------------------------------------------------------------------------------
# Statistics of signals over every sample of a range of a recording.


@dataclass(frozen=True)
class Extreme:
    """A value and the first tick with it, relative to the run's first sample."""

    value: float
    tick: int


@dataclass
class Statistics:
    """Statistics of all added samples of one signal.

    ``values`` counts the samples with a value, ``without_value`` those without (NaN). ``squares`` is the sum of the
    squared deviations from ``mean``.
    """

    values: int = 0
    without_value: int = 0
    mean: float = 0.0
    squares: float = 0.0
    minimum: Extreme | None = None
    maximum: Extreme | None = None

    @property
    def deviation(self) -> float:
        """Standard deviation of the samples themselves: divided by their number."""
        return float(np.sqrt(self.squares / self.values)) if self.values else float("nan")

    def add(self, ticks: NDArray[np.int64], column: NDArray[np.float64]) -> None:
        """Add samples that follow those added before."""
        there = np.isfinite(column)
        added, at = column[there], ticks[there]
        self.without_value += column.size - added.size
        if not added.size:
            return
        low, high = int(np.argmin(added)), int(np.argmax(added))
        if self.minimum is None or added[low] < self.minimum.value:
            self.minimum = Extreme(float(added[low]), int(at[low]))
        if self.maximum is None or added[high] > self.maximum.value:
            self.maximum = Extreme(float(added[high]), int(at[high]))
        self._merge(added.size, float(added.mean()), float(np.sum((added - added.mean()) ** 2)))

    def _merge(self, count: int, mean: float, squares: float) -> None:
        """Merge mean and squares of a second set (Chan, Golub and LeVeque 1979).

        Accurate for large offsets too.
        """
        total, apart = self.values + count, mean - self.mean
        self.squares += squares + apart * apart * self.values * count / total
        self.mean += apart * count / total
        self.values = total


def add_slab(to: Mapping[str, Statistics], slab: Slab) -> None:
    """Add the samples of a slab to the statistics of each of its signals."""
    for name, statistics in to.items():
        statistics.add(slab.ticks, slab.columns[name])
