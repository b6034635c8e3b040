"""Metrics of step experiments, on measured signals (definitions of method section 7). Pure.

Times in s from the start of the program, q in rad, S in N·m/rad, tensions in N, voltages in V. What cannot be told
(a step that never reached 90 %, a signal that never settled) is None, never a number that looks like one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.experiments.phase import Phase
from backend.loop.program import Program, Shape

Columns = Mapping[str, NDArray[np.float64]]
"""Samples by column name, equally long; ``t`` [s] counts from the start of the program."""

SETTLING_BAND = 0.02
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
    for a step that moves alone.
    """

    step: Step
    rise_s: float | None
    reach_s: float | None
    settling_s: float | None
    overshoot_percent: float
    steady_error: float
    cross_coupling: float | None


def figure(unit: str, label: str, definition: str) -> Any:
    """Declare a figure of a result with what its reader needs to know."""
    return field(metadata={"unit": unit, "label": label, "definition": definition})


@dataclass(frozen=True)
class Overall:
    """Figures over all samples of the program; a maximum over steps is None when not every step has a figure."""

    rise_q_s: float | None = figure("s", "Rise time of q", "longest 10-90 % time of all q steps")
    rise_S_s: float | None = figure("s", "Rise time of S", "longest 10-90 % time of all S steps")
    settling_q_s: float | None = figure(
        "s", "Settling time of q", "latest last exit from ±2 % of the step and half a count, q steps"
    )
    settling_S_s: float | None = figure("s", "Settling time of S", "latest last exit from ±2 % of the step, S steps")
    reach_q_s: float | None = figure(
        "s", "Largest q step to 90 %", "longest time from the step to 90 % of it, less half a count"
    )
    reach_bound_q_s: float | None = figure(
        "s",
        "Bound of the motors for it",
        "90 % of the same turn by one motor at full voltage, unloaded: K_m, T_m alone",
    )
    reach_ratio_q: float | None = figure("1", "Time over bound", "time to 90 % over the bound of the motors")
    overshoot_q_percent: float | None = figure("%", "Overshoot of q", "largest, in per cent of its step")
    overshoot_S_percent: float | None = figure("%", "Overshoot of S", "largest, in per cent of its step")
    deviation_S: float | None = figure("N·m/rad", "Stiffness deviation", "max |S − S_ref| while q alone steps")
    deviation_q: float | None = figure("rad", "Joint deviation", "max |q − q_ref| while S alone steps")
    rmse_q: float = figure("rad", "RMSE of q", "root mean square of q − q_ref, whole run, steps included")
    rmse_S: float = figure("N·m/rad", "RMSE of S", "root mean square of S − S_ref, whole run, steps included")
    min_tension_N: float = figure("N", "Smallest tension", "of both load cells from the start of the program")
    max_tension_N: float = figure("N", "Largest tension", "of both load cells from the start of the program")
    peak_voltage_V: float = figure("V", "Peak voltage", "largest |u_A|, |u_B| after limits")


@dataclass(frozen=True)
class TrackingMetrics:
    """``complete`` is False when the run ended before its program: figures then cover what was played."""

    complete: bool
    played_s: float
    planned_s: float
    steps: tuple[StepMetrics, ...]
    overall: Overall


class NoSamplesError(ValueError):
    """There is nothing to compute from."""


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


def step_metrics(t: NDArray[np.float64], y: NDArray[np.float64], step: Step, count: float = 0.0) -> StepMetrics:
    """Measure one step on its own samples, ``t`` and ``y`` of shape (N,), first tick to before the next step.

    ``count`` is the resolution of ``y``. A reading tells to half a count, and so much counts in favour of the signal:
    else rounding would decide where a bound lies on a count, as 90 % of π/3 do with 4000 counts.
    """
    rising = (y - step.before) / (step.after - step.before)
    margin = 0.5 * count / abs(step.after - step.before)
    t_10, t_90 = _first_crossing(t, rising, 0.1 - margin), _first_crossing(t, rising, 0.9 - margin)
    steady = t >= t[-1] - STEADY_WINDOW_S
    return StepMetrics(
        step=step,
        rise_s=None if t_10 is None or t_90 is None else t_90 - t_10,
        reach_s=None if t_90 is None else t_90 - step.start_s,
        settling_s=_settling(t - step.start_s, rising, SETTLING_BAND + margin),
        overshoot_percent=max(0.0, 100.0 * float(rising.max() - 1.0)),
        steady_error=float(np.mean(y[steady]) - step.after),
        cross_coupling=None,
    )


def tracking_metrics(
    columns: Columns,
    program: Program,
    phases: Sequence[Phase],
    reach_bound: Callable[[float], float] | None = None,
    q_count: float = 0.0,
) -> TrackingMetrics:
    """Measure every step that was played to its end, and the whole.

    ``columns`` holds t, q, q_ref, S, S_ref, F_A, F_B, u_A, u_B; ``reach_bound`` gives the time [s] that the motors need
    at least for 90 % of a q step [rad], ``q_count`` the joint encoder's resolution [rad], 0 where it is exact.
    Raises NoSamplesError when there are no samples.
    """
    t = columns["t"]
    if t.size == 0:
        raise NoSamplesError("the run holds no samples of its program")
    period_s = float(np.median(np.diff(t))) if t.size > 1 else 0.0
    played_s = float(t[-1]) + period_s
    planned_s = program.duration_s
    slack_s = 1.5 * period_s
    ended = [step for step in steps_of(program, phases) if step.end_s <= played_s + slack_s]
    steps = tuple(_measured(columns, step, q_count if step.signal == "q" else 0.0) for step in ended)
    return TrackingMetrics(
        played_s + slack_s >= planned_s, played_s, planned_s, steps, _overall(columns, steps, reach_bound)
    )


def _measured(columns: Columns, step: Step, count: float) -> StepMetrics:
    t = columns["t"]
    inside = slice(*np.searchsorted(t, [step.start_s - 1e-9, step.end_s - 1e-9]))
    result = step_metrics(t[inside], columns[step.signal][inside], step, count)
    if not step.alone:
        return result
    other = "S" if step.signal == "q" else "q"
    deviation = np.abs(columns[other][inside] - columns[f"{other}_ref"][inside])
    return StepMetrics(**{**vars(result), "cross_coupling": float(deviation.max())})


def _overall(columns: Columns, steps: Sequence[StepMetrics], reach_bound: Callable[[float], float] | None) -> Overall:
    def largest(signal: str, quantity: str) -> float | None:
        values = [getattr(item, quantity) for item in steps if item.step.signal == signal]
        known = [value for value in values if value is not None]
        return max(known) if known and (quantity == "cross_coupling" or len(known) == len(values)) else None

    reach, bound = _largest_turn(steps, reach_bound)
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    voltages = np.concatenate([columns["u_A"], columns["u_B"]])
    return Overall(
        rise_q_s=largest("q", "rise_s"),
        rise_S_s=largest("S", "rise_s"),
        settling_q_s=largest("q", "settling_s"),
        settling_S_s=largest("S", "settling_s"),
        reach_q_s=reach,
        reach_bound_q_s=bound,
        reach_ratio_q=None if reach is None or not bound else reach / bound,
        overshoot_q_percent=largest("q", "overshoot_percent"),
        overshoot_S_percent=largest("S", "overshoot_percent"),
        deviation_S=largest("q", "cross_coupling"),
        deviation_q=largest("S", "cross_coupling"),
        rmse_q=rms(columns["q"] - columns["q_ref"]),
        rmse_S=rms(columns["S"] - columns["S_ref"]),
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        peak_voltage_V=float(np.abs(voltages).max()),
    )


def _largest_turn(
    steps: Sequence[StepMetrics], reach_bound: Callable[[float], float] | None
) -> tuple[float | None, float | None]:
    """Time to 90 % of the largest q step that moves alone, the longest of equal ones, and its bound [s]."""
    turns = [
        (abs(item.step.after - item.step.before), item) for item in steps if item.step.signal == "q" and item.step.alone
    ]
    if not turns:
        return None, None
    largest = max(turn for turn, _ in turns)
    times = [item.reach_s for turn, item in turns if turn > largest - 1e-9]
    known = [time for time in times if time is not None]
    reach = max(known) if len(known) == len(times) else None
    return reach, None if reach_bound is None else reach_bound(largest)


def _first_crossing(t: NDArray[np.float64], y: NDArray[np.float64], level: float) -> float | None:
    above = np.flatnonzero(y >= level)
    if above.size == 0:
        return None
    k = int(above[0])
    if k == 0:
        return float(t[0])
    return float(t[k - 1] + (level - y[k - 1]) / (y[k] - y[k - 1]) * (t[k] - t[k - 1]))


def _settling(t: NDArray[np.float64], rising: NDArray[np.float64], band: float) -> float | None:
    outside = np.flatnonzero(np.abs(rising - 1.0) > band)
    if outside.size == 0:
        return 0.0
    last = int(outside[-1])
    return float(t[last + 1]) if last + 1 < t.size else None


def rms(error: NDArray[np.float64]) -> float:
    """Root mean square of an error [N,]."""
    return float(np.sqrt(np.mean(np.square(error))))
