"""Metrics of step experiments, on measured signals (definitions of method section 7). Pure.

Times in s from the start of the program, q in rad, S in N·m/rad, tensions in N, voltages in V. What could not be
measured (a step that began on its way, one that never reached 90 %, a signal that never settled) is told with its
reason, and is never a number that looks like one.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.experiments.results.rest import BOTH_STEP, NO_NUMBER, REST_S, Missing, in_words, other_moving
from backend.experiments.results.steps import Step, StepMetrics, step_metrics, steps_of
from backend.models.run import Phase
from backend.realtime.program import Program

Columns = Mapping[str, NDArray[np.float64]]
"""Samples by column name, equally long; ``t`` [s] counts from the start of the program."""

AT_LEAST = ("overshoot_percent", "cross_coupling")
"""What was seen of these stays a figure where some steps could not be measured: there may have been more, not less."""

SETTLED_S = 1.0
"""So long after a step has settled [s] the voltages are those of rest."""

LEAST_REST_S = 1.0
"""Shorter stretches are no rest [s]."""

NO_SUCH_STEP = "no such step was played to its end"


def figure(unit: str, label: str, definition: str) -> Any:
    """Declare a figure of a result with what its reader needs to know."""
    return field(metadata={"unit": unit, "label": label, "definition": definition})


@dataclass(frozen=True)
class Overall:
    """Figures over all samples of the program; a maximum over steps is None when not every step has a figure.

    Of overshoot and deviation, what was seen of them stays when not every step has a figure: they are at least that.
    """

    rise_q_s: float | None = figure("s", "Rise time of q", "longest 10-90 % time of all q steps")
    rise_S_s: float | None = figure("s", "Rise time of S", "longest 10-90 % time of all S steps")
    settling_q_s: float | None = figure(
        "s", "Settling time of q", "latest last exit from ±2 % of the step and half a count, q steps"
    )
    settling_S_s: float | None = figure("s", "Settling time of S", "latest last exit from ±2 % of the step, S steps")
    reach_q_s: float | None = figure(
        "s",
        "Largest q step alone, to 90 %",
        "longest time to 90 %, less half a count, of the largest q steps that are made while S_ref stays",
    )
    reach_bound_q_s: float | None = figure(
        "s",
        "Bound of the motors for it",
        "90 % of the same turn by one motor at full voltage, unloaded: K_m, T_m alone",
    )
    reach_ratio_q: float | None = figure(
        "1", "Times the bound of the motors", "time to 90 % divided by the bound of the motors; none can be below 1"
    )
    overshoot_q_percent: float | None = figure("%", "Overshoot of q", "largest, in per cent of its step")
    overshoot_S_percent: float | None = figure("%", "Overshoot of S", "largest, in per cent of its step")
    deviation_S: float | None = figure("N·m/rad", "Stiffness deviation", "max |S − S_ref| while q alone steps")
    deviation_q: float | None = figure("rad", "Joint deviation", "max |q − q_ref| while S alone steps")
    rmse_q: float = figure("rad", "RMSE of q", "root mean square of q − q_ref, whole run, steps included")
    rmse_S: float = figure("N·m/rad", "RMSE of S", "root mean square of S − S_ref, whole run, steps included")
    min_tension_N: float = figure("N", "Smallest tension", "of both load cells from the start of the program")
    max_tension_N: float = figure("N", "Largest tension", "of both load cells from the start of the program")
    peak_voltage_V: float = figure("V", "Peak voltage", "largest |u_A|, |u_B| after limits")
    u_rest_rms_V: float | None = figure(
        "V",
        "Voltage at rest",
        f"root mean square of u_A or u_B about its mean, the larger one, from {SETTLED_S:g} s after each step has "
        "settled to its end",
    )


@dataclass(frozen=True)
class TrackingMetrics:
    """``complete`` is False when the run ended before its program: figures then cover what was played.

    ``reasons`` tells by name which overall figures could not be measured, or not on all steps, and why.
    """

    complete: bool
    played_s: float
    planned_s: float
    steps: tuple[StepMetrics, ...]
    overall: Overall
    reasons: Mapping[str, str]


class NoSamplesError(ValueError):
    """There is nothing to compute from."""


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
    overall, reasons = _overall(columns, steps, reach_bound)
    return TrackingMetrics(played_s + slack_s >= planned_s, played_s, planned_s, steps, overall, reasons)


def _measured(columns: Columns, step: Step, count: float) -> StepMetrics:
    t = columns["t"]
    early, first, end = np.searchsorted(t, [step.start_s - REST_S - 1e-9, step.start_s - 1e-9, step.end_s - 1e-9])
    y = columns[step.signal]
    result = step_metrics(t[first:end], y[first:end], step, y[early:first], count)
    if not step.alone:
        return replace(result, reasons={**result.reasons, "cross_coupling": BOTH_STEP})
    other = "S" if step.signal == "q" else "q"
    deviation = np.abs(columns[other] - columns[f"{other}_ref"])
    if not np.isfinite(deviation[early:end]).all():
        return replace(result, reasons={**result.reasons, "cross_coupling": NO_NUMBER})
    if moving := other_moving(other, deviation[early : first + 1]):
        return replace(result, reasons={**result.reasons, "cross_coupling": moving})
    return replace(result, cross_coupling=float(deviation[first:end].max()))


def _overall(
    columns: Columns, steps: Sequence[StepMetrics], reach_bound: Callable[[float], float] | None
) -> tuple[Overall, dict[str, str]]:
    q, S = ([item for item in steps if item.step.signal == signal] for signal in "qS")
    q_alone, S_alone = ([item for item in moved if item.step.alone] for moved in (q, S))
    turned = _largest_turns(q_alone)
    over_steps = {
        "rise_q_s": (q, "rise_s"),
        "rise_S_s": (S, "rise_s"),
        "settling_q_s": (q, "settling_s"),
        "settling_S_s": (S, "settling_s"),
        "reach_q_s": (turned, "reach_s"),
        "overshoot_q_percent": (q, "overshoot_percent"),
        "overshoot_S_percent": (S, "overshoot_percent"),
        "deviation_S": (q_alone, "cross_coupling"),
        "deviation_q": (S_alone, "cross_coupling"),
    }
    reasons = {name: _why_not(*asked) for name, asked in over_steps.items()}
    largest = {name: _largest(*asked) for name, asked in over_steps.items()}
    reach, bound = largest["reach_q_s"], None
    if turned and reach_bound is not None:
        bound = reach_bound(abs(turned[0].step.after - turned[0].step.before))
    if bound is None:
        reasons["reach_bound_q_s"] = reasons["reach_q_s"] or "no bound is known for these motors"
    reasons["reach_ratio_q"] = reasons["reach_q_s"] or reasons.get("reach_bound_q_s", "")
    u_rest, reasons["u_rest_rms_V"] = _voltage_at_rest(columns, steps)
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    voltages = np.concatenate([columns["u_A"], columns["u_B"]])
    overall = Overall(
        **largest,
        reach_bound_q_s=bound,
        reach_ratio_q=None if reach is None or not bound else reach / bound,
        rmse_q=rms(columns["q"] - columns["q_ref"]),
        rmse_S=rms(columns["S"] - columns["S_ref"]),
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        peak_voltage_V=float(np.abs(voltages).max()),
        u_rest_rms_V=u_rest,
    )
    return overall, {name: reason for name, reason in reasons.items() if reason}


def _largest(steps: Sequence[StepMetrics], quantity: str) -> float | None:
    values = [getattr(item, quantity) for item in steps]
    known = [value for value in values if value is not None]
    return max(known) if known and (quantity in AT_LEAST or len(known) == len(values)) else None


def _why_not(steps: Sequence[StepMetrics], quantity: str) -> str:
    if not steps:
        return NO_SUCH_STEP
    missing = [Missing(item.step.start_s, item.reasons[quantity]) for item in steps if quantity in item.reasons]
    return in_words(missing, len(steps))


def _largest_turns(alone: Sequence[StepMetrics]) -> list[StepMetrics]:
    """Return the largest of the q steps that move alone, all of equal size."""
    turns = [abs(item.step.after - item.step.before) for item in alone]
    return [item for turn, item in zip(turns, alone, strict=True) if turn > max(turns) - 1e-9]


def _voltage_at_rest(columns: Columns, steps: Sequence[StepMetrics]) -> tuple[float | None, str]:
    """Return the rms [V] of the motor that moves more while references stay and all has settled, or why there is none.

    Each stretch counts from its own mean: what holds the tension is none of it.
    """
    apart: dict[str, list[NDArray[np.float64]]] = {"u_A": [], "u_B": []}
    for start_s, end_s in dict.fromkeys((item.step.start_s, item.step.end_s) for item in steps):
        settled = [item.settling_s for item in steps if item.step.start_s == start_s]
        times = [time_s for time_s in settled if time_s is not None]
        if len(times) < len(settled) or end_s - (rest_s := start_s + max(times) + SETTLED_S) < LEAST_REST_S - 1e-9:
            continue
        inside = slice(*np.searchsorted(columns["t"], [rest_s - 1e-9, end_s - 1e-9]))
        for name, found in apart.items():
            u = columns[name][inside]
            found.append(u - u.mean())
    if not apart["u_A"]:
        return None, f"no step was followed by {LEAST_REST_S:g} s of rest, {SETTLED_S:g} s after it had settled"
    found_V = max(rms(np.concatenate(found)) for found in apart.values())
    return (found_V, "") if np.isfinite(found_V) else (None, NO_NUMBER)


def rms(error: NDArray[np.float64]) -> float:
    """Root mean square of an error [N,]."""
    return float(np.sqrt(np.mean(np.square(error))))
