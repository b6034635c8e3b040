"""Recorded references as the parts of an experiment, steps, holds and ramps that follow them closely. Pure."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.experiments.composing.numbers import LONGEST_PART_S
from backend.experiments.composing.refused import ExperimentError
from backend.loop.program import MAX_SEGMENTS
from plant.interface import T_s

Column = NDArray[np.float64]

WITHIN_Q_RAD = 1e-3
WITHIN_S = 0.02
"""How far a straight way may be off the recorded references at any tick [rad, N·m/rad]."""

_SAME = 2e-3
"""Of a bound: numbers that are off by less are the same, but for how they were written."""
_DECIMALS = 6
"""Of what is written, in SI: finer than a bound, and short."""
_LEAST, _MOST = 10, round(LONGEST_PART_S / T_s)
"""Ticks of the shortest and the longest part that an experiment may have."""


class Followed(NamedTuple):
    """Parts that follow recorded references, and how far they are off them at most."""

    parts: list[dict[str, Any]]
    off_q_rad: float
    off_S: float


def followed(q_ref: Column, S_ref: Column) -> Followed:
    """Return parts that bring the references, tick by tick, to where these are.

    Where a jump and a way come closer together than a part can be short they are off by more than the bounds: how far
    is told. Raises ExperimentError for no references, and for more parts than an experiment can have.
    """
    there = np.isfinite(q_ref) & np.isfinite(S_ref)
    if not there.any():
        raise ExperimentError("it has no references: nothing was commanded that could be played again")
    first, end = int(np.argmax(there)), len(there) - int(np.argmax(there[::-1]))
    q, S = q_ref[first:end], S_ref[first:end]
    if not there[first:end].all():
        raise ExperimentError("its references have a gap: what was commanded within it is not known")
    parts: list[dict[str, Any]] = []
    off, at, reached = (0.0, 0.0), 0, (np.nan, np.nan)
    while at < len(q):
        held = end = _held(q, S, at)
        ramp = False
        for within in (_SAME, 1.0):  # what was a ramp is one again; what was none is followed by several
            if end - at < _LEAST and at > 0:
                end = _ramped(q, S, at, reached, within)
                ramp = end - at >= _LEAST
        end = min(max(end if ramp else held, at + _LEAST), at + _MOST)
        last = min(end, len(q)) - 1
        arrived = round(float(q[last]), _DECIMALS), round(float(S[last]), _DECIMALS)
        parts.append(_part("ramp" if ramp else "step", end - at, reached, arrived))
        share = np.arange(1, end - at + 1) / (end - at) if ramp else np.ones(end - at)
        off = _off(q, at, share, reached[0], arrived[0], off[0]), _off(S, at, share, reached[1], arrived[1], off[1])
        at, reached = end, arrived
        if len(parts) > MAX_SEGMENTS:
            raise ExperimentError(
                f"its references take more than {MAX_SEGMENTS} holds and ramps, as many as an experiment can have: "
                "compose it of parts"
            )
    return Followed(parts, *off)


def _part(do: str, ticks: int, before: Sequence[float], after: Sequence[float]) -> dict[str, Any]:
    named = {name: new for name, old, new in zip(("q_ref", "S_ref"), before, after, strict=True) if new != old}
    return {"do": do if named else "hold", **named, "duration_s": round(ticks * T_s, 3)}


def _off(column: Column, at: int, share: Column, before: float, after: float, most: float) -> float:
    """Return how far a part is off at most, or ``most`` where that is more."""
    recorded = column[at : at + len(share)]
    way = after - (1.0 - share[: len(recorded)]) * (0.0 if np.isnan(before) else after - before)
    return max(most, float(np.max(np.abs(way - recorded))))


def _held(q: Column, S: Column, at: int) -> int:
    """Return the end of the ticks from ``at`` on that stay where it is."""
    off = (np.abs(q[at:] - q[at]) > _SAME * WITHIN_Q_RAD) | (np.abs(S[at:] - S[at]) > _SAME * WITHIN_S)
    return at + int(np.argmax(off)) if off.any() else len(q)


def _ramped(q: Column, S: Column, at: int, reached: Sequence[float], share: float) -> int:
    """Return the end of the longest straight way from where the tick before ``at`` left the references.

    The slopes that pass every tick within ``share`` of its bound form a cone, which narrows; the way ends at the last
    tick that lies in it itself. Looked at is twice as much as long as all of it does.
    """
    span = 64
    while True:
        ticks = np.arange(1, min(span, len(q) - at) + 1)
        inside = np.ones(len(ticks), bool)
        open_still = True
        for column, start, within in ((q, reached[0], WITHIN_Q_RAD), (S, reached[1], WITHIN_S)):
            slopes = (column[at : at + len(ticks)] - start) / ticks
            low = np.maximum.accumulate(slopes - share * within / ticks)
            high = np.minimum.accumulate(slopes + share * within / ticks)
            inside &= (slopes >= low) & (slopes <= high)
            open_still = open_still and bool(low[-1] <= high[-1])
        if not open_still or at + len(ticks) == len(q):
            ends = np.flatnonzero(inside)
            return at + int(ends[-1]) + 1 if len(ends) else at
        span *= 2
