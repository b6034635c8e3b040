"""Signals of runs minus that of a reference, on its samples: as curves, and where they leave a tolerance band."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.archive.alignment import aligned
from backend.archive.comparison import chosen_runs
from backend.recording.derived_signals import following
from backend.recording.reader import read_samples
from backend.sample import UNIT_OF
from backend.schemas.comparison import Differences, DifferencesAsked, RunDifference
from backend.storage import recordings
from backend.storage.database import Database, Session
from backend.storage.orm import UnknownRecordError

Array = NDArray[np.float64]

_EXACT = 1e-3
"""Share of a period within which a sample is taken for that of the moment asked for."""


@dataclass(frozen=True)
class Curve:
    """A signal ``y`` [n] at times ``t`` [n] in s, about one ``period_s`` apart but where samples are missing."""

    t: Array
    y: Array
    period_s: float

    def at(self, times: Array) -> Array:
        """Return the values at ``times``, straight between neighbouring samples; nan where either is missing."""
        slack = _EXACT * self.period_s
        after = np.searchsorted(self.t, times - slack)
        there = np.minimum(after, self.t.size - 1)
        before = np.maximum(there - 1, 0)
        exact = np.abs(self.t[there] - times) <= slack
        length = self.t[there] - self.t[before]
        between = (after > 0) & (after < self.t.size) & (length < 1.5 * self.period_s)
        share = np.divide(times - self.t[before], length, out=np.zeros_like(times), where=length > 0.0)
        straight = self.y[before] + share * (self.y[there] - self.y[before])
        return np.where(exact, self.y[there], np.where(between, straight, np.nan))


@dataclass(frozen=True)
class Beside:
    """The reference on the grid of its own samples, and each other run on it, or why there is none of it."""

    reference: int
    unit: str
    period_s: float
    t: Array
    own: Array
    others: dict[int, Array]
    offsets: dict[int, float]
    reasons: dict[int, str]


def beside(session: Session, asked: DifferencesAsked) -> Beside:
    """Read a signal of all runs, onto the axis of the reference.

    Raises RefusalError, UnknownRecordError, UnknownSignalError.
    """
    numbers, reference = chosen_runs(asked)
    placed = aligned(session, numbers, reference, asked)
    own = _curve(session, reference, asked.signal)
    count = round(float(own.t[-1]) / own.period_s) + 1
    first, last = (min(count, int(np.ceil(s / own.period_s - 0.5))) for s in (asked.from_s, asked.to_s))
    grid = np.asarray(np.arange(first, last) * own.period_s, np.float64)
    others, reasons = {}, {}
    for number in numbers:
        if number == reference:
            continue
        offset_s = placed[number].offset_s
        if offset_s is None:
            others[number], reasons[number] = np.full(grid.size, np.nan), placed[number].reason
        else:
            others[number] = _curve(session, number, asked.signal).at(grid - offset_s)
            reasons[number] = ""
    offsets = {number: one.offset_s for number, one in placed.items() if one.offset_s is not None}
    made = following(session, [asked.signal])
    unit = made[asked.signal].unit if made else UNIT_OF[asked.signal]
    return Beside(reference, unit, own.period_s, grid, own.at(grid), others, offsets, reasons)


def samples_of(database: Database, run_ids: Sequence[int]) -> int:
    """Return how many samples runs have, all together."""
    with database.reading() as session:
        return sum(0 if one is None else one.count for _, one in recordings.of_runs(session, run_ids).values())


def differences(database: Database, asked: DifferencesAsked) -> Differences:
    """Return the differences of a signal to the reference. Raises as ``beside`` does."""
    with database.reading() as session:
        found = beside(session, asked)
    first = round(float(found.t[0]) / found.period_s) if found.t.size else 0
    width = max(1, -(-found.t.size // asked.points))
    buckets = (first + np.arange(found.t.size)) // width
    starts = np.flatnonzero(np.diff(buckets, prepend=-1))
    return Differences(
        reference=found.reference,
        signal=asked.signal,
        unit=found.unit,
        raw=width == 1,
        width_s=width * found.period_s,
        t=(buckets[starts] * width * found.period_s).tolist(),
        runs=[
            _difference(number, values - found.own, found, starts, asked.band)
            for number, values in found.others.items()
        ],
    )


def _curve(session: Session, run_id: int, signal: str) -> Curve:
    samples = read_samples(session, run_id, [signal])
    if samples.t.size == 0:
        raise UnknownRecordError(f"there is no recording of run {run_id}")
    period_s = recordings.get(session, run_id).period_s
    return Curve(samples.t, samples.columns[signal].astype(np.float64), period_s)


def _difference(run: int, apart: Array, found: Beside, starts: NDArray[np.int64], band: float) -> RunDifference:
    compared = np.isfinite(apart)
    count = int(np.count_nonzero(compared))
    outside = np.abs(apart) > band  # never where there is no number
    left = np.flatnonzero(outside)
    largest = None if count == 0 else int(np.nanargmax(np.abs(apart)))
    nothing = "" if count else "there is no moment of which both runs have a sample"
    return RunDifference(
        run=run,
        reason=found.reasons[run] or nothing,
        minimum=_numbers(np.fmin.reduceat(apart, starts) if starts.size else apart),
        maximum=_numbers(np.fmax.reduceat(apart, starts) if starts.size else apart),
        compared_s=count * found.period_s,
        missing_s=(apart.size - count) * found.period_s,
        left_at_s=float(found.t[left[0]]) if left.size else None,
        outside_s=left.size * found.period_s,
        longest_s=max((end - begin for begin, end in _unbroken(outside)), default=0) * found.period_s,
        largest=None if largest is None else float(apart[largest]),
        largest_at_s=None if largest is None else float(found.t[largest]),
    )


def _unbroken(outside: NDArray[np.bool_]) -> Iterator[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(outside.astype(np.int8), prepend=0, append=0))
    return zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _numbers(values: Array) -> list[float | None]:
    return [value if np.isfinite(value) else None for value in values.tolist()]
