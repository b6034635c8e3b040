"""Fault detection in the control step: slack, limits, implausible readings."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control.decoupler import compute_bounds
from plant import (
    SIDES,
    Measurement,
    Mechanism,
    MotorCommand,
    PlantParameters,
    Side,
    Spring,
    T_s,
    compiled,
    elastic_deflection,
    elastic_torques,
    tendon_tension,
    tendon_tension_slope,
)

# Plausibility --------------------------------------------------------------------------------------
# Plausibility of readings: each sensor against its own past, and encoders against load cells.
#
# Two measurements give each tension: the load cell, and the encoders through the elongation of the spring.


CONTRADICTION_N = 6.0
"""Difference between load cell and spring that is a fault [N]: several times a spring's misfit and a cell's error."""

CONTRADICTION_S = 0.2
"""Time that it must last with the same sign [s]: load cells lag by 10-15 ms, and after a blow the joint oscillates at
20 Hz and the difference with it."""

UNMOVED_S = 0.1
"""Longest time that a driven motor may not move by an encoder count [s]."""

REVERSED_S = 0.05
"""Interval [s] of the check for reversed signs: a driven motor that turns against its voltage, and faster in the second
of two intervals than in the first, has a reversed sign. One whose voltage is reversing its motion decelerates."""

_REVERSED_RAD = 5e-3
"""Required increase of the angle per interval [rad]: some encoder counts."""

VOLTAGE_MARGIN = 1.0
"""A motor counts as driven this far above the voltage that holds the largest tension against friction [V]: the slowest
motor then turns by a thousandth of a revolution in 0.1 s."""

_MOTOR_MARGIN = 3.0
"""Multiple of the motor's no-load speed at which a reading must have jumped."""

_MARGIN_N = 1.0

TURNED_RAD = 2.0
"""A load cell whose last digit stays the same while its motor turns this far [rad] is stuck; slack before pretension,
during which an exact zero is correct, ends after 0.9 rad."""

_REVERSED_TICKS = round(REVERSED_S / T_s)

PLAUSIBLE, JUMPED, REVERSED, UNMOVED, STUCK, IMPLAUSIBLE = range(6)
"""Results of ``check_plausibility``."""

_PAST, _UNCHANGED_S, _UNMOVED_S, _TURNED_FROM, _CONTRADICTED_S, _SIGN, _TICKS, _BEFORE, _MIDDLE = range(9)
"""Rows of the memory: the first two are by reading, the others by side."""


class Tendons(NamedTuple):
    """Radii [m] and identified springs, or the identified ``mechanism`` without tendons."""

    r_m: float
    r_j: float
    spring_A: Spring
    spring_B: Spring
    mechanism: Mechanism | None = None


@compiled
def has_slack(tendons: Tendons, m: Measurement) -> bool:
    """Return whether a tendon's elongation (equation 1) is at or below zero force."""
    return _has_slack(tendons, tendons.mechanism, m)


@compiled
def _has_slack(tendons: Tendons, mechanism: Mechanism | None, m: Measurement) -> bool:
    if mechanism is not None:
        return False
    x_A = tendons.r_m * m.theta_A - tendons.r_j * m.q
    x_B = tendons.r_m * m.theta_B + tendons.r_j * m.q
    return x_A <= tendons.spring_A.x_slack or x_B <= tendons.spring_B.x_slack


class SensorLimits(NamedTuple):
    """Limits of the plausibility checks.

    ``reach``: largest changes of q, theta_A, theta_B [rad], F_A, F_B [N] in a tick. ``driven_V`` [V]: voltages that
    certainly turn the motors.
    """

    reach: tuple[float, float, float, float, float]
    driven_V: tuple[float, float]


class SensorVerdict(NamedTuple):
    """Result of ``check_plausibility``, with reading or side.

    ``still`` is a reading that has not changed meanwhile, -1 for none; ``excess`` is load cell minus spring [N] for
    IMPLAUSIBLE.
    """

    kind: int
    which: int
    still: int
    excess: float


@compiled
def compute_force_differences(tendons: Tendons, m: Measurement) -> tuple[float, float]:
    """Return load cell minus spring force [N] of tendons A and B.

    The spring force is that at the elongation from the encoders. A solid spring counts with the force at which it
    became solid: beyond it, one encoder count is 12 N. Without load cells the differences are 0.
    """
    return _compute_force_differences(tendons, tendons.mechanism, m)


@compiled
def _compute_force_differences(tendons: Tendons, mechanism: Mechanism | None, m: Measurement) -> tuple[float, float]:
    if mechanism is not None:
        return 0.0, 0.0
    x_A = tendons.r_m * m.theta_A - tendons.r_j * m.q
    x_B = tendons.r_m * m.theta_B + tendons.r_j * m.q
    F_A = min(tendon_tension(tendons.spring_A, x_A), tendons.spring_A.F_solid)
    F_B = min(tendon_tension(tendons.spring_B, x_B), tendons.spring_B.F_solid)
    return m.F_A - F_A, m.F_B - F_B


def make_reading_memory() -> NDArray[np.float64]:
    """Return the memory of ``check_plausibility``, which changes in place."""
    return np.zeros((9, 5))


@compiled
def remember_readings(memory: NDArray[np.float64], raw: Measurement) -> None:
    """Initialise the memory with the first readings."""
    memory[:] = 0.0
    readings = raw.q, raw.theta_A, raw.theta_B, raw.F_A, raw.F_B
    for index in range(5):
        memory[_PAST, index] = readings[index]
    memory[_TURNED_FROM, 0], memory[_TURNED_FROM, 1] = raw.theta_A, raw.theta_B


@compiled
def check_plausibility(
    limits: SensorLimits,
    tendons: Tendons,
    memory: NDArray[np.float64],
    raw: Measurement,
    m: Measurement,
    command: MotorCommand,
    zeroed: bool,
    periods: int,
) -> tuple[int, int, int, float]:
    """Check the readings of a tick; return the fields of the first ``SensorVerdict``.

    ``periods`` have passed since the last readings. ``raw`` is as read; in ``m`` the motor encoders count from their
    zeros if ``zeroed``; ``command`` was written in the previous tick. All readings are finite, apart from those of
    load cells that the actuator does not have: their checks never fail.
    """
    readings = raw.q, raw.theta_A, raw.theta_B, raw.F_A, raw.F_B
    jump_index = _find_jump(limits, memory, readings, periods)
    for index in range(5):
        memory[_PAST, index] = readings[index]
    if jump_index >= 0:
        return JUMPED, jump_index, -1, 0.0
    excess = compute_force_differences(tendons, m) if zeroed else (0.0, 0.0)
    theta, volts = (raw.theta_A, raw.theta_B), (command.u_A, command.u_B)
    for side in range(2):
        driven = volts[side] if abs(volts[side]) > limits.driven_V[side] else 0.0
        if _is_reversed(memory, side, theta[side], driven):
            return REVERSED, side, -1, 0.0
    tensions = m.F_A, m.F_B
    for side in range(2):
        driven_still = abs(volts[side]) > limits.driven_V[side] and memory[_UNCHANGED_S, 1 + side] > 0.0
        memory[_UNMOVED_S, side] = memory[_UNMOVED_S, side] + T_s if driven_still else 0.0
        if memory[_UNMOVED_S, side] > UNMOVED_S:
            return UNMOVED, side, -1, 0.0
        known_slack = zeroed and tensions[side] - excess[side] <= 0.0
        if memory[_UNCHANGED_S, 3 + side] == 0.0 or known_slack:
            memory[_TURNED_FROM, side] = theta[side]
        elif abs(theta[side] - memory[_TURNED_FROM, side]) > TURNED_RAD:
            return STUCK, side, -1, 0.0
    for side in range(2):
        if _update_contradiction(memory, side, excess[side]):
            return IMPLAUSIBLE, side, _find_unchanged(memory, side), excess[side]
    return PLAUSIBLE, 0, -1, 0.0


@compiled
def _find_jump(
    limits: SensorLimits, memory: NDArray[np.float64], readings: tuple[float, float, float, float, float], periods: int
) -> int:
    """Return the first reading that has changed by more than possible, -1 for none."""
    for index in range(5):
        change = readings[index] - memory[_PAST, index]
        memory[_UNCHANGED_S, index] = memory[_UNCHANGED_S, index] + T_s if change == 0.0 else 0.0
        if abs(change) > limits.reach[index] * periods:
            return index
    return -1


@compiled
def _is_reversed(memory: NDArray[np.float64], side: int, theta: float, driven: float) -> bool:
    """Return whether a driven motor turned against its voltage with rising speed.

    ``driven`` is the voltage [V], 0 if the motor is not driven. Two intervals of REVERSED_S are compared.
    """
    sign = math.copysign(1.0, driven) if driven != 0.0 else 0.0
    if sign != memory[_SIGN, side] or sign == 0.0:
        memory[_SIGN, side] = sign
        memory[_TICKS, side] = 0.0
        memory[_BEFORE, side] = memory[_MIDDLE, side] = theta
        return False
    memory[_TICKS, side] += 1.0
    if memory[_TICKS, side] % _REVERSED_TICKS != 0.0:
        return False
    first = sign * (memory[_MIDDLE, side] - memory[_BEFORE, side])
    second = sign * (theta - memory[_MIDDLE, side])
    memory[_BEFORE, side] = memory[_MIDDLE, side]
    memory[_MIDDLE, side] = theta
    return bool(memory[_TICKS, side] > _REVERSED_TICKS and first < 0.0 and second < first - _REVERSED_RAD)


@compiled
def _update_contradiction(memory: NDArray[np.float64], side: int, excess: float) -> bool:
    """Return whether load cell and spring have differed for CONTRADICTION_S.

    The difference must have kept its sign.
    """
    lasting_s = memory[_CONTRADICTED_S, side]
    if excess > CONTRADICTION_N:
        lasting_s = max(lasting_s, 0.0) + T_s
    elif excess < -CONTRADICTION_N:
        lasting_s = min(lasting_s, 0.0) - T_s
    else:
        lasting_s = 0.0
    memory[_CONTRADICTED_S, side] = lasting_s
    return bool(abs(lasting_s) > CONTRADICTION_S)


@compiled
def _find_unchanged(memory: NDArray[np.float64], side: int) -> int:
    """Return the first contradicting reading that has not changed for CONTRADICTION_S.

    The result is -1 if all of them have changed.
    """
    for index in (0, 1 + side, 3 + side):
        if memory[_UNCHANGED_S, index] > CONTRADICTION_S:
            return index
    return -1


def build_tendons(parameters: PlantParameters) -> Tendons:
    """Return the tendons of a parameter set, or its mechanism, as identified."""
    geometry, identified = parameters.geometry, parameters.make_identified_dynamics()
    return Tendons(geometry.r_m, geometry.r_j, identified.spring_A, identified.spring_B, identified.mechanism)


def build_sensor_limits(parameters: PlantParameters) -> SensorLimits:
    """Return the largest changes of readings in a tick, and the driving voltages."""
    return SensorLimits(
        _compute_reach_per_tick(parameters),
        (_compute_driving_voltage(parameters, "A"), _compute_driving_voltage(parameters, "B")),
    )


def _compute_reach_per_tick(parameters: PlantParameters) -> tuple[float, float, float, float, float]:
    """Return the largest changes of q, theta_A, theta_B [rad], F_A, F_B [N] in a tick.

    For the joint, at the speed at which its damping balances the largest tension; for a motor, at a multiple of its
    no-load speed; for a load cell, at that speed of the joint on the steepest part of its spring.
    """
    geometry, u_max = parameters.geometry, parameters.motor.u_max
    q_dot = _compute_largest_torques(parameters)[0] / max(geometry.B_j, 1e-6)
    A, B = (_MOTOR_MARGIN * parameters.select_identified(side).K_m * u_max * T_s for side in SIDES)
    if parameters.mechanism is not None:
        return 1.2 * q_dot * T_s, A, B, math.inf, math.inf
    springs = (parameters.make_identified_spring(side) for side in SIDES)
    F_A, F_B = (
        tendon_tension_slope(spring, spring.x_solid) * geometry.r_j * q_dot * T_s + _MARGIN_N for spring in springs
    )
    return 1.2 * q_dot * T_s, A, B, F_A, F_B


def _compute_largest_torques(parameters: PlantParameters) -> tuple[float, float]:
    """Return the largest torques [N·m] of the springs on the joint and on a motor.

    They are those at the limit of the safety module.
    """
    F_max, geometry, mechanism = parameters.safety.F_max, parameters.geometry, parameters.mechanism
    if mechanism is None:
        return geometry.r_j * F_max, geometry.r_m * F_max
    elastic, axes, limit = mechanism.make_mechanism(), parameters.axes, parameters.safety.deflection_max
    corners = [
        elastic_torques(elastic, q, axes.n_A * preset, axes.n_B * preset)
        for preset in (mechanism.preset_min, mechanism.preset_max)
        for q in np.linspace(-limit, limit, 101)
        if abs(elastic_deflection(elastic, q, axes.n_A * preset, axes.n_B * preset)) <= limit
    ]
    tau, load_A, load_B, _ = np.max(np.abs(corners), axis=0)
    return float(tau), float(max(load_A, load_B))


def _compute_driving_voltage(parameters: PlantParameters, side: Side) -> float:
    """Return a voltage [V] that certainly turns a motor under any tension."""
    motor = parameters.select_motor(side)
    _, torque = _compute_largest_torques(parameters)
    return (torque * (1.0 + motor.stiction * motor.c1) + motor.stiction * motor.c0) / motor.K_t + VOLTAGE_MARGIN


# Checks --------------------------------------------------------------------------------------------
# Fault detection in the control step: each check returns a number, and the first fault counts.


SLACK_MAX_S = 0.1
"""Longest time that a tendon may be slack while the loops are closed [s]."""

NO_FAULT, NOT_FINITE, TRIPPED, OUT_OF_BOUNDS, IMPLAUSIBLE_READING, SLACK, MISSED = range(7)
"""Kinds of a detected fault."""


class FaultDetectionLimits(NamedTuple):
    """Limits of the checks.

    ``F_slack``, ``F_max`` [N], ``q_trip`` [rad]; ``missed_max``: number of missed deadlines in a row that is a fault.
    ``deflection_max`` [rad] replaces the forces for an actuator without tendons.
    """

    limits: SensorLimits
    tendons: Tendons
    F_slack: float
    F_max: float
    q_trip: float
    missed_max: int
    deflection_max: float = math.inf


class FaultDetectionState(NamedTuple):
    """State of the checks: duration of slack [s], and the last readings.

    ``memory`` is that of ``check_plausibility``; ``previous`` is the reading before the newest, if ``has_reading``.
    """

    slack_s: float
    has_reading: bool
    previous: Measurement
    newest: Measurement
    memory: NDArray[np.float64]


class DetectedFault(NamedTuple):
    """Detected fault; for implausible readings with the fields of ``SensorVerdict``."""

    kind: int
    verdict: int
    which: int
    still: int
    excess: float


CLEAR = DetectedFault(NO_FAULT, PLAUSIBLE, 0, -1, 0.0)


@compiled
def has_finite_readings(tendons: Tendons, m: Measurement) -> bool:
    """Return whether the readings of all sensors that the actuator has are finite."""
    return _has_finite_readings(tendons.mechanism, m)


@compiled
def _has_finite_readings(mechanism: Mechanism | None, m: Measurement) -> bool:
    if mechanism is not None:
        return math.isfinite(m.q + m.theta_A + m.theta_B)
    return math.isfinite(m.q + m.theta_A + m.theta_B + m.F_A + m.F_B)


@compiled
def is_spring_overloaded(tendons: Tendons, F_max: float, deflection_max: float, m: Measurement) -> bool:
    """Return whether a tension [N], or the deflection [rad], exceeds its limit."""
    return _is_spring_overloaded(tendons.mechanism, F_max, deflection_max, m)


@compiled
def _is_spring_overloaded(mechanism: Mechanism | None, F_max: float, deflection_max: float, m: Measurement) -> bool:
    if mechanism is not None:
        return abs(elastic_deflection(mechanism, m.q, m.theta_A, m.theta_B)) > deflection_max
    return max(m.F_A, m.F_B) > F_max


@compiled
def detect_fault(
    fault_limits: FaultDetectionLimits,
    state: FaultDetectionState,
    raw: Measurement,
    m: Measurement,
    command: MotorCommand,
    zeroed: bool,
    tension_required: bool,
    missed: int,
) -> tuple[DetectedFault, FaultDetectionState]:
    """Check a measurement; return the first fault found and the next state.

    ``raw`` is as read; in ``m`` the motor encoders count from their zeros if ``zeroed``. ``command`` was written last.
    ``tension_required``: the mode keeps the tendons under tension; ``missed``: deadlines missed since the last tick.
    """
    if not has_finite_readings(fault_limits.tendons, m):
        return DetectedFault(NOT_FINITE, 0, 0, -1, 0.0), state
    if m.safety_trip != 0.0:
        return DetectedFault(TRIPPED, 0, 0, -1, 0.0), state
    verdict, which, still, excess = PLAUSIBLE, 0, -1, 0.0
    if state.has_reading:
        verdict, which, still, excess = check_plausibility(
            limits=fault_limits.limits,
            tendons=fault_limits.tendons,
            memory=state.memory,
            raw=raw,
            m=m,
            command=command,
            zeroed=zeroed,
            periods=1 + missed,
        )
    else:
        remember_readings(state.memory, raw)
    slack = tension_required and min(m.F_A, m.F_B) < fault_limits.F_slack
    slack_s = state.slack_s + T_s if slack else 0.0
    after = FaultDetectionState(slack_s, True, state.newest, raw, state.memory)
    overloaded = is_spring_overloaded(fault_limits.tendons, fault_limits.F_max, fault_limits.deflection_max, m)
    out_of_bounds = overloaded or abs(m.q) > fault_limits.q_trip
    kind = NO_FAULT
    if out_of_bounds and verdict != JUMPED:
        kind = OUT_OF_BOUNDS
    elif verdict != PLAUSIBLE:
        kind = IMPLAUSIBLE_READING
    elif slack_s > SLACK_MAX_S:
        kind = SLACK
    elif missed >= fault_limits.missed_max:
        kind = MISSED
    return DetectedFault(kind, verdict, which, still, excess), after


def build_fault_limits(parameters: PlantParameters, missed_max: int) -> FaultDetectionLimits:
    """Return the limits of the checks for a parameter set."""
    bounds = compute_bounds(parameters)
    tendons = build_tendons(parameters)
    return FaultDetectionLimits(
        limits=build_sensor_limits(parameters),
        tendons=tendons,
        F_slack=bounds.F_slack,
        F_max=bounds.F_max,
        q_trip=bounds.q_trip,
        missed_max=missed_max,
        deflection_max=parameters.safety.deflection_max,
    )
