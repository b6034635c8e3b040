"""Where a recorded signal jumps: a change from one sample to the next before and after which it stands still.

So the begin of a ramp is none, and nor is any part of a sine. Only stretches whose summaries move are read.
"""

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from backend.recording.codec import BUCKET_TICKS
from backend.recording.reader import read_envelope, read_samples
from backend.storage import Session, recordings

_MOST_BUCKETS = 1200
"""Read at once: a minute."""


def jumps(session: Session, run_id: int, name: str) -> Iterator[float]:
    """Yield the times [s] of the first samples after each jump, from the run's first sample.

    Raises UnknownRecordError, UnknownSignalError.
    """
    period_s, span = recordings.get(session, run_id).period_s, recordings.span(session, run_id)
    points = max(1, -(-(span.end_tick - span.first_tick) // BUCKET_TICKS))
    envelope = read_envelope(session, run_id, points, [name])
    low, high = envelope.minimum[name], envelope.maximum[name]
    moving = low != high
    moving[1:] |= low[1:] != high[:-1]
    # what is stored of a bucket may reach into the next one
    for begin, end in _stretches(np.flatnonzero(moving), reach=1):
        from_s, to_s = begin * envelope.width_s, end * envelope.width_s
        samples = read_samples(session, run_id, [name], max(0.0, from_s - 3.0 * period_s), to_s + 2.0 * period_s)
        found = samples.t[_jumped(samples.t, samples.columns[name], period_s)]
        inside = (found > from_s - 0.5 * period_s) & (found < to_s - 0.5 * period_s)
        yield from found[inside].tolist()


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
