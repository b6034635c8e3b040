"""Reading of recordings: samples, envelopes for drawing, computed signals, jumps."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, islice

import numpy as np
from numpy.typing import NDArray

from backend.recording import messages
from backend.recording.codec import BUCKET_TICKS, Table, unpack_alike
from backend.recording.derived_signals import (
    ComputedSignal,
    Derived,
    compute_signal,
    find_source_columns,
    load_geometry_lengths,
    select_derived,
)
from backend.sample import ADDED_LATER, STORED_NAMES, UNIT_BY_SIGNAL
from backend.storage import Chunk, Database, Recording, Session, Span, UnknownRecordError, recordings
from plant import ErrorCode, SinewError, T_s

# Computed envelopes --------------------------------------------------------------------------------
# Envelopes of signals that are not stored but computed from the columns, sample by sample.


AT_HAND_SAMPLES = 1_000_000
"""Largest number of samples that are read one by one in the service without interrupting the live stream; more are read
in a worker process, which takes longer to start."""

_AT_ONCE = 64
"""Chunks unpacked together: fewer take longer, more take more memory."""


def combined_envelope(
    session: Session,
    recording: Recording,
    wanted: Sequence[ComputedSignal],
    ticks: tuple[int, int],
    buckets: NDArray[np.int64],
) -> tuple[Table, Table]:
    """Return the smallest and largest value per bucket, [buckets, wanted] each.

    ``ticks`` is the range (end exclusive); ``buckets`` holds the first tick of each bucket, and the end of the last.
    NaN if the recording lacks a column or the run's parameters a length. The extremes of a sum are not those of its
    terms, so every sample is read, of an hour in about a second.
    """
    count = len(buckets) - 1
    low, high = (np.full((count, len(wanted)), np.nan, np.float32) for _ in range(2))
    lengths = load_geometry_lengths(session, recording.run_id, wanted)
    sources = [name for name in find_source_columns(wanted) if name in recording.fields]
    indices = [recording.fields.index(name) for name in sources]
    for alike in _alike(recordings.chunks(session, recording.run_id, *ticks)):
        at_ticks = np.array([chunk.first_tick for chunk in alike])[:, None] + np.arange(alike[0].count)
        inside = (at_ticks >= ticks[0]) & (at_ticks < ticks[1])
        table = unpack_alike([chunk.samples for chunk in alike], len(recording.fields), indices)[inside]
        columns = dict(zip(sources, table.astype(np.float64).T, strict=True))
        values = in_precision(np.column_stack([compute_signal(one, columns, lengths, len(table)) for one in wanted]))
        at = np.searchsorted(buckets, at_ticks[inside], side="right") - 1
        starts = np.flatnonzero(np.diff(at, prepend=-1))
        low[at[starts]] = np.fmin(low[at[starts]], np.fmin.reduceat(values, starts, axis=0))
        high[at[starts]] = np.fmax(high[at[starts]], np.fmax.reduceat(values, starts, axis=0))
    return low, high


def _alike(chunks: Iterable[Chunk]) -> Iterator[list[Chunk]]:
    """Yield groups of consecutive chunks with equal lengths."""
    for _, alike in groupby(chunks, key=lambda chunk: chunk.count):
        while some := list(islice(alike, _AT_ONCE)):
            yield some


def in_precision(values: NDArray[np.float64]) -> Table:
    """Return computed values in the precision of stored columns.

    NaN for values that overflow.
    """
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    single[np.isinf(single)] = np.nan
    return single


# Reader --------------------------------------------------------------------------------------------
# Recordings as raw samples, or as an envelope of smallest and largest values for drawing.


Column = NDArray[np.float32]


class UnknownSignalError(SinewError, ValueError):
    """The recording has no such signal; the message lists the existing ones."""

    category = ErrorCode.BAD_VALUE


@dataclass(frozen=True)
class RawSamples:
    """Raw samples: time ``t`` [n] [s] and a column [n] per signal (SI).

    ``t`` counts from the first sample of the run and jumps at missing samples. ``first_tick`` is the tick of t = 0 on
    the time axis of the loop.
    """

    first_tick: int
    t: NDArray[np.float64]
    columns: dict[str, Column]


@dataclass(frozen=True)
class SampleEnvelope:
    """Smallest and largest value per bucket of ``width_s``.

    Buckets begin at ``t`` [n] since the run's first sample, at fixed positions independent of the range, so a moving
    window does not flicker; a bucket without any number (samples missing, or NaN) is NaN.
    """

    first_tick: int
    width_s: float
    t: NDArray[np.float64]
    minimum: dict[str, Column]
    maximum: dict[str, Column]
    units: dict[str, str]


def read_samples(
    session: Session, run_id: int, names: Sequence[str] = (), from_s: float = 0.0, to_s: float = np.inf
) -> RawSamples:
    """Return the samples with from_s <= t < to_s.

    No names mean all recorded signals. Formulas are computed; a signal that only later versions record is NaN. Raises
    UnknownRecordError if the run has no recording, and UnknownSignalError.
    """
    return next(read_stretches(session, run_id, names, [(from_s, to_s)]))


def read_stretches(
    session: Session, run_id: int, names: Sequence[str], stretches: Iterable[tuple[float, float]]
) -> Iterator[RawSamples]:
    """Yield the samples of several ranges [from_s, to_s) with shared queries.

    Raises like ``read_samples``.
    """
    recording, span = recordings.get(session, run_id), recordings.span(session, run_id)
    made = {name: one for name, one in select_derived(session, names).items() if isinstance(one, Derived)}
    lengths = load_geometry_lengths(session, run_id, list(made.values()))
    parts = [name for name in find_source_columns(made.values()) if name in recording.fields]
    stored = [name for name in names if name not in made]
    read = [*dict.fromkeys([*stored, *parts])]
    # no names mean all columns, but computed signals without columns need none
    chosen = [] if made and not read else _columns(recording, read)
    for from_s, to_s in stretches:
        from_tick, to_tick = _ticks(recording, span, from_s, to_s)
        ticks, tables = _raw(session, recording, from_tick, to_tick, [index for _, index in chosen])
        t = np.asarray((ticks - span.first_tick) * recording.period_s, np.float64)
        columns = _select_columns(chosen, read, tables)
        if made:
            exact = {name: columns[name].astype(np.float64) for name in parts}
            columns |= {name: in_precision(compute_signal(one, exact, lengths, t.size)) for name, one in made.items()}
            columns = {name: columns[name] for name in names}
        yield RawSamples(span.first_tick, t, columns)


def read_envelope(
    session: Session,
    run_id: int,
    points: int,
    names: Sequence[str] = (),
    from_s: float = 0.0,
    to_s: float = np.inf,
) -> SampleEnvelope:
    """Return about ``points`` buckets over from_s <= t < to_s.

    Short ranges have one bucket per sample. Buckets longer than those of the stored summaries are computed from these,
    without reading the samples. Computed signals (``select_derived``) are supported too. Raises like ``read_samples``,
    and ValueError for fewer than one point.
    """
    if points < 1:
        raise ValueError(messages.too_few_points(points=points))
    recording, span = recordings.get(session, run_id), recordings.span(session, run_id)
    made = select_derived(session, names)
    combined = list(made.values())
    stored = [name for name in names if name not in made]
    # no names mean all columns, but computed signals alone need none
    chosen = [] if combined and not stored else _columns(recording, stored)
    indices = [index for _, index in chosen]
    from_tick, to_tick = _ticks(recording, span, from_s, to_s)
    width = max(1, -(-(to_tick - from_tick) // points))
    if width < BUCKET_TICKS:
        ticks, tables = _raw(session, recording, from_tick, to_tick, indices)
        low = high = tables
    else:
        width = -(-width // BUCKET_TICKS) * BUCKET_TICKS
        ticks, low, high = _read_summaries(session, recording, from_tick, to_tick, indices)
    first = (from_tick - span.first_tick) // width
    last = -(-(to_tick - span.first_tick) // width)
    buckets = (ticks - span.first_tick) // width - first
    low, high = (
        _reduce_buckets(np.fmin, low, buckets, last - first),
        _reduce_buckets(np.fmax, high, buckets, last - first),
    )
    minimum, maximum = (_select_columns(chosen, stored or [name for name, _ in chosen], part) for part in (low, high))
    if combined:
        edges = span.first_tick + width * np.arange(first, last + 1)
        extremes = combined_envelope(session, recording, combined, (from_tick, to_tick), edges)
        for of_all, table in zip((minimum, maximum), extremes, strict=True):
            of_all.update({one.name: table[:, i] for i, one in enumerate(combined)})
    return SampleEnvelope(
        first_tick=span.first_tick,
        width_s=width * recording.period_s,
        t=np.asarray(np.arange(first, last) * width * recording.period_s, np.float64),
        minimum={name: minimum[name] for name in names or minimum},
        maximum={name: maximum[name] for name in names or maximum},
        units={name: made[name].unit if name in made else UNIT_BY_SIGNAL[name] for name in names or minimum},
    )


def _columns(recording: Recording, names: Sequence[str]) -> list[tuple[str, int]]:
    unknown = [name for name in names if name not in recording.fields and name not in ADDED_LATER]
    if unknown:
        raise UnknownSignalError(messages.signals_not_recorded(signals=unknown, recorded=recording.fields))
    return [(name, recording.fields.index(name)) for name in names or recording.fields if name in recording.fields]


def _select_columns(chosen: list[tuple[str, int]], names: Sequence[str], table: Table) -> dict[str, Column]:
    """Return columns by name in the requested order; NaN for missing columns.

    A recording of an earlier version lacks some.
    """
    recorded = {name: table[:, i] for i, (name, _) in enumerate(chosen)}
    return {name: recorded.get(name, np.full(len(table), np.nan, np.float32)) for name in names or recorded}


def _ticks(recording: Recording, span: Span, from_s: float, to_s: float) -> tuple[int, int]:
    """Return the ticks [from, to) of the range, within the recording."""
    last_s = (span.end_tick - span.first_tick) * recording.period_s
    # Half a period of tolerance: 0.3 s is tick 300, although 0.3 / 0.001 is slightly less.
    ticks = [int(np.ceil(np.clip(s, 0.0, last_s) / recording.period_s - 0.5)) for s in (from_s, to_s)]
    return span.first_tick + ticks[0], span.first_tick + max(ticks)


def _raw(
    session: Session, recording: Recording, from_tick: int, to_tick: int, indices: list[int]
) -> tuple[NDArray[np.int64], Table]:
    ticks, tables = [np.empty(0, np.int64)], [np.empty((0, len(indices)), np.float32)]
    for chunk in recordings.chunks(session, recording.run_id, from_tick, to_tick):
        (table,) = unpack_alike([chunk.samples], len(recording.fields), indices)
        begin, end = max(from_tick - chunk.first_tick, 0), min(to_tick - chunk.first_tick, chunk.count)
        ticks.append(chunk.first_tick + np.arange(begin, end))
        tables.append(table[begin:end])
    return np.concatenate(ticks), np.concatenate(tables)


def _read_summaries(
    session: Session, recording: Recording, from_tick: int, to_tick: int, indices: list[int]
) -> tuple[NDArray[np.int64], Table, Table]:
    ticks = [np.empty(0, np.int64)]
    lows, highs = [np.empty((0, len(indices)), np.float32)], [np.empty((0, len(indices)), np.float32)]
    stored = recordings.summaries(session, recording.run_id, from_tick, to_tick)
    for _, alike in groupby(stored, key=lambda summary: summary.count):
        first_ticks, packed = zip(*((summary.first_tick, summary.summary) for summary in alike), strict=True)
        low, high = np.split(unpack_alike(packed, len(recording.fields), indices), 2, axis=1)
        begins = (np.array(first_ticks)[:, None] + np.arange(low.shape[1]) * BUCKET_TICKS).ravel()
        inside = (begins < to_tick) & (begins + BUCKET_TICKS > from_tick)
        # A stored bucket that the range cuts counts at the start of the range.
        ticks.append(np.maximum(begins, from_tick)[inside])
        lows.append(low.reshape(begins.size, -1)[inside])
        highs.append(high.reshape(begins.size, -1)[inside])
    return np.concatenate(ticks), np.concatenate(lows), np.concatenate(highs)


def _reduce_buckets(extreme: np.ufunc, table: Table, buckets: NDArray[np.int64], count: int) -> Table:
    gathered = np.full((count, table.shape[1]), np.nan, np.float32)
    if len(table):
        starts = np.flatnonzero(np.diff(buckets, prepend=-1))
        gathered[buckets[starts]] = extreme.reduceat(table, starts, axis=0)
    return gathered


# Columns -------------------------------------------------------------------------------------------
# All signals of a run as arrays for computation.


Columns = dict[str, NDArray[np.float64]]
"""Samples by column name in double precision, shape (N,) each, and ``t`` [s] from the run's first sample."""


def read_recorded_columns(database: Database, run_id: int) -> tuple[Columns, int]:
    """Return the samples of a run and the number of missing ones.

    Empty columns for a run without recording.
    """
    try:
        with database.reading() as session:
            samples = read_samples(session, run_id)
            missed = recordings.get(session, run_id).missed
    except UnknownRecordError:
        return _empty(), 0
    return {"t": samples.t} | {name: column.astype(np.float64) for name, column in samples.columns.items()}, missed


def read_drawn_columns(database: Database, run_id: int, points: int = 2000) -> Columns:
    """Return each bucket's smallest and largest value in turn, to draw a whole run.

    Shape (M,) with M at most about 2 ``points``; empty columns for a run without recording.
    """
    try:
        with database.reading() as session:
            envelope = read_envelope(session, run_id, points)
    except UnknownRecordError:
        return _empty()
    columns: Columns = {"t": np.repeat(envelope.t, 2) + np.tile([0.0, 0.5 * envelope.width_s], envelope.t.size)}
    for name, low in envelope.minimum.items():
        columns[name] = np.column_stack((low, envelope.maximum[name])).ravel().astype(np.float64)
    return columns


def count_missing_ticks(columns: Columns) -> int:
    """Return the number of ticks missing between the first and the last sample."""
    t = columns["t"]
    return round((t[-1] - t[0]) / T_s) + 1 - t.size if t.size else 0


def _empty() -> Columns:
    return {name: np.empty(0) for name in ("t", *STORED_NAMES)}


# Jumps ---------------------------------------------------------------------------------------------
# Jumps of a recorded signal: changes between two samples with a constant signal before and after.
#
# The start of a ramp is no jump, nor is any part of a sine. Only ranges whose summaries change are read.


_MOST_BUCKETS = 1200
"""Buckets of which all samples are read together: a minute."""

_MOST_SUMMARIES = 12_000
"""Summaries read together: ten minutes, so that the first jumps do not wait for those of the eighth hour."""


def jumps(session: Session, run_id: int, name: str) -> Iterator[float]:
    """Yield the times [s] of the first samples after each jump.

    From the run's first sample. Raises UnknownRecordError, UnknownSignalError.
    """
    period_s, span = recordings.get(session, run_id).period_s, recordings.span(session, run_id)
    whole_s = (span.end_tick - span.first_tick) * period_s
    piece_s, bucket_s = _MOST_SUMMARIES * BUCKET_TICKS * period_s, BUCKET_TICKS * period_s
    for begin_s in np.arange(0.0, whole_s, piece_s):
        end_s = begin_s + piece_s
        # a stored bucket may reach into the next range, and is compared with the previous one
        around = max(0.0, begin_s - 2.0 * bucket_s), end_s + bucket_s
        stretches = _find_changes(session, run_id, name, around, period_s)
        earlier = begin_s - 0.5 * period_s
        reads = [(max(0.0, from_s - 3.0 * period_s), to_s + 2.0 * period_s) for from_s, to_s in stretches]
        for (from_s, to_s), samples in zip(stretches, read_stretches(session, run_id, [name], reads), strict=True):
            found = samples.t[_find_jumps(samples.t, samples.columns[name], period_s)]
            inside = (found > max(earlier, from_s - 0.5 * period_s)) & (found < min(end_s, to_s) - 0.5 * period_s)
            yield from found[inside].tolist()


def _find_changes(
    session: Session, run_id: int, name: str, around: tuple[float, float], period_s: float
) -> list[tuple[float, float]]:
    """Return the ranges [from_s, to_s) in which the summaries show a change."""
    points = max(1, math.ceil((around[1] - around[0]) / (BUCKET_TICKS * period_s)))
    envelope = read_envelope(session, run_id, points, [name], *around)
    low, high = envelope.minimum[name], envelope.maximum[name]
    moving = low != high
    moving[1:] |= low[1:] != high[:-1]
    stretches = _stretches(np.flatnonzero(moving), reach=1)
    start_s = float(envelope.t[0]) if envelope.t.size else 0.0
    return [(start_s + begin * envelope.width_s, start_s + end * envelope.width_s) for begin, end in stretches]


def find_jump(session: Session, run_id: int, name: str, number: int) -> tuple[float | None, int]:
    """Return the time [s] of the ``number``-th jump, or None, and the jumps found.

    The second value is their number.
    """
    found = list(islice(jumps(session, run_id, name), number))
    return (found[-1] if len(found) == number else None), len(found)


def _stretches(buckets: NDArray[np.int64], reach: int) -> Iterator[tuple[int, int]]:
    """Join adjacent buckets, and ``reach`` after them, to ranges [begin, end).

    The length of a range is bounded.
    """
    begin = end = -1
    for bucket in buckets.tolist():
        if bucket > end or bucket - begin >= _MOST_BUCKETS:
            if end > begin:
                yield begin, end
            begin = max(bucket, end)
        end = max(end, bucket + 1 + reach)
    if end > begin:
        yield begin, end


def _find_jumps(t: NDArray[np.float64], y: NDArray[np.float32], period_s: float) -> Sequence[int] | NDArray[np.int64]:
    if t.size < 4:
        return []
    step, next_to = np.diff(y), np.diff(t) < 1.5 * period_s
    still = (step == 0.0) & next_to
    moved = (step != 0.0) & np.isfinite(step) & next_to
    found: NDArray[np.int64] = np.flatnonzero(moved[1:-1] & still[:-2] & still[2:]) + 2
    return found
