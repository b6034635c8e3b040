"""Metrics of reference steps and of whole runs (definitions of method section 7). Pure."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.models import Phase, RunCriterion
from backend.realtime import Program, Segment, Shape, final_references
from plant import SIDES, ErrorCode, Side, SinewError, T_s

# Criteria ------------------------------------------------------------------------------------------
#
# Pass or fail of an experiment: criterion, bound, figure; and why one that was not measured is
# neither.


def ended_early(played_s: float, planned_s: float) -> str:
    """Return the reason that a run which ended before its program gives nothing to pass by."""
    return f"the run ended after {played_s:.1f} s of {planned_s:.1f} s"


def unseen(missed: int, early: str) -> str:
    """Return why a run was not seen whole: samples that its recording lacks, an early end; "" where it was."""
    return f"the recording lacks {missed} samples" if missed else early


def judge(
    name: str, title: str, relation: str, bound: float, figure: float | None, unit: str, reason: str = ""
) -> RunCriterion:
    """Judge one figure. With a ``reason`` why not all of it was measured it can fail and cannot pass."""
    if figure is None or math.isnan(figure):
        return RunCriterion(
            name=name,
            title=title,
            relation=relation,
            bound=bound,
            figure=None,
            unit=unit,
            passed=None,
            reason=reason or "the signal holds no number",
        )
    held = figure < bound if relation == "<" else figure > bound
    if held and reason:
        return RunCriterion(
            name=name, title=title, relation=relation, bound=bound, figure=figure, unit=unit, passed=None, reason=reason
        )
    return RunCriterion(
        name=name, title=title, relation=relation, bound=bound, figure=figure, unit=unit, passed=held, reason=reason
    )


# Rest ----------------------------------------------------------------------------------------------
#
# Whether there is anything to measure of a reference step: did it begin at rest, did it come to
# rest? Pure.
#
# A figure of a step is one only where the motion before was over when it began. Else it is a figure
# of both motions.


Array = NDArray[np.float64]

SETTLING_BAND = 0.02
"""A step has settled where the signal stays this near its reference, as a share of the step."""

BEGIN_BAND = 0.05
"""A step begins at rest where the signal was this near to where it steps from, as a share of the step."""

REST_S = 0.1
"""So long before a step [s] the signals must have rested: one that only passes by is not at rest."""

AT_REST = {"q": 0.01, "S": 0.05}
"""A signal that is to stay is at rest this near to its reference: q [rad], six counts of the paper's encoder; S
[N·m/rad], half of the least deviation that a criterion refuses."""

NO_NUMBER = "a sample of it holds no number"
NOT_SETTLED = "it was not within ±2 % of its reference when its time was over"
MOVED_AS_ITS_END_CAME = "it still moved when its time was over"
BOTH_STEP = "both references step at once"

_UNITS = {"q": "rad", "S": "N·m/rad"}


def motion_before(rising: Array) -> str:
    """Return why a step did not begin at rest, "" where it did.

    ``rising`` is the signal over the REST_S before the step and at its first sample, shape (N,), as a share of its way.
    """
    off = float(rising[np.argmax(np.abs(rising))])
    if abs(off) <= BEGIN_BAND:
        return ""
    if abs(rising[-1]) > BEGIN_BAND:
        return f"it began at {_percent(float(rising[-1]))} of its way: the motion before was not over"
    return f"it moved as it began, from {_percent(off)} of its way: the motion before was not over"


def way_left(rising: Array) -> str:
    """Return how far a step came that did not come to 90 % of its way."""
    return f"it came to {_percent(float(rising.max()))} of its way in its time"


def other_moving(signal: str, deviation: Array) -> str:
    """Return why a signal that should stay was not at rest, "" where it was; ``deviation`` is from its reference."""
    off = float(np.abs(deviation).max())
    if off <= AT_REST[signal]:
        return ""
    return (
        f"{signal} was {off:.2f} {_UNITS[signal]} from its reference as this step began: the motion before was not over"
    )


@dataclass(frozen=True)
class Missing:
    """A step of which a figure could not be measured: when it began [s], and why."""

    start_s: float
    reason: str


def in_words(missing: Sequence[Missing], of: int) -> str:
    """Return which of so many steps lack a figure and why the first one does; "" where none lacks it."""
    if not missing:
        return ""
    verb = "was" if len(missing) == 1 else "were"
    first = missing[0]
    return f"{len(missing)} of {of} steps {verb} not measured; the one at {first.start_s:g} s: {first.reason}"


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f} %".replace("-", "−")


# Steps ---------------------------------------------------------------------------------------------
#
# Reference steps of a program, and how one went, on measured signals (definitions of method section
# 7). Pure.
#
# Times in s from the start of the program, q in rad, S in N·m/rad.


STEADY_WINDOW_S = 0.5


@dataclass(frozen=True)
class ReferenceStep:
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

    step: ReferenceStep
    rise_s: float | None
    reach_s: float | None
    settling_s: float | None
    overshoot_percent: float | None
    steady_error: float | None
    cross_coupling: float | None
    reasons: Mapping[str, str]


def steps_of(program: Program, phases: Sequence[Phase]) -> tuple[ReferenceStep, ...]:
    """Return the reference steps of a program. The first segment leads in from wherever the joint is, so it is none."""
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


def step_metrics(
    t: Array, y: Array, step: ReferenceStep, before: Array | None = None, count: float = 0.0
) -> StepMetrics:
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


# Metrics -------------------------------------------------------------------------------------------
#
# Metrics of step experiments, on measured signals (definitions of method section 7). Pure.
#
# Times in s from the start of the program, q in rad, S in N·m/rad, tensions in N, voltages in V.
# What could not be measured (a step that began on its way, one that never reached 90 %, a signal
# that never settled) is told with its reason, and is never a number that looks like one.


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


class NoSamplesError(SinewError, ValueError):
    """There is nothing to compute from."""

    category = ErrorCode.NOT_NOW


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
    return TrackingMetrics(
        complete=played_s + slack_s >= planned_s,
        played_s=played_s,
        planned_s=planned_s,
        steps=steps,
        overall=overall,
        reasons=reasons,
    )


def _measured(columns: Columns, step: ReferenceStep, count: float) -> StepMetrics:
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


# Whole ---------------------------------------------------------------------------------------------
#
# Figures that every experiment has: the tensions and the voltage over the whole of it. Pure.


@dataclass(frozen=True, kw_only=True)
class Whole:
    """Over all samples of the program."""

    min_tension_N: float = figure("N", "Smallest tension", "of both load cells from the start of the program")
    max_tension_N: float = figure("N", "Largest tension", "of both load cells from the start of the program")
    peak_voltage_V: float = figure("V", "Peak voltage", "largest |u_A|, |u_B| after limits")


def whole(columns: Columns) -> dict[str, float]:
    """Measure it, by name."""
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    return {
        "min_tension_N": float(tensions.min()),
        "max_tension_N": float(tensions.max()),
        "peak_voltage_V": float(np.abs(np.concatenate([columns["u_A"], columns["u_B"]])).max()),
    }


# Windows -------------------------------------------------------------------------------------------
#
# Where in a program something acts on the actuator: pushes, loads, excitations, as samples from its
# start. Pure.


_STILL = 1e-12
"""A reference that is nearer to where it was has not moved: the rest is rounding."""


class LoadStep(NamedTuple):
    """A load of one motor's shaft that steps on or off, and the samples until a load steps again."""

    side: Side
    window: slice
    on: bool


class Excited(NamedTuple):
    """An excitation of one reference, "q" or "S"; ``period`` is None for a sweep, which has none."""

    signal: str
    window: slice
    period: int | None


def timed(program: Program) -> Iterator[tuple[int, int, Segment]]:
    """Give each segment with its first sample and the one after its last."""
    start = 0
    for segment in program.segments:
        end = start + round(segment.duration_s / T_s)
        yield start, end, segment
        start = end


def load_steps(program: Program) -> tuple[LoadStep, ...]:
    """Return the steps of the loads, in order."""
    found: list[tuple[Side, int, bool]] = []
    before: dict[Side, float] = dict.fromkeys(SIDES, 0.0)
    for start, _, segment in timed(program):
        now: dict[Side, float] = {"A": segment.load_A, "B": segment.load_B}
        found += [(side, start, abs(now[side]) > abs(before[side])) for side in SIDES if now[side] != before[side]]
        before = now
    starts = sorted({start for _, start, _ in found})
    ends = dict(zip(starts, [*starts[1:], round(program.duration_s / T_s)], strict=False))
    return tuple(LoadStep(side, slice(start, ends[start]), on) for side, start, on in found)


def find_pushes(program: Program) -> tuple[slice, ...]:
    """Return the stretches over which the joint is pushed."""
    found: list[slice] = []
    for start, end, segment in timed(program):
        if not segment.F_push:
            continue
        if found and found[-1].stop == start:
            found[-1] = slice(found[-1].start, end)
        else:
            found.append(slice(start, end))
    return tuple(found)


def excitations(program: Program) -> tuple[Excited, ...]:
    """Return where one of the references alone is excited by a known spectrum."""
    found: list[Excited] = []
    q, S = 0.0, 0.0
    for start, end, segment in timed(program):
        if segment.shape not in (Shape.SWEEP, Shape.PRBS, Shape.MULTISINE):
            q, S = final_references(segment, q, S)
            continue
        moved = [name for name, by in (("q", segment.q_ref - q), ("S", segment.S_ref - S)) if abs(by) > _STILL]
        if len(moved) == 1:
            found.append(Excited(moved[0], slice(start, end), _period(segment)))
    return tuple(found)


def undisturbed_from(program: Program, at: int) -> int:
    """Return the sample up to which nothing acts and no reference moves from ``at`` on."""
    held, until = (0.0, 0.0), at
    for _, end, segment in timed(program):
        if end <= at:
            held = final_references(segment, *held)
            continue
        acts = segment.F_push or segment.load_A or segment.load_B or segment.shape is not Shape.STEP
        if acts or (segment.q_ref, segment.S_ref) != held:
            break
        until = end
    return until


def _period(segment: Segment) -> int | None:
    if segment.shape is Shape.SWEEP:
        return None
    chips = 2**segment.count - 1 if segment.shape is Shape.PRBS else 1
    return round(segment.period_s / T_s) * chips
