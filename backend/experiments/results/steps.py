"""Reference steps of a program, and how one went, on measured signals (definitions of method section 7). Pure.

Times in s from the start of the program, q in rad, S in N·m/rad.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.experiments.results.rest import (
    MOVED_AS_ITS_END_CAME,
    NO_NUMBER,
    NOT_SETTLED,
    SETTLING_BAND,
    motion_before,
    way_left,
)
from backend.models.run import Phase
from backend.realtime.program import Program, Shape

Array = NDArray[np.float64]

STEADY_WINDOW_S = 0.5


@dataclass(frozen=True)
class Step:
    """One reference step: ``signal`` is "q" or "S"; ``alone`` when the other reference stays where it is."""

    signal: str
    phase: str
    start_s: float
    end_s: float
    before: float
    after: float
    alone: bool


@dataclass(frozen=True)
class StepMetrics:
    """How one step went.

    ``rise_s`` 10-90 %; ``reach_s`` from the step to 90 %; ``settling_s`` last exit from ±2 % of the step around the new
    reference, all three to half a count; ``overshoot_percent`` of the step; ``steady_error`` mean of signal minus
    reference over the last half second; ``cross_coupling`` largest deviation of the other signal from its reference,
    for a step that moves alone. What could not be measured has its reason in ``reasons``, by name: it is None, or of a
    largest value what was seen of it, so that it is at least that.
    """

    step: Step
    rise_s: float | None
    reach_s: float | None
    settling_s: float | None
    overshoot_percent: float | None
    steady_error: float | None
    cross_coupling: float | None
    reasons: Mapping[str, str]


def steps_of(program: Program, phases: Sequence[Phase]) -> tuple[Step, ...]:
    """Return the reference steps of a program. The first segment leads in from wherever the joint is, so it is none."""
    steps: list[Step] = []
    start = program.segments[0].duration_s
    for before, segment in zip(program.segments, program.segments[1:], strict=False):
        end = start + segment.duration_s
        moves = {"q": (before.q_ref, segment.q_ref), "S": (before.S_ref, segment.S_ref)}
        moving = [signal for signal, (old, new) in moves.items() if old != new]
        if segment.shape is Shape.STEP and before.shape is not Shape.SINE:
            phase = next(item.name for item in phases if item.start_s <= start + 1e-9 < item.end_s)
            steps += [Step(signal, phase, start, end, *moves[signal], alone=len(moving) == 1) for signal in moving]
        start = end
    return tuple(steps)


def step_metrics(t: Array, y: Array, step: Step, before: Array | None = None, count: float = 0.0) -> StepMetrics:
    """Measure one step on its own samples, ``t`` and ``y`` of shape (N,), first tick to before the next step.

    ``before`` holds the signal just before the step, shape (M,): one that still moves there begins no step to measure.

    ``count`` is the resolution of ``y``. A reading tells to half a count, and so much counts in favour of the signal:
    else rounding would decide where a bound lies on a count, as 90 % of π/3 do with 4000 counts.
    """
    way = step.after - step.before
    rising = (y - step.before) / way
    margin = 0.5 * count / abs(way)
    begun = rising[:1] if before is None else np.append((before - step.before) / way, rising[0])
    moving = motion_before(begun) if np.isfinite(rising).all() else NO_NUMBER
    t_10, t_90 = (None if moving else _first_crossing(t, rising, level - margin) for level in (0.1, 0.9))
    settling_s = None if moving else _settling(t - step.start_s, rising, SETTLING_BAND + margin)
    beyond = max(0.0, float(rising.max() - 1.0))
    last = y[t >= t[-1] - STEADY_WINDOW_S]
    steady = float(np.ptp(last)) <= SETTLING_BAND * abs(way) + count
    too_short = "" if t_90 is not None else moving or way_left(rising)
    unsettled = "" if settling_s is not None else moving or NOT_SETTLED
    reasons = {
        "rise_s": too_short,
        "reach_s": too_short,
        "settling_s": unsettled,
        "overshoot_percent": unsettled,
        "steady_error": "" if steady else MOVED_AS_ITS_END_CAME,
        "cross_coupling": too_short,
    }
    return StepMetrics(
        step=step,
        rise_s=None if t_10 is None or t_90 is None else t_90 - t_10,
        reach_s=None if t_90 is None else t_90 - step.start_s,
        settling_s=settling_s,
        overshoot_percent=None if unsettled and (moving or beyond <= SETTLING_BAND + margin) else 100.0 * beyond,
        steady_error=float(np.mean(last) - step.after) if steady else None,
        cross_coupling=None,
        reasons={name: reason for name, reason in reasons.items() if reason},
    )


def _first_crossing(t: Array, y: Array, level: float) -> float | None:
    above = np.flatnonzero(y >= level)
    if above.size == 0:
        return None
    k = int(above[0])
    if k == 0:
        return float(t[0])
    return float(t[k - 1] + (level - y[k - 1]) / (y[k] - y[k - 1]) * (t[k] - t[k - 1]))


def _settling(t: Array, rising: Array, band: float) -> float | None:
    outside = np.flatnonzero(np.abs(rising - 1.0) > band)
    if outside.size == 0:
        return 0.0
    last = int(outside[-1])
    return float(t[last + 1]) if last + 1 < t.size else None
