"""Read recordings back: raw samples, or the envelope of smallest and largest values for drawing."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from backend.recording.codec import BUCKET_TICKS, Table, unpack_alike
from backend.recording.combined import combined_envelope, in_precision
from backend.recording.following import columns_of, computed, following, lengths_of
from backend.recording.formula import Derived
from backend.sample import ADDED_LATER, UNIT_OF
from backend.storage import Session, recordings
from backend.storage.recordings import Recording, Span

Column = NDArray[np.float32]


class UnknownSignalError(ValueError):
    """The recording has no such signal; the message lists those it has."""


@dataclass(frozen=True)
class Samples:
    """Raw samples: ``t`` [n] in seconds since the first sample of the run, and a column [n] per signal (SI).

    Where samples are missing ``t`` jumps. ``first_tick`` is the tick of t = 0 on the time axis of the loop.
    """

    first_tick: int
    t: NDArray[np.float64]
    columns: dict[str, Column]


@dataclass(frozen=True)
class Envelope:
    """Smallest and largest value per bucket of ``width_s``, which begin at ``t`` [n] since the run's first sample.

    Buckets stand at fixed places whatever the slice, so that a moving window does not wiggle; one without any number
    (samples missing, or nan) is nan.
    """

    first_tick: int
    width_s: float
    t: NDArray[np.float64]
    minimum: dict[str, Column]
    maximum: dict[str, Column]
    units: dict[str, str]


def read_samples(
    session: Session, run_id: int, names: Sequence[str] = (), from_s: float = 0.0, to_s: float = np.inf
) -> Samples:
    """Return the samples with from_s <= t < to_s; no names means all signals that were recorded.

    Those of formulas are computed; one that only later versions record is nan. Raises UnknownRecordError when
    nothing of the run was recorded, and UnknownSignalError.
    """
    return next(read_stretches(session, run_id, names, [(from_s, to_s)]))


def read_stretches(
    session: Session, run_id: int, names: Sequence[str], stretches: Iterable[tuple[float, float]]
) -> Iterator[Samples]:
    """Yield the samples of one stretch [from_s, to_s) after the other; what they share is asked for once.

    Raises like ``read_samples``.
    """
    recording, span = recordings.get(session, run_id), recordings.span(session, run_id)
    made = {name: one for name, one in following(session, names).items() if isinstance(one, Derived)}
    lengths = lengths_of(session, run_id, list(made.values()))
    parts = [name for name in columns_of(made.values()) if name in recording.fields]
    stored = [name for name in names if name not in made]
    read = [*dict.fromkeys([*stored, *parts])]
    # no names mean all columns, and those of signals that follow from none of them mean none
    chosen = [] if made and not read else _columns(recording, read)
    for from_s, to_s in stretches:
        from_tick, to_tick = _ticks(recording, span, from_s, to_s)
        ticks, tables = _raw(session, recording, from_tick, to_tick, [index for _, index in chosen])
        t = np.asarray((ticks - span.first_tick) * recording.period_s, np.float64)
        columns = _named(chosen, read, tables)
        if made:
            exact = {name: columns[name].astype(np.float64) for name in parts}
            columns |= {name: in_precision(computed(one, exact, lengths, t.size)) for name, one in made.items()}
            columns = {name: columns[name] for name in names}
        yield Samples(span.first_tick, t, columns)


def read_envelope(
    session: Session,
    run_id: int,
    points: int,
    names: Sequence[str] = (),
    from_s: float = 0.0,
    to_s: float = np.inf,
) -> Envelope:
    """Return at most about ``points`` buckets over from_s <= t < to_s; short slices have one bucket per sample.

    Buckets longer than the stored summaries' are made of these, without reading the samples. Signals that follow from
    the columns (``recording.following``) are taken too. Raises like ``read_samples``, and ValueError for fewer than one
    point.
    """
    if points < 1:
        raise ValueError(f"points = {points} is out of range: it must be at least 1")
    recording, span = recordings.get(session, run_id), recordings.span(session, run_id)
    made = following(session, names)
    combined = list(made.values())
    stored = [name for name in names if name not in made]
    # no names mean all columns, and those of combined signals alone mean none
    chosen = [] if combined and not stored else _columns(recording, stored)
    indices = [index for _, index in chosen]
    from_tick, to_tick = _ticks(recording, span, from_s, to_s)
    width = max(1, -(-(to_tick - from_tick) // points))
    if width < BUCKET_TICKS:
        ticks, tables = _raw(session, recording, from_tick, to_tick, indices)
        low = high = tables
    else:
        width = -(-width // BUCKET_TICKS) * BUCKET_TICKS
        ticks, low, high = _summarised(session, recording, from_tick, to_tick, indices)
    first = (from_tick - span.first_tick) // width
    last = -(-(to_tick - span.first_tick) // width)
    buckets = (ticks - span.first_tick) // width - first
    low, high = _gathered(np.fmin, low, buckets, last - first), _gathered(np.fmax, high, buckets, last - first)
    minimum, maximum = (_named(chosen, stored or [name for name, _ in chosen], part) for part in (low, high))
    if combined:
        edges = span.first_tick + width * np.arange(first, last + 1)
        extremes = combined_envelope(session, recording, combined, (from_tick, to_tick), edges)
        for of_all, table in zip((minimum, maximum), extremes, strict=True):
            of_all.update({one.name: table[:, i] for i, one in enumerate(combined)})
    return Envelope(
        first_tick=span.first_tick,
        width_s=width * recording.period_s,
        t=np.asarray(np.arange(first, last) * width * recording.period_s, np.float64),
        minimum={name: minimum[name] for name in names or minimum},
        maximum={name: maximum[name] for name in names or maximum},
        units={name: made[name].unit if name in made else UNIT_OF[name] for name in names or minimum},
    )


def _columns(recording: Recording, names: Sequence[str]) -> list[tuple[str, int]]:
    unknown = [name for name in names if name not in recording.fields and name not in ADDED_LATER]
    if unknown:
        raise UnknownSignalError(
            f"no signal {', '.join(unknown)} in this recording; it has {', '.join(recording.fields)}"
        )
    return [(name, recording.fields.index(name)) for name in names or recording.fields if name in recording.fields]


def _named(chosen: list[tuple[str, int]], names: Sequence[str], table: Table) -> dict[str, Column]:
    """Columns by name in the order asked for; nan for what the recording, of an earlier version, lacks."""
    recorded = {name: table[:, i] for i, (name, _) in enumerate(chosen)}
    return {name: recorded.get(name, np.full(len(table), np.nan, np.float32)) for name in names or recorded}


def _ticks(recording: Recording, span: Span, from_s: float, to_s: float) -> tuple[int, int]:
    """Ticks [from, to) of the slice, within the recording."""
    last_s = (span.end_tick - span.first_tick) * recording.period_s
    # Half a period of tolerance: 0.3 s is tick 300, although 0.3 / 0.001 falls just below.
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


def _summarised(
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
        # A stored bucket that the slice cuts counts where the slice begins.
        ticks.append(np.maximum(begins, from_tick)[inside])
        lows.append(low.reshape(begins.size, -1)[inside])
        highs.append(high.reshape(begins.size, -1)[inside])
    return np.concatenate(ticks), np.concatenate(lows), np.concatenate(highs)


def _gathered(extreme: np.ufunc, table: Table, buckets: NDArray[np.int64], count: int) -> Table:
    gathered = np.full((count, table.shape[1]), np.nan, np.float32)
    if len(table):
        starts = np.flatnonzero(np.diff(buckets, prepend=-1))
        gathered[buckets[starts]] = extreme.reduceat(table, starts, axis=0)
    return gathered
