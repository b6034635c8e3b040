"""Metrics of reference steps and of whole runs (definitions of method section 7)."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.analysis import messages
from backend.models import Phase, RunCriterion
from backend.realtime import Program, Segment, Shape, final_references
from plant import (
    SIDES,
    ErrorCode,
    Side,
    SinewError,
    T_s,
)

# Criteria ------------------------------------------------------------------------------------------
# A criterion passes, fails, or is not measured, with a reason.


def format_early_end(played_s: float, planned_s: float) -> str:
    """Return the reason why a run that ended early passes no criterion."""
    return messages.run_ended_early(played_s=played_s, planned_s=planned_s)


def format_incomplete(missed: int, early: str) -> str:
    """Return why a recording is incomplete: missing samples or an early end; empty if it is complete."""
    return messages.samples_missing(missed=missed) if missed else early


def evaluate_criterion(
    name: str, title: str, relation: str, bound: float, figure: float | None, unit: str, reason: str = ""
) -> RunCriterion:
    """Evaluate one criterion. With a ``reason`` why the metric is incomplete, it can fail but not pass."""
    if figure is None or math.isnan(figure):
        return RunCriterion(
            name=name,
            title=title,
            relation=relation,
            bound=bound,
            figure=None,
            unit=unit,
            passed=None,
            reason=reason or messages.signal_without_value(),
        )
    holds = figure < bound if relation == "<" else figure > bound
    if holds and reason:
        return RunCriterion(
            name=name, title=title, relation=relation, bound=bound, figure=figure, unit=unit, passed=None, reason=reason
        )
    return RunCriterion(
        name=name, title=title, relation=relation, bound=bound, figure=figure, unit=unit, passed=holds, reason=reason
    )


# Rest ----------------------------------------------------------------------------------------------
# Whether a reference step began at rest and came to rest. A step that begins during the previous
# motion has no separate metrics.


Array = NDArray[np.float64]

SETTLING_BAND = 0.02
"""Settling band around the reference, as a fraction of the step."""

START_BAND = 0.05
"""Band around the initial value in which a signal is at rest before a step, as a fraction of the step."""

REST_BEFORE_S = 0.1
"""Time [s] before a step during which signals must be at rest; a single sample could be a zero crossing."""

REST_TOLERANCES = {"q": 0.01, "S": 0.05}
"""Largest deviation from the reference at rest: q [rad], six counts of the paper's encoder; S [N·m/rad], half of the
smallest deviation that a criterion rejects."""

_UNITS = {"q": "rad", "S": "N·m/rad"}


def check_rest_before(normalized: Array) -> str:
    """Return why a step did not begin at rest; empty if it did.

    ``normalized`` (N,) is the signal during REST_BEFORE_S before the step and at its first sample, as a fraction of the
    step.
    """
    off = float(normalized[np.argmax(np.abs(normalized))])
    if abs(off) <= START_BAND:
        return ""
    if abs(normalized[-1]) > START_BAND:
        return messages.began_away_from_start(share=float(normalized[-1]))
    return messages.moved_at_start(share=off)


def check_other_at_rest(signal: str, deviation: Array) -> str:
    """Return why the other signal was not at rest; empty if it was. ``deviation`` is from its reference."""
    off = float(np.abs(deviation).max())
    if off <= REST_TOLERANCES[signal]:
        return ""
    return messages.other_signal_moved(signal=signal, deviation=off, unit=_UNITS[signal])


@dataclass(frozen=True)
class Missing:
    """A step without a metric: its start [s] and the reason."""

    start_s: float
    reason: str


def format_missing(missing: Sequence[Missing], of: int) -> str:
    """Return how many of ``of`` steps lack a metric, and why the first one does; empty if none does."""
    if not missing:
        return ""
    first = missing[0]
    return messages.steps_not_measured(missing=len(missing), steps=of, start_s=first.start_s, reason=first.reason)


# Steps ---------------------------------------------------------------------------------------------
# Reference steps of a program and their metrics, from measured signals.
#
# Times in s from the start of the program, q in rad, S in N·m/rad.


STEADY_WINDOW_S = 0.5


@dataclass(frozen=True)
class ReferenceStep:
    """A reference step of ``signal`` "q" or "S"; ``alone``: the other reference is constant."""

    signal: str
    phase: str
    start_s: float
    end_s: float
    before: float
    after: float
    alone: bool


@dataclass(frozen=True)
class StepMetrics:
    """Metrics of one step.

    ``rise_s`` is from 10 % to 90 %, ``reach_s`` from the step to 90 %, ``settling_s`` the time until the signal stays
    within ±2 % of the step; all three to half a count. ``overshoot_percent`` is relative to the step, ``steady_error``
    the mean deviation in the last half second, ``cross_coupling`` the largest deviation of the other signal for a step
    alone. ``reasons`` states by name why a metric was not measured: the metric is None or, for a maximum, a lower
    bound.
    """

    step: ReferenceStep
    rise_s: float | None
    reach_s: float | None
    settling_s: float | None
    overshoot_percent: float | None
    steady_error: float | None
    cross_coupling: float | None
    reasons: Mapping[str, str]


def list_reference_steps(program: Program, phases: Sequence[Phase]) -> tuple[ReferenceStep, ...]:
    """Return the reference steps of a program, without the first segment, which starts from any position."""
    steps: list[ReferenceStep] = []
    start = program.segments[0].duration_s
    for before, segment in zip(program.segments, program.segments[1:], strict=False):
        end = start + segment.duration_s
        moves = {"q": (before.q_ref, segment.q_ref), "S": (before.S_ref, segment.S_ref)}
        moving = [signal for signal, (old, new) in moves.items() if old != new]
        if segment.shape is Shape.STEP and before.shape is not Shape.SINE:
            phase = next(item.name for item in phases if item.start_s <= start + 1e-9 < item.end_s)
            steps += [
                ReferenceStep(signal, phase, start, end, *moves[signal], alone=len(moving) == 1) for signal in moving
            ]
        start = end
    return tuple(steps)


def compute_step_metrics(
    t: Array, y: Array, step: ReferenceStep, before: Array | None = None, count: float = 0.0
) -> StepMetrics:
    """Compute the metrics of one step from its samples ``t`` and ``y`` (N,), up to the next step.

    ``before`` (M,) is the signal just before the step, to check that it begins at rest. ``count`` is the resolution of
    ``y``. Comparisons allow half a count in favour of the signal; otherwise rounding would decide if a bound coincides
    with a count, as 90 % of π/3 does with 4000 counts.
    """
    step_size = step.after - step.before
    normalized = (y - step.before) / step_size
    margin = 0.5 * count / abs(step_size)
    initial = normalized[:1] if before is None else np.append((before - step.before) / step_size, normalized[0])
    moving = check_rest_before(initial) if np.isfinite(normalized).all() else messages.sample_without_value()
    t_10, t_90 = (None if moving else _find_first_crossing(t, normalized, level - margin) for level in (0.1, 0.9))
    settling_s = None if moving else _compute_settling_time(t - step.start_s, normalized, SETTLING_BAND + margin)
    beyond = max(0.0, float(normalized.max() - 1.0))
    last = y[t >= t[-1] - STEADY_WINDOW_S]
    steady = float(np.ptp(last)) <= SETTLING_BAND * abs(step_size) + count
    too_short = "" if t_90 is not None else moving or messages.step_not_reached(share=float(normalized.max()))
    unsettled = "" if settling_s is not None else moving or messages.not_settled()
    reasons = {
        "rise_s": too_short,
        "reach_s": too_short,
        "settling_s": unsettled,
        "overshoot_percent": unsettled,
        "steady_error": "" if steady else messages.still_moving_at_end(),
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


def _find_first_crossing(t: Array, y: Array, level: float) -> float | None:
    above = np.flatnonzero(y >= level)
    if above.size == 0:
        return None
    k = int(above[0])
    if k == 0:
        return float(t[0])
    return float(t[k - 1] + (level - y[k - 1]) / (y[k] - y[k - 1]) * (t[k] - t[k - 1]))


def _compute_settling_time(t: Array, normalized: Array, band: float) -> float | None:
    outside = np.flatnonzero(np.abs(normalized - 1.0) > band)
    if outside.size == 0:
        return 0.0
    last = int(outside[-1])
    return float(t[last + 1]) if last + 1 < t.size else None


# Metrics -------------------------------------------------------------------------------------------
# Metrics over all steps of a run.
#
# Times in s from the start of the program, q in rad, S in N·m/rad, tensions in N, voltages in V. A
# metric that could not be measured is None and has a reason.


Columns = Mapping[str, NDArray[np.float64]]
"""Samples by column name, equally long; ``t`` [s] counts from the start of the program."""

LOWER_BOUND_METRICS = ("overshoot_percent", "cross_coupling")
"""Maxima that keep their value as a lower bound if some steps could not be measured."""

SETTLED_DELAY_S = 1.0
"""Time [s] after settling from which voltages count as those at rest."""

REST_MIN_S = 1.0
"""Least duration of rest [s]."""


def declare_metric(unit: str, label: str, definition: str) -> Any:
    """Declare a metric as a dataclass field with unit, label and definition."""
    return field(metadata={"unit": unit, "label": label, "definition": definition})


@dataclass(frozen=True)
class OverallMetrics:
    """Metrics of a whole run. A maximum over steps is None if a step lacks it, except LOWER_BOUND_METRICS."""

    rise_q_s: float | None = declare_metric("s", "Rise time of q", "longest 10–90 % rise time of all q steps")
    rise_S_s: float | None = declare_metric("s", "Rise time of S", "longest 10–90 % rise time of all S steps")
    settling_q_s: float | None = declare_metric(
        "s",
        "Settling time of q",
        "longest time until the signal stays within ±2 % of the step plus half a count, q steps",
    )
    settling_S_s: float | None = declare_metric(
        "s", "Settling time of S", "longest time until the signal stays within ±2 % of the step, S steps"
    )
    reach_q_s: float | None = declare_metric(
        "s",
        "Time to 90 % of the largest q step",
        "longest time to 90 %, less half a count, of the largest q steps at constant S_ref",
    )
    reach_bound_q_s: float | None = declare_metric(
        "s",
        "Lower bound from the motors",
        "time to 90 % of the same rotation by the slower motor, unloaded at full voltage, from K_m and T_m",
    )
    reach_ratio_q: float | None = declare_metric(
        "1", "Ratio to the lower bound", "time to 90 % divided by the lower bound from the motors; at least 1"
    )
    overshoot_q_percent: float | None = declare_metric(
        "%", "Overshoot of q", "largest overshoot, in percent of its step"
    )
    overshoot_S_percent: float | None = declare_metric(
        "%", "Overshoot of S", "largest overshoot, in percent of its step"
    )
    deviation_S: float | None = declare_metric(
        "N·m/rad", "Stiffness deviation", "max |S − S_ref| during steps of q alone"
    )
    deviation_q: float | None = declare_metric("rad", "Joint deviation", "max |q − q_ref| during steps of S alone")
    rmse_q: float = declare_metric("rad", "RMSE of q", "root mean square of q − q_ref, whole run, steps included")
    rmse_S: float = declare_metric("N·m/rad", "RMSE of S", "root mean square of S − S_ref, whole run, steps included")
    min_tension_N: float = declare_metric(
        "N", "Smallest tension", "smallest reading of both load cells from the start of the program"
    )
    max_tension_N: float = declare_metric(
        "N", "Largest tension", "largest reading of both load cells from the start of the program"
    )
    peak_voltage_V: float = declare_metric("V", "Peak voltage", "largest |u_A|, |u_B| after limiting")
    u_rest_rms_V: float | None = declare_metric(
        "V",
        "Voltage at rest",
        f"larger root mean square of u_A and u_B about their means, from {SETTLED_DELAY_S:g} s "
        "after settling to the end of each step",
    )


@dataclass(frozen=True)
class TrackingMetrics:
    """Tracking metrics of a run; ``complete`` is False if the run ended before its program.

    ``reasons`` states by name why an overall metric was not measured, or not for all steps.
    """

    complete: bool
    played_s: float
    planned_s: float
    steps: tuple[StepMetrics, ...]
    overall: OverallMetrics
    reasons: Mapping[str, str]


class NoSamplesError(SinewError, ValueError):
    """There are no samples to compute a metric from."""

    category = ErrorCode.NOT_NOW


def compute_tracking_metrics(
    columns: Columns,
    program: Program,
    phases: Sequence[Phase],
    reach_bound: Callable[[float], float] | None = None,
    q_count: float = 0.0,
) -> TrackingMetrics:
    """Compute the metrics of all completed steps and of the whole run.

    ``columns`` has t, q, q_ref, S, S_ref, F_A, F_B, u_A, u_B. ``reach_bound`` returns the least time [s] in which the
    motors can complete 90 % of a q step [rad]; ``q_count`` is the resolution of the joint encoder [rad], 0 if exact.
    Raises NoSamplesError.
    """
    t = columns["t"]
    if t.size == 0:
        raise NoSamplesError(messages.no_samples_of_program())
    period_s = float(np.median(np.diff(t))) if t.size > 1 else 0.0
    played_s = float(t[-1]) + period_s
    planned_s = program.duration_s
    slack_s = 1.5 * period_s
    ended = [step for step in list_reference_steps(program, phases) if step.end_s <= played_s + slack_s]
    steps = tuple(_measure_step(columns, step, q_count if step.signal == "q" else 0.0) for step in ended)
    overall, reasons = _compute_overall(columns, steps, reach_bound)
    return TrackingMetrics(
        complete=played_s + slack_s >= planned_s,
        played_s=played_s,
        planned_s=planned_s,
        steps=steps,
        overall=overall,
        reasons=reasons,
    )


def _measure_step(columns: Columns, step: ReferenceStep, count: float) -> StepMetrics:
    t = columns["t"]
    early, first, end = np.searchsorted(
        t, [step.start_s - REST_BEFORE_S - 1e-9, step.start_s - 1e-9, step.end_s - 1e-9]
    )
    y = columns[step.signal]
    result = compute_step_metrics(t[first:end], y[first:end], step, y[early:first], count)
    if not step.alone:
        return replace(result, reasons={**result.reasons, "cross_coupling": messages.both_references_step()})
    other = "S" if step.signal == "q" else "q"
    deviation = np.abs(columns[other] - columns[f"{other}_ref"])
    if not np.isfinite(deviation[early:end]).all():
        return replace(result, reasons={**result.reasons, "cross_coupling": messages.sample_without_value()})
    if moving := check_other_at_rest(other, deviation[early : first + 1]):
        return replace(result, reasons={**result.reasons, "cross_coupling": moving})
    return replace(result, cross_coupling=float(deviation[first:end].max()))


def _compute_overall(
    columns: Columns, steps: Sequence[StepMetrics], reach_bound: Callable[[float], float] | None
) -> tuple[OverallMetrics, dict[str, str]]:
    q, S = ([item for item in steps if item.step.signal == signal] for signal in "qS")
    q_alone, S_alone = ([item for item in moved if item.step.alone] for moved in (q, S))
    largest_turns = _select_largest_turns(q_alone)
    over_steps = {
        "rise_q_s": (q, "rise_s"),
        "rise_S_s": (S, "rise_s"),
        "settling_q_s": (q, "settling_s"),
        "settling_S_s": (S, "settling_s"),
        "reach_q_s": (largest_turns, "reach_s"),
        "overshoot_q_percent": (q, "overshoot_percent"),
        "overshoot_S_percent": (S, "overshoot_percent"),
        "deviation_S": (q_alone, "cross_coupling"),
        "deviation_q": (S_alone, "cross_coupling"),
    }
    reasons = {name: _format_reason(*arguments) for name, arguments in over_steps.items()}
    largest = {name: _select_largest(*arguments) for name, arguments in over_steps.items()}
    reach, bound = largest["reach_q_s"], None
    if largest_turns and reach_bound is not None:
        bound = reach_bound(abs(largest_turns[0].step.after - largest_turns[0].step.before))
    if bound is None:
        reasons["reach_bound_q_s"] = reasons["reach_q_s"] or messages.no_lower_bound_known()
    reasons["reach_ratio_q"] = reasons["reach_q_s"] or reasons.get("reach_bound_q_s", "")
    u_rest, reasons["u_rest_rms_V"] = _compute_voltage_at_rest(columns, steps)
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    voltages = np.concatenate([columns["u_A"], columns["u_B"]])
    overall = OverallMetrics(
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


def _select_largest(steps: Sequence[StepMetrics], quantity: str) -> float | None:
    values = [getattr(item, quantity) for item in steps]
    known = [value for value in values if value is not None]
    return max(known) if known and (quantity in LOWER_BOUND_METRICS or len(known) == len(values)) else None


def _format_reason(steps: Sequence[StepMetrics], quantity: str) -> str:
    if not steps:
        return messages.no_step_completed()
    missing = [Missing(item.step.start_s, item.reasons[quantity]) for item in steps if quantity in item.reasons]
    return format_missing(missing, len(steps))


def _select_largest_turns(alone: Sequence[StepMetrics]) -> list[StepMetrics]:
    """Return the largest q steps alone, which have equal size."""
    turns = [abs(item.step.after - item.step.before) for item in alone]
    return [item for turn, item in zip(turns, alone, strict=True) if turn > max(turns) - 1e-9]


def _compute_voltage_at_rest(columns: Columns, steps: Sequence[StepMetrics]) -> tuple[float | None, str]:
    """Return the larger rms [V] of both motors at rest, or the reason why there is none.

    Each interval is measured from its own mean, because a constant voltage holds the tension.
    """
    by_motor: dict[str, list[NDArray[np.float64]]] = {"u_A": [], "u_B": []}
    for start_s, end_s in dict.fromkeys((item.step.start_s, item.step.end_s) for item in steps):
        settled = [item.settling_s for item in steps if item.step.start_s == start_s]
        times = [time_s for time_s in settled if time_s is not None]
        if len(times) < len(settled) or end_s - (rest_s := start_s + max(times) + SETTLED_DELAY_S) < REST_MIN_S - 1e-9:
            continue
        inside = slice(*np.searchsorted(columns["t"], [rest_s - 1e-9, end_s - 1e-9]))
        for name, found in by_motor.items():
            u = columns[name][inside]
            found.append(u - u.mean())
    if not by_motor["u_A"]:
        return None, messages.no_rest_after_step(rest_s=REST_MIN_S, delay_s=SETTLED_DELAY_S)
    found_V = max(rms(np.concatenate(found)) for found in by_motor.values())
    return (found_V, "") if np.isfinite(found_V) else (None, messages.sample_without_value())


def rms(error: NDArray[np.float64]) -> float:
    """Return the root mean square of an error (N,)."""
    return float(np.sqrt(np.mean(np.square(error))))


# Whole run -----------------------------------------------------------------------------------------


@dataclass(frozen=True, kw_only=True)
class WholeMetrics:
    """Metrics that every experiment has, over all samples of the program."""

    min_tension_N: float = declare_metric(
        "N", "Smallest tension", "smallest reading of both load cells from the start of the program"
    )
    max_tension_N: float = declare_metric(
        "N", "Largest tension", "largest reading of both load cells from the start of the program"
    )
    peak_voltage_V: float = declare_metric("V", "Peak voltage", "largest |u_A|, |u_B| after limiting")


def compute_whole_metrics(columns: Columns) -> dict[str, float]:
    """Return the values of WholeMetrics by name."""
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    return {
        "min_tension_N": float(tensions.min()),
        "max_tension_N": float(tensions.max()),
        "peak_voltage_V": float(np.abs(np.concatenate([columns["u_A"], columns["u_B"]])).max()),
    }


# Windows -------------------------------------------------------------------------------------------
# Sample ranges of pushes, loads and excitations in a program.


_STILL = 1e-12
"""Smallest change of a reference; smaller ones are rounding errors."""


class LoadStep(NamedTuple):
    """A load step on one motor shaft, and the samples until the next load step."""

    side: Side
    window: slice
    on: bool


class ReferenceExcitation(NamedTuple):
    """An excitation of one reference, "q" or "S"; ``period`` is None for a sweep."""

    signal: str
    window: slice
    period: int | None


def iterate_segments(program: Program) -> Iterator[tuple[int, int, Segment]]:
    """Yield each segment with its first sample and the sample after its last one."""
    start = 0
    for segment in program.segments:
        end = start + round(segment.duration_s / T_s)
        yield start, end, segment
        start = end


def list_load_steps(program: Program) -> tuple[LoadStep, ...]:
    """Return the load steps in order."""
    found: list[tuple[Side, int, bool]] = []
    before: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
    for start, _, segment in iterate_segments(program):
        now: dict[Side, float] = {"A": segment.load_A, "B": segment.load_B}
        found += [(side, start, abs(now[side]) > abs(before[side])) for side in SIDES if now[side] != before[side]]
        before = now
    starts = sorted({start for _, start, _ in found})
    ends = dict(zip(starts, [*starts[1:], round(program.duration_s / T_s)], strict=False))
    return tuple(LoadStep(side, slice(start, ends[start]), on) for side, start, on in found)


def find_pushes(program: Program) -> tuple[slice, ...]:
    """Return the sample ranges in which the joint is pushed."""
    found: list[slice] = []
    for start, end, segment in iterate_segments(program):
        if not segment.F_push:
            continue
        if found and found[-1].stop == start:
            found[-1] = slice(found[-1].start, end)
        else:
            found.append(slice(start, end))
    return tuple(found)


def list_excitations(program: Program) -> tuple[ReferenceExcitation, ...]:
    """Return the excitations of a single reference."""
    found: list[ReferenceExcitation] = []
    q, S = 0.0, 0.0
    for start, end, segment in iterate_segments(program):
        if segment.shape not in (Shape.SWEEP, Shape.PRBS, Shape.MULTISINE):
            q, S = final_references(segment, q, S)
            continue
        moved = [name for name, by in (("q", segment.q_ref - q), ("S", segment.S_ref - S)) if abs(by) > _STILL]
        if len(moved) == 1:
            found.append(ReferenceExcitation(moved[0], slice(start, end), _get_period(segment)))
    return tuple(found)


def find_undisturbed_end(program: Program, at: int) -> int:
    """Return the first sample after ``at`` at which a disturbance or a change of reference begins."""
    references, until = (0.0, 0.0), at
    for _, end, segment in iterate_segments(program):
        if end <= at:
            references = final_references(segment, *references)
            continue
        acts = segment.F_push or segment.load_A or segment.load_B or segment.shape is not Shape.STEP
        if acts or (segment.q_ref, segment.S_ref) != references:
            break
        until = end
    return until


def _get_period(segment: Segment) -> int | None:
    if segment.shape is Shape.SWEEP:
        return None
    chips = 2**segment.count - 1 if segment.shape is Shape.PRBS else 1
    return round(segment.period_s / T_s) * chips
