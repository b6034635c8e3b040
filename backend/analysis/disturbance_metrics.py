"""Metrics of disturbances: compliance, pushes, holds, impacts and loads."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.analysis import messages
from backend.analysis.context import EvaluationContext, PredictionUnavailableError
from backend.analysis.step_metrics import (
    REST_TOLERANCES,
    Columns,
    LoadStep,
    NoSamplesError,
    WholeMetrics,
    compute_whole_metrics,
    declare_metric,
    find_pushes,
    find_undisturbed_end,
    iterate_segments,
    rms,
)
from backend.faults import Limit
from backend.realtime import Program, Shape
from backend.tuning import INPUTS, OUTPUTS, disturbance_response, make_sampled_loop
from plant import (
    SIDES,
    Angle,
    PlantParameters,
    Side,
    T_s,
)

# Compliance ----------------------------------------------------------------------------------------
# Compares the apparent stiffness of the joint with the commanded one.
#
# The external force is F_ext = F_A − F_B (equation 22, a reaction). The expected force follows from
# geometry and commanded stiffness: F_expected = −S_ref q/r_j (equation 25).


Array = NDArray[np.float64]
ComplianceColumns = Mapping[str, Array]

COMPLIANCE_REST_S = 1.0
"""Duration of rest before the first push, whose mean is subtracted from the forces [s]."""

MAX_DELAY_S = 0.040
"""Largest delay of the load cells in the search [s]; the paper's have 10 to 15 ms."""

ALIGNED_RMSE_MAX_N = 0.5

PUSH_MIN_N = 5.0 * ALIGNED_RMSE_MAX_N
"""Push [N] below which the bound on the aligned error holds for any stiffness, so nothing is measured."""


@dataclass(frozen=True)
class ComplianceMetrics:
    """Metrics of a compliance run from the first push on; ``reasons`` by name for those not measured."""

    rmse_raw_N: float = declare_metric(
        "N", "RMSE, raw", "F_A − F_B relative to −S_ref q/r_j, as measured; paper: 2.239 N"
    )
    rmse_aligned_N: float | None = declare_metric(
        "N", "RMSE, aligned", "same as “RMSE, raw”, without the sensor delay and the means at rest"
    )
    rmse_estimated_N: float | None = declare_metric(
        "N", "RMSE, estimated", "F_ext_hat against F_B − F_A, without the sensor delay and the means at rest"
    )
    delay_s: float | None = declare_metric(
        "s", "Sensor delay", "delay of the load cells relative to the encoder that minimizes the RMSE"
    )
    stiffness_felt: float | None = declare_metric(
        "N·m/rad", "Apparent stiffness", "slope of −r_j (F_A − F_B) versus q, aligned"
    )
    largest_push_N: float = declare_metric("N", "Largest push", "largest |F_A − F_B|, aligned")
    deviation_S: float = declare_metric("N·m/rad", "Stiffness deviation", "max |S − S_ref| from the first push on")
    min_tension_N: float = declare_metric(
        "N", "Smallest tension", "smallest reading of both load cells from the start of the program"
    )
    max_tension_N: float = declare_metric(
        "N", "Largest tension", "largest reading of both load cells from the start of the program"
    )
    peak_voltage_V: float = declare_metric("V", "Peak voltage", "largest |u_A|, |u_B| after limiting")
    reasons: Mapping[str, str] = field(default_factory=dict)


def compute_compliance_metrics(columns: ComplianceColumns, r_j: float, first_push_s: float) -> ComplianceMetrics:
    """Compare measured and expected external force.

    ``columns`` has q, S, S_ref, F_A, F_B, u_A, u_B, one sample per millisecond, and possibly F_ext_hat, which is
    compared with the load cells. ``r_j`` [m] is the radius of the joint pulley. Raises NoSamplesError if the run ended
    before the first push, or without rest before it.
    """
    pushed = round(first_push_s / T_s)
    if pushed < round(COMPLIANCE_REST_S / T_s):
        raise NoSamplesError(messages.no_rest_before_push(start_s=first_push_s, rest_s=COMPLIANCE_REST_S))
    longest = round(MAX_DELAY_S / T_s)
    if columns["q"].size < pushed + 10 * longest:
        raise NoSamplesError(messages.ended_before_push(start_s=first_push_s))
    measured = columns["F_A"] - columns["F_B"]
    expected = -columns["S_ref"] * columns["q"] / r_j
    rest = slice(pushed - round(COMPLIANCE_REST_S / T_s), pushed)
    F = measured - measured[rest].mean()
    F_expected = expected - expected[rest].mean()
    errors = [rms(F[pushed + delay :] - F_expected[pushed : F.size - delay]) for delay in range(longest + 1)]
    delay = int(np.argmin(errors))
    applied, q = F[pushed + delay :], columns["q"][pushed : F.size - delay]
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    largest_push_N = float(np.abs(applied).max())
    reasons = _find_reasons(largest_push_N, delay == longest)
    estimated = _select_estimated_force(columns, rest, slice(pushed, F.size - delay))
    if estimated is None:
        reasons["rmse_estimated_N"] = messages.no_estimated_force()
    return ComplianceMetrics(
        rmse_raw_N=rms(measured[pushed:] - expected[pushed:]),
        rmse_aligned_N=None if "rmse_aligned_N" in reasons else errors[delay],
        rmse_estimated_N=None if estimated is None or "rmse_estimated_N" in reasons else rms(estimated + applied),
        delay_s=None if "delay_s" in reasons else delay * T_s,
        stiffness_felt=None if "stiffness_felt" in reasons else _compute_slope(q, -r_j * applied),
        largest_push_N=largest_push_N,
        deviation_S=float(np.abs(columns["S"] - columns["S_ref"])[pushed:].max()),
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        peak_voltage_V=float(np.abs(np.concatenate([columns["u_A"], columns["u_B"]])).max()),
        reasons=reasons,
    )


def _select_estimated_force(columns: ComplianceColumns, rest: slice, pushed: slice) -> Array | None:
    """Return the estimated external force [N] during pushes relative to rest; None without valid samples."""
    F_ext_hat = columns.get("F_ext_hat")
    if F_ext_hat is None or not np.all(np.isfinite(F_ext_hat[rest.start :])):
        return None
    estimated: Array = F_ext_hat[pushed] - F_ext_hat[rest].mean()
    return estimated


def _find_reasons(largest_push_N: float, delay_at_end: bool) -> dict[str, str]:
    if largest_push_N < PUSH_MIN_N:
        reason = messages.push_too_weak(
            largest_N=largest_push_N, minimum_N=PUSH_MIN_N, error_bound_N=ALIGNED_RMSE_MAX_N
        )
        return dict.fromkeys(("rmse_aligned_N", "rmse_estimated_N", "delay_s", "stiffness_felt"), reason)
    if delay_at_end:
        return {"delay_s": messages.delay_at_search_limit(limit_s=MAX_DELAY_S)}
    return {}


def _compute_slope(x: Array, y: Array) -> float:
    x, y = x - x.mean(), y - y.mean()
    spread = float(x @ x)
    return float(x @ y) / spread if spread > 0.0 else float("nan")


# Disturbance ---------------------------------------------------------------------------------------
# Deviation of position and stiffness during pushes, and the time until the joint has returned.


@dataclass(frozen=True, kw_only=True)
class DisturbanceMetrics(WholeMetrics):
    """Metrics over all pushes; ``reasons`` by name for those not measured."""

    push_deviation_q: float = declare_metric(
        "rad", "Joint deviation under pushes", "max |q − q_ref| while the joint is pushed"
    )
    push_deviation_S: float = declare_metric(
        "N·m/rad", "Stiffness deviation under pushes", "max |S − S_ref| while the joint is pushed"
    )
    push_back_s: float | None = declare_metric(
        "s",
        "Recovery time after a push",
        f"longest time from the end of a push until |q − q_ref| stays below {Angle(REST_TOLERANCES['q'])}",
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def compute_disturbance_metrics(columns: Columns, program: Program) -> DisturbanceMetrics:
    """Compute the metrics of pushes.

    ``columns`` has q, S, their references, tensions and voltages, one sample per millisecond. Raises NoSamplesError if
    the run ended before the end of the last push.
    """
    pushed = find_pushes(program)
    if not pushed or columns["q"].size < pushed[-1].stop:
        raise NoSamplesError(messages.pushes_not_completed() if pushed else messages.no_push())
    off_q, off_S = (np.abs(columns[name] - columns[f"{name}_ref"]) for name in ("q", "S"))
    times: list[float] = []
    reasons: dict[str, str] = {}
    for push in pushed:
        after = off_q[push.stop : min(find_undisturbed_end(program, push.stop), off_q.size)]
        if after.size == 0:
            reasons["push_back_s"] = messages.no_hold_after_push(end_s=push.stop * T_s)
            continue
        away = np.flatnonzero(~(after <= REST_TOLERANCES["q"]))
        if away.size and away[-1] == after.size - 1:
            reasons["push_back_s"] = messages.not_back_after_push(
                end_s=push.stop * T_s, deviation_rad=float(after[-1]), hold_s=after.size * T_s
            )
            continue
        times.append(0.0 if away.size == 0 else float(away[-1] + 1) * T_s)
    under = np.concatenate([np.arange(push.start, push.stop) for push in pushed])
    return DisturbanceMetrics(
        **compute_whole_metrics(columns),
        push_deviation_q=float(off_q[under].max()),
        push_deviation_S=float(off_S[under].max()),
        push_back_s=None if reasons or not times else max(times),
        reasons=reasons,
    )


# Holds ---------------------------------------------------------------------------------------------
# Motion of the actuator during holds. A hold is a range with the references of the segment before
# it, without push or load.


HOLD_MIN_S = 1.0
"""Least duration of a hold [s]."""

JOINT_STEP, MOTOR_STEP = 2.0 * math.pi / 4000.0, 2.0 * math.pi / 8000.0
"""Resolution of the paper's encoders [rad], used as unit for exact sensors."""


@dataclass(frozen=True)
class HoldWindow:
    """Measurements of one hold from ``start_s`` to ``end_s`` [s], at ``q_ref`` [rad] and ``S_ref`` [N·m/rad].

    Peak to peak: ``q_swing`` [rad], ``q_swing_counts``, ``S_swing`` [N·m/rad], and ``u_swing`` [V] of the motor with
    the larger one. ``off`` [rad] is the mean deviation from q_ref, ``off_counts`` the largest one; ``moving_percent``
    are ticks in which a motor encoder changed.
    """

    start_s: float
    end_s: float
    q_ref: float
    S_ref: float
    q_swing: float
    q_swing_counts: float
    off: float
    off_counts: float
    u_swing: float
    S_swing: float
    moving_percent: float


@dataclass(frozen=True, kw_only=True)
class HoldMetrics(WholeMetrics):
    """Largest values over all holds; ``reasons`` by name for those not measured."""

    held_q_swing_counts: float | None = declare_metric(
        "1",
        "Peak-to-peak q, in counts",
        "max − min of q during a hold, in counts of the joint encoder (4000 per turn for an ideal sensor)",
    )
    held_q_swing: float | None = declare_metric("rad", "Peak-to-peak q", "max − min of q during a hold")
    held_off_counts: float | None = declare_metric(
        "1",
        "Deviation from the reference, in counts",
        "max |q − q_ref| during a hold, minus half a count of the encoder",
    )
    held_u_swing_V: float | None = declare_metric("V", "Peak-to-peak voltage", "max − min of u_A or u_B during a hold")
    held_S_swing: float | None = declare_metric("N·m/rad", "Peak-to-peak S", "max − min of S during a hold")
    held_moving_percent: float | None = declare_metric(
        "%",
        "Motors moving",
        "share of the control steps of a hold in which the count of a motor's "
        "encoder changed (8000 per turn for an ideal sensor)",
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def compute_hold_metrics(columns: Columns, program: Program, parameters: PlantParameters) -> HoldMetrics:
    """Compute the metrics of holds.

    ``columns`` has q, S, references, motor angles, tensions and voltages, one sample per millisecond. Raises
    NoSamplesError without a complete hold.
    """
    found = measure_holds(columns, program, parameters)
    if not found:
        raise NoSamplesError(messages.no_hold_completed())
    worst = {
        "held_q_swing_counts": max(item.q_swing_counts for item in found),
        "held_q_swing": max(item.q_swing for item in found),
        "held_off_counts": max(item.off_counts for item in found),
        "held_u_swing_V": max(item.u_swing for item in found),
        "held_S_swing": max(item.S_swing for item in found),
        "held_moving_percent": max(item.moving_percent for item in found),
    }
    lost = dict.fromkeys(
        (name for name, value in worst.items() if not math.isfinite(value)), messages.sample_without_value()
    )
    values: dict[str, Any] = {name: None if name in lost else value for name, value in worst.items()}
    return HoldMetrics(**compute_whole_metrics(columns), **values, reasons=lost)


def find_hold_windows(program: Program) -> tuple[slice, ...]:
    """Return the sample ranges of the holds of a program."""
    found: list[slice] = []
    before: tuple[float, float] | None = None
    for start, end, segment in iterate_segments(program):
        references = segment.q_ref, segment.S_ref
        acts = segment.F_push or segment.load_A or segment.load_B or segment.shape is not Shape.STEP
        quiet = not acts and references == before and start > 0
        if quiet and found and found[-1].stop == start:
            found[-1] = slice(found[-1].start, end)
        elif quiet:
            found.append(slice(start, end))
        before = None if acts else references
    return tuple(item for item in found if (item.stop - item.start) * T_s >= HOLD_MIN_S)


def measure_holds(columns: Columns, program: Program, parameters: PlantParameters) -> tuple[HoldWindow, ...]:
    """Return the measurements of each complete hold."""
    size = columns["q"].size
    return tuple(_measure_hold(columns, item, parameters) for item in find_hold_windows(program) if item.stop <= size)


def _measure_hold(columns: Columns, window: slice, parameters: PlantParameters) -> HoldWindow:
    count, motor = parameters.sensors.joint_step or JOINT_STEP, parameters.sensors.motor_step or MOTOR_STEP
    of = {name: np.asarray(columns[name][window]) for name in ("q", "q_ref", "S", "u_A", "u_B", "theta_A", "theta_B")}
    granted = 0.5 if parameters.sensors.joint_step else 0.0  # resolution of a reading
    off = of["q"] - of["q_ref"]
    turned = [np.diff(np.rint(of[name] / motor)) != 0.0 for name in ("theta_A", "theta_B")]
    swing = float(np.ptp(of["q"]))
    return HoldWindow(
        start_s=float(columns["t"][window.start]),
        end_s=float(columns["t"][window.stop - 1]),
        q_ref=float(of["q_ref"][-1]),
        S_ref=float(columns["S_ref"][window.stop - 1]),
        q_swing=swing,
        q_swing_counts=swing / count,
        off=float(off.mean()),
        off_counts=max(float(np.abs(off).max()) / count - granted, 0.0),
        u_swing=float(max(np.ptp(of["u_A"]), np.ptp(of["u_B"]))),
        S_swing=float(np.ptp(of["S"])),
        moving_percent=100.0 * float((turned[0] | turned[1]).mean()),
    )


# Impact --------------------------------------------------------------------------------------------
# Force of impacts on the simulated obstacle, and the time until they are detected and the joint
# complies.


HIT_DISTANCE_S = 0.3
"""Interval from which contacts are separate hits; closer ones are bounces [s]."""

APPROACH_TIME_S = 0.05
"""Time before the contact in which the approach speed is measured [s]: 30 encoder counts at 1 rad/s."""

SPEED_TOLERANCE = 0.1
"""Largest relative difference of the approach speeds of hits that are compared."""

_S_TOLERANCE = 1e-6


class Hit(NamedTuple):
    """One hit with all bounces, from its first contact to the sample after the last one.

    ``S_ref`` [N·m/rad] and approach ``speed`` [rad/s] at the first contact; largest force [N], impulse [N·s] and time
    in contact [s]. ``contact_N`` [N] is the threshold of the contact reaction, nan without one. Times [s], nan if it
    did not happen: ``detection_s`` from the contact until the estimate exceeds the threshold, ``reaction_s`` and
    ``to_peak_s`` from there until the joint complies and until the force has its maximum.
    """

    window: slice
    S_ref: float
    speed: float
    peak_N: float
    impulse_Ns: float
    contact_s: float
    contact_N: float = math.nan
    detection_s: float = math.nan
    reaction_s: float = math.nan
    to_peak_s: float = math.nan

    @property
    def reacts(self) -> bool:
        """Whether a contact reaction was active."""
        return math.isfinite(self.contact_N)


@dataclass(frozen=True, kw_only=True)
class ImpactMetrics(WholeMetrics):
    """Metrics over all hits; ``reasons`` by name for those not measured."""

    hits: float = declare_metric("1", "Hits", "collisions with the obstacle at least 0.3 s after the previous one")
    peak_force_N: float = declare_metric("N", "Largest contact force", "largest |F_wall| of all hits")
    impulse_Ns: float = declare_metric(
        "N·s", "Largest impulse", "largest time integral of |F_wall| over a hit, bounces included"
    )
    soft_to_stiff_peak: float | None = declare_metric(
        "1",
        "Peak force ratio, soft to stiff",
        "mean over the speeds of the peak at the lowest S_ref divided by that at the highest",
    )
    soft_to_stiff_impulse: float | None = declare_metric(
        "1",
        "Impulse ratio, soft to stiff",
        "mean over the speeds of the impulse at the lowest S_ref divided by that at the highest",
    )
    reaction_peak: float | None = declare_metric(
        "1",
        "Peak force ratio, with to without reaction",
        "mean over stiffness and speed of the peak with reaction divided by that without",
    )
    reaction_impulse: float | None = declare_metric(
        "1",
        "Impulse ratio, with to without reaction",
        "mean over stiffness and speed of the impulse with reaction divided by that without",
    )
    felt_after_s: float | None = declare_metric(
        "s",
        "Longest detection time",
        "from the start of the collision until the estimated external force exceeds the threshold",
    )
    gave_way_after_s: float | None = declare_metric(
        "s", "Longest reaction time", "from the detection to the start of the contact reaction"
    )
    fell_after_s: float | None = declare_metric(
        "s", "Longest time to the peak", "from the detection until |F_wall| reaches its peak"
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def find_hits(columns: Columns, program: Program | None = None) -> tuple[Hit, ...]:
    """Return the hits of a run in order; empty without a hit or without a recorded force of the obstacle.

    ``program`` has the thresholds of the contact reaction; without it there is none.
    """
    force = np.abs(columns["F_wall"]) if "F_wall" in columns else np.empty(0)
    touched = np.flatnonzero(force > 0.0)
    if touched.size == 0:
        return ()
    parts = np.split(touched, np.flatnonzero(np.diff(touched) > round(HIT_DISTANCE_S / T_s)) + 1)
    thresholds_N = _list_thresholds(program, force.size)
    return tuple(_measure_hit(columns, force, part, thresholds_N) for part in parts)


def _list_thresholds(program: Program | None, samples: int) -> NDArray[np.float64]:
    """Return the threshold of the contact reaction [N] at each sample; nan without one."""
    thresholds_N, tick, contact_N = np.full(samples, np.nan), 0, 0.0
    for segment in program.segments if program is not None and program.contact_detections else ():
        if program is not None and segment.contact_detection:
            contact_N = program.contact_detections[segment.contact_detection - 1].contact_N
        after = tick + round(segment.duration_s / T_s)
        thresholds_N[tick:after] = contact_N or np.nan
        tick = after
    return thresholds_N


def _measure_hit(columns: Columns, force: np.ndarray, touched: np.ndarray, thresholds_N: np.ndarray) -> Hit:
    first, end = int(touched[0]), int(touched[-1]) + 1
    before = columns["q"][max(first - round(APPROACH_TIME_S / T_s), 0) : first]
    speed = abs(float(np.polyfit(np.arange(before.size) * T_s, before, 1)[0])) if before.size > 2 else float("nan")
    return Hit(
        slice(first, end),
        float(columns["S_ref"][first]),
        speed,
        float(force[first:end].max()),
        float(force[first:end].sum() * T_s),
        touched.size * T_s,
        *_measure_reaction(columns, force, slice(first, end), float(thresholds_N[first])),
    )


def _measure_reaction(columns: Columns, force: np.ndarray, window: slice, contact_N: float) -> tuple[float, ...]:
    """Return the threshold [N] and the times [s] to detection, reaction and largest force."""
    end = window.stop + round(HIT_DISTANCE_S / T_s)  # the detection may follow after the joint has bounced off
    detected = (
        _find_first(np.abs(columns["F_ext_hat"][window.start : end]) > contact_N) if math.isfinite(contact_N) else None
    )
    if detected is None:
        return contact_N, math.nan, math.nan, math.nan
    began = window.start + detected
    reaction = _find_first(columns["limits"][began:end].astype(np.int64) & int(Limit.CONTACT) != 0)
    largest = int(np.argmax(force[window])) - detected
    return (
        contact_N,
        detected * T_s,
        math.nan if reaction is None else reaction * T_s,
        math.nan if reaction is None else max(largest, 0) * T_s,
    )


def _find_first(holds: np.ndarray) -> int | None:
    return int(np.argmax(holds)) if holds.any() else None


def compute_impact_metrics(columns: Columns, program: Program | None = None) -> ImpactMetrics:
    """Compute the metrics of impacts.

    ``columns`` has F_wall, q, S_ref, tensions and voltages, one sample per millisecond, and F_ext_hat and limits if
    ``program`` reacts to contacts. Raises NoSamplesError without a hit.
    """
    hits = find_hits(columns, program)
    if not hits:
        raise NoSamplesError(messages.no_hit())
    plain, reacting = [hit for hit in hits if not hit.reacts], [hit for hit in hits if hit.reacts]
    pairs, reason = _pair_by_stiffness(plain or hits)
    paired, why = pair_hits(hits)
    no_reaction = "" if reacting else messages.contact_reaction_not_enabled()
    missed = sum(not math.isfinite(hit.reaction_s) for hit in reacting)
    if missed:
        no_reaction = messages.hits_without_reaction(missed=missed, hits=len(reacting))
    reasons = dict.fromkeys(("soft_to_stiff_peak", "soft_to_stiff_impulse"), reason)
    reasons |= dict.fromkeys(("reaction_peak", "reaction_impulse"), no_reaction or why)
    reasons |= dict.fromkeys(("felt_after_s", "gave_way_after_s", "fell_after_s"), no_reaction)
    paired = () if no_reaction else paired
    return ImpactMetrics(
        **compute_whole_metrics(columns),
        hits=float(len(hits)),
        peak_force_N=max(hit.peak_N for hit in hits),
        impulse_Ns=max(hit.impulse_Ns for hit in hits),
        soft_to_stiff_peak=_mean_or_none([soft.peak_N / stiff.peak_N for soft, stiff in pairs]),
        soft_to_stiff_impulse=_mean_or_none([soft.impulse_Ns / stiff.impulse_Ns for soft, stiff in pairs]),
        reaction_peak=_mean_or_none([reacted.peak_N / plain.peak_N for plain, reacted in paired]),
        reaction_impulse=_mean_or_none([reacted.impulse_Ns / plain.impulse_Ns for plain, reacted in paired]),
        felt_after_s=None if no_reaction else max(hit.detection_s for hit in reacting),
        gave_way_after_s=None if no_reaction else max(hit.reaction_s for hit in reacting),
        fell_after_s=None if no_reaction else max(hit.to_peak_s for hit in reacting),
        reasons={name: why for name, why in reasons.items() if why},
    )


def pair_hits(hits: Sequence[Hit]) -> tuple[tuple[tuple[Hit, Hit], ...], str]:
    """Return pairs of hits without and with reaction, of equal stiffness and speed, or the reason for none."""
    left, pairs = [hit for hit in hits if not hit.reacts], []
    for hit in (hit for hit in hits if hit.reacts):
        alike = [
            other for other in left if abs(other.S_ref - hit.S_ref) < _S_TOLERANCE and _is_equally_fast(other, hit)
        ]
        if not alike:
            return (), messages.hit_without_counterpart(S_ref=hit.S_ref, speed=hit.speed)
        other = min(alike, key=lambda other: abs(other.speed - hit.speed))
        left.remove(other)
        pairs.append((other, hit))
    return tuple(pairs), "" if pairs else messages.contact_reaction_not_enabled()


def _is_equally_fast(item: Hit, other: Hit) -> bool:
    return abs(item.speed - other.speed) <= SPEED_TOLERANCE * max(item.speed, other.speed)


def _pair_by_stiffness(hits: Sequence[Hit]) -> tuple[list[tuple[Hit, Hit]], str]:
    """Return pairs of hits at lowest and highest stiffness with equal speed, or the reason for none."""
    low, high = min(hit.S_ref for hit in hits), max(hit.S_ref for hit in hits)
    if high - low < _S_TOLERANCE:
        return [], messages.hits_of_equal_stiffness(S_ref=low)
    soft = [hit for hit in hits if hit.S_ref - low < _S_TOLERANCE]
    stiff = [hit for hit in hits if high - hit.S_ref < _S_TOLERANCE]
    if len(soft) != len(stiff):
        return [], messages.unequal_numbers_of_hits(soft=len(soft), stiff=len(stiff))
    for item, other in zip(soft, stiff, strict=True):
        if not _is_equally_fast(item, other):
            return [], messages.unequal_speeds_of_hits(soft=item.speed, stiff=other.speed)
    return list(zip(soft, stiff, strict=True)), ""


def _mean_or_none(ratios: Sequence[float]) -> float | None:
    return float(np.mean(ratios)) if ratios else None


# Pushes --------------------------------------------------------------------------------------------
# Deviation and duration of each push, with its prediction. Pushes may be steps, ramps or impulses.
# The prediction is the response of the closed loop with the active gains; the static deviation
# r_j F/S is that of the stiffness alone, with an open position loop.


IMPULSE_S = 0.05
"""Largest duration of an impulse [s]: about the period of the joint's own oscillation."""

PUSH_REST_S = 0.1
"""Duration before a push whose mean is subtracted from deviations [s]."""


class PushWindow(NamedTuple):
    """A push: its samples, its shape, and the sample up to which nothing else acts."""

    pushed: slice
    shape: str
    until: int


@dataclass(frozen=True)
class MeasuredPush:
    """Measurements of one push. Deviations of q [rad] and S [N·m/rad] are relative to the values before it.

    ``F`` [N] is the largest force, ``impulse`` [N·s], ``S`` [N·m/rad] the reference. ``back_s`` is the time from its
    end until the joint stays near its reference, None with a ``reason`` if it does not. ``static`` is r_j F/S.
    ``expected`` (n,) is the predicted deviation over the window, None with the reason ``unpredicted``.
    """

    window: PushWindow
    F: float
    impulse: float
    S: float
    peak_q: float
    peak_S: float
    back_s: float | None
    reason: str
    static: float
    expected: Array | None
    unpredicted: str

    @property
    def expected_peak(self) -> float | None:
        """Largest predicted deviation [rad]."""
        return None if self.expected is None else float(np.abs(self.expected).max())

    @property
    def off_percent(self) -> float | None:
        """Relative error of the predicted peak [%]."""
        peak = self.expected_peak
        return None if not peak else 100.0 * (self.peak_q / peak - 1.0)


@dataclass(frozen=True, kw_only=True)
class PushMetrics(WholeMetrics):
    """Metrics over all pushes; ``reasons`` by name for those not measured."""

    pushed_peak_q: float = declare_metric("rad", "Largest deviation of q", "max |q − q before the push|, of all pushes")
    pushed_peak_S: float = declare_metric(
        "N·m/rad", "Largest deviation of S", "max |S − S before the push|, of all pushes"
    )
    pushed_back_s: float | None = declare_metric(
        "s",
        "Recovery time after a push",
        f"longest time from a push's end until |q − q_ref| stays below {Angle(REST_TOLERANCES['q'])}",
    )
    pushed_off_percent: float | None = declare_metric(
        "%",
        "Prediction error of the peaks",
        "largest |measured/predicted − 1| of the peaks of q, for the active gains",
    )
    pushed_static_ratio: float | None = declare_metric(
        "1",
        "Largest ratio to the static deviation",
        "largest peak deviation of q divided by r_j F/S, impulses excluded",
    )
    reasons: Mapping[str, str] = field(default_factory=dict)


def compute_push_metrics(columns: Columns, program: Program, context: EvaluationContext) -> PushMetrics:
    """Compute the metrics of single pushes.

    ``columns`` has q, S, their references, F_push, tensions and voltages, one sample per millisecond. Raises
    NoSamplesError if the run ended before the end of the first push.
    """
    found = measure_pushes(columns, program, context)
    if not found:
        raise NoSamplesError(messages.pushes_not_completed() if find_push_windows(program) else messages.no_push())
    back = [item.back_s for item in found]
    off = [item.off_percent for item in found]
    ratios = [item.peak_q / item.static for item in found if item.window.shape != "impulse"]
    reasons = {
        "pushed_back_s": next((item.reason for item in found if item.reason), ""),
        "pushed_off_percent": next((item.unpredicted for item in found if item.unpredicted), ""),
        "pushed_static_ratio": "" if ratios else messages.all_pushes_impulses(),
    }
    return PushMetrics(
        **compute_whole_metrics(columns),
        pushed_peak_q=max(item.peak_q for item in found),
        pushed_peak_S=max(item.peak_S for item in found),
        pushed_back_s=_largest_or_none(back),
        pushed_off_percent=_largest_or_none([None if item is None else abs(item) for item in off]),
        pushed_static_ratio=max(ratios, default=None),
        reasons={name: reason for name, reason in reasons.items() if reason},
    )


def find_push_windows(program: Program) -> tuple[PushWindow, ...]:
    """Return the pushes of a program, each from the start of the force until it is 0 again."""
    found: list[PushWindow] = []
    push_start, shapes, before = -1, set[Shape](), 0.0
    segments = [*iterate_segments(program)]
    for start, end, segment in segments:
        acts = segment.F_push != 0.0 or (segment.shape is Shape.RAMP and before != 0.0)
        if push_start >= 0 and not acts:
            found.append(_build_window(program, slice(push_start, start), shapes))
            push_start, shapes = -1, set[Shape]()
        if acts:
            push_start = start if push_start < 0 else push_start
            shapes.add(segment.shape)
        before = segment.F_push
        if push_start >= 0 and end == segments[-1][1]:
            found.append(_build_window(program, slice(push_start, end), shapes))
    return tuple(found)


def _build_window(program: Program, pushed: slice, shapes: set[Shape]) -> PushWindow:
    short = (pushed.stop - pushed.start) * T_s <= IMPULSE_S + 1e-9
    shape = "impulse" if short else "ramp" if Shape.RAMP in shapes else "step"
    return PushWindow(pushed, shape, max(find_undisturbed_end(program, pushed.stop), pushed.stop))


def measure_pushes(columns: Columns, program: Program, context: EvaluationContext) -> tuple[MeasuredPush, ...]:
    """Return the measurements of each completed push."""
    size = columns["q"].size
    responses: dict[tuple[object, ...], Array] = {}
    windows = [item for item in find_push_windows(program) if item.pushed.stop <= size]
    return tuple(_measure_push(columns, item, context, responses) for item in windows)


def _measure_push(
    columns: Columns, window: PushWindow, context: EvaluationContext, responses: dict[tuple[object, ...], Array]
) -> MeasuredPush:
    start, stop = window.pushed.start, window.pushed.stop
    seen = slice(start, min(window.until, columns["q"].size))
    before = slice(max(start - round(PUSH_REST_S / T_s), 0), max(start, 1))
    # A sample contains the push of the previous tick, so the force is shifted by one sample.
    force = np.append(columns["F_push"][start + 1 : seen.stop], 0.0)
    S = float(columns["S_ref"][start])
    q, S_seen = (columns[name][seen] - columns[name][before].mean() for name in ("q", "S"))
    off = np.abs(columns["q"] - columns["q_ref"])[stop : seen.stop]
    back_s, reason = _find_return_time(off, stop)
    F = float(force[np.argmax(np.abs(force))])
    r_j = context.parameters.geometry.r_j
    try:
        expected, why = _predict_deviation(context, start, S, r_j * force, responses), ""
    except PredictionUnavailableError as error:
        expected, why = None, error.message
    static = r_j * abs(F) / S
    return MeasuredPush(
        window=window,
        F=F,
        impulse=float(force[: stop - start].sum() * T_s),
        S=S,
        peak_q=float(np.abs(q).max()),
        peak_S=float(np.abs(S_seen).max()),
        back_s=back_s,
        reason=reason,
        static=static,
        expected=expected,
        unpredicted=why,
    )


def _find_return_time(off: Array, stop: int) -> tuple[float | None, str]:
    """Return the time [s] until the joint stays near its reference, or the reason why it is unknown."""
    if off.size == 0:
        return None, messages.no_hold_after_push(end_s=stop * T_s)
    away = np.flatnonzero(~(off <= REST_TOLERANCES["q"]))
    if away.size and away[-1] == off.size - 1:
        return None, messages.not_back_after_push(end_s=stop * T_s, deviation_rad=float(off[-1]), hold_s=off.size * T_s)
    return (0.0 if away.size == 0 else float(away[-1] + 1) * T_s), ""


def _predict_deviation(
    context: EvaluationContext, start: int, S: float, tau: Array, responses: dict[tuple[object, ...], Array]
) -> Array:
    """Return the predicted deviation of q [rad] for a torque ``tau`` (n,) [N·m] from the sample ``start`` on."""
    from scipy.signal import fftconvolve

    choice = context.get_tuning_at(start)
    acts = [tau]
    if choice.k_ext > 0.0 and context.has_position_loop:
        acts += disturbance_response(context.compute_gains_at(start).disturbance_feedforward, tau, S)
    known = responses.get((choice, S))
    if known is None or known.shape[1] < tau.size:
        known = responses[(choice, S)] = _compute_impulse_responses(context, start, S, tau.size, len(acts))
    return np.asarray(sum(fftconvolve(act, response)[: tau.size] for act, response in zip(acts, known, strict=True)))


def _compute_impulse_responses(context: EvaluationContext, start: int, S: float, size: int, count: int) -> Array:
    """Return the responses of q (count, size) to impulses of the torque and of the rejection's inputs."""
    closed = make_sampled_loop(
        context.parameters, context.compute_gains_at(start), S, position_loop=context.has_position_loop
    ).closed
    found = np.empty((count, size))
    for place, act in enumerate((INPUTS.tau_ext, INPUTS.q_e, INPUTS.q_off)[:count]):
        w = np.zeros((size, len(INPUTS)))
        w[0, act] = 1.0
        found[place] = closed.simulate(w)[:, OUTPUTS.q]
    return found


def _largest_or_none(values: list[float | None]) -> float | None:
    """Return the largest value; None if one is unknown."""
    known = [value for value in values if value is not None]
    return max(known) if len(known) == len(values) else None


# Robustness ----------------------------------------------------------------------------------------
# Deviation of the motors under loads on their shafts, and its duration.


RobustnessColumns = Mapping[str, Array]

RETURN_SHARE = 0.05
"""Fraction of the largest deviation within which a motor has returned to its reference."""

_COUNTS_MIN = 20.0


@dataclass(frozen=True)
class RobustnessMetrics:
    """Metrics over all load steps; ``reasons`` by name for those not measured."""

    deviation_A_rad: float = declare_metric(
        "rad", "Deviation of motor A", "max |θ_A − θ_A,ref| after its load is applied or removed"
    )
    deviation_B_rad: float = declare_metric(
        "rad", "Deviation of motor B", "max |θ_B − θ_B,ref| after its load is applied or removed"
    )
    back_s: float | None = declare_metric(
        "s",
        "Recovery time",
        "longest time from a load step until |θ_ref − θ| stays within 5 % of its maximum",
    )
    error_integral_A: float = declare_metric(
        "rad·s", "Integral of the error of A", "integral of θ_A,ref − θ_A while its load is applied"
    )
    error_integral_B: float = declare_metric(
        "rad·s", "Integral of the error of B", "integral of θ_B,ref − θ_B while its load is applied"
    )
    deviation_q: float = declare_metric("rad", "Joint deviation", "max |q − q_ref| from the first load on")
    deviation_S: float = declare_metric("N·m/rad", "Stiffness deviation", "max |S − S_ref| from the first load on")
    min_tension_N: float = declare_metric(
        "N", "Smallest tension", "smallest reading of both load cells from the start of the program"
    )
    max_tension_N: float = declare_metric(
        "N", "Largest tension", "largest reading of both load cells from the start of the program"
    )
    peak_voltage_V: float = declare_metric("V", "Peak voltage", "largest |u_A|, |u_B| after limiting")
    reasons: Mapping[str, str] = field(default_factory=dict)


def compute_robustness_metrics(
    columns: RobustnessColumns, steps: Sequence[LoadStep], motor_step_rad: float
) -> RobustnessMetrics:
    """Compute the metrics of load steps.

    ``columns`` has angles, references, q, S, tensions and voltages, one sample per millisecond. ``motor_step_rad`` is
    the resolution of the motor encoders, 0 if exact. Raises NoSamplesError if the run ended before the last load step.
    """
    if not steps or columns["q"].size < max(step.window.stop for step in steps):
        raise NoSamplesError(messages.loads_not_completed())
    errors: dict[str, Array] = {side: columns[f"theta_{side}_ref"] - columns[f"theta_{side}"] for side in SIDES}
    reasons: dict[str, str] = {}
    deviations, times, away_still = {"A": 0.0, "B": 0.0}, [0.0], []
    for side, window, _ in steps:
        error = errors[side][window]
        size = np.abs(error)
        deviations[side] = float(np.maximum(deviations[side], size.max()))
        if math.isnan(deviations[side]):
            reasons["back_s"] = reasons[f"deviation_{side}_rad"] = messages.no_motor_angle(side=side)
            continue
        if not size.max() > _COUNTS_MIN * motor_step_rad:  # negated, so that it includes nan
            reasons["back_s"] = messages.motor_moved_too_little(side=side, minimum_counts=_COUNTS_MIN)
            continue
        away = np.flatnonzero(size > RETURN_SHARE * size.max())
        if away[-1] == size.size - 1:
            off = float(size[size.size // 2 :].max() / size.max())
            since = error[size.argmax() :] / size.max()
            away_still.append((off, side, bool(since.min() < -RETURN_SHARE and since.max() > RETURN_SHARE), size.size))
        times.append(float(away[-1] + 1) * T_s)
    if away_still:
        reasons["back_s"] = _format_not_returned(*max(away_still))
    loaded = slice(min(step.window.start for step in steps), None)
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    return RobustnessMetrics(
        deviation_A_rad=deviations["A"],
        deviation_B_rad=deviations["B"],
        back_s=max(times) or None,
        error_integral_A=_integrate_error(errors["A"], "A", steps),
        error_integral_B=_integrate_error(errors["B"], "B", steps),
        deviation_q=float(np.abs(columns["q"] - columns["q_ref"])[loaded].max()),
        deviation_S=float(np.abs(columns["S"] - columns["S_ref"])[loaded].max()),
        min_tension_N=float(tensions.min()),
        max_tension_N=float(tensions.max()),
        peak_voltage_V=float(np.abs(np.concatenate([columns["u_A"], columns["u_B"]])).max()),
        reasons=reasons,
    )


def _integrate_error(error: Array, side: Side, steps: Sequence[LoadStep]) -> float:
    return float(sum(np.sum(error[step.window]) for step in steps if step.side == side and step.on) * T_s)


def _format_not_returned(off: float, side: str, to_both_sides: bool, ticks: int) -> str:
    duration_s, error_percent = ticks * T_s, 100.0 * off
    if to_both_sides:
        return messages.motor_in_limit_cycle(side=side, duration_s=duration_s, error_percent=error_percent)
    return messages.motor_not_back(side=side, duration_s=duration_s, error_percent=error_percent)
