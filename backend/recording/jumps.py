"""Where a recorded signal jumps: a change from one sample to the next before and after which it stands still.

So the begin of a ramp is none, and nor is any part of a sine. Only stretches whose summaries move are read.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from backend.recording.codec import BUCKET_TICKS
from backend.recording.reader import read_envelope, read_stretches
from backend.storage import Session, recordings

_MOST_BUCKETS = 1200
"""Of which all samples are read at once: a minute."""

_MOST_SUMMARIES = 12_000
"""Read at once: ten minutes. Whoever asks for the first jumps does not wait for those of the eighth hour."""


def jumps(session: Session, run_id: int, name: str) -> Iterator[float]:
    """Yield the times [s] of the first samples after each jump, from the run's first sample.

    Raises UnknownRecordError, UnknownSignalError.
    """
    period_s, span = recordings.get(session, run_id).period_s, recordings.span(session, run_id)
    whole_s = (span.end_tick - span.first_tick) * period_s
    piece_s, bucket_s = _MOST_SUMMARIES * BUCKET_TICKS * period_s, BUCKET_TICKS * period_s
    for begin_s in np.arange(0.0, whole_s, piece_s):
        end_s = begin_s + piece_s
        # what is stored of a bucket may reach into the next one, and is compared with the one before
        around = max(0.0, begin_s - 2.0 * bucket_s), end_s + bucket_s
        stretches = _moving(session, run_id, name, around, period_s)
        earlier = begin_s - 0.5 * period_s
        reads = [(max(0.0, from_s - 3.0 * period_s), to_s + 2.0 * period_s) for from_s, to_s in stretches]
        for (from_s, to_s), samples in zip(stretches, read_stretches(session, run_id, [name], reads), strict=True):
            found = samples.t[_jumped(samples.t, samples.columns[name], period_s)]
            inside = (found > max(earlier, from_s - 0.5 * period_s)) & (found < min(end_s, to_s) - 0.5 * period_s)
            yield from found[inside].tolist()


def _moving(
    session: Session, run_id: int, name: str, around: tuple[float, float], period_s: float
) -> list[tuple[float, float]]:
    """Return the stretches [from_s, to_s) of which the summaries say that the signal may change."""
    points = max(1, math.ceil((around[1] - around[0]) / (BUCKET_TICKS * period_s)))
    envelope = read_envelope(session, run_id, points, [name], *around)
    low, high = envelope.minimum[name], envelope.maximum[name]
    moving = low != high
    moving[1:] |= low[1:] != high[:-1]
    stretches = _stretches(np.flatnonzero(moving), reach=1)
    start_s = float(envelope.t[0]) if envelope.t.size else 0.0
    return [(start_s + begin * envelope.width_s, start_s + end * envelope.width_s) for begin, end in stretches]


def nth_jump(session: Session, run_id: int, name: str, number: int) -> tuple[float | None, int]:
    """Return when a signal jumps for the ``number``-th time [s], None where it does not; and how many were found."""
    found = list(islice(jumps(session, run_id, name), number))
    return (found[-1] if len(found) == number else None), len(found)


def _stretches(buckets: NDArray[np.int64], reach: int) -> Iterator[tuple[int, int]]:
    """Join buckets that follow each other, and ``reach`` behind them, to stretches [begin, end) of bounded length."""
    begin = end = -1
    for bucket in buckets.tolist():
        if bucket > end or bucket - begin >= _MOST_BUCKETS:
            if end > begin:
                yield begin, end
            begin = max(bucket, end)
        end = max(end, bucket + 1 + reach)
    if end > begin:
        yield begin, end


def _jumped(t: NDArray[np.float64], y: NDArray[np.float32], period_s: float) -> Sequence[int] | NDArray[np.int64]:
    if t.size < 4:
        return []
    step, next_to = np.diff(y), np.diff(t) < 1.5 * period_s
    still = (step == 0.0) & next_to
    moved = (step != 0.0) & np.isfinite(step) & next_to
    found: NDArray[np.int64] = np.flatnonzero(moved[1:-1] & still[:-2] & still[2:]) + 2
    return found
