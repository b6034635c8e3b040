"""Fault detection in the control step: slack tendons, limits, and readings that cannot be true."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control.decoupler import compute_bounds
from plant import (
    SIDES,
    Measurement,
    MotorCommand,
    PlantParameters,
    Side,
    Spring,
    T_s,
    compiled,
    tendon_tension,
    tendon_tension_slope,
)

# Plausibility --------------------------------------------------------------------------------------
#
# Can the readings be true? Each sensor against its own past, and encoders against load cells.
#
# What the encoders say about the tendons: each tension is known twice, by its load cell and by the
# spring it stretches.


CONTRADICTION_N = 6.0
"""Difference between load cell and spring that is a fault [N]: several times a spring's misfit and a cell's error."""

CONTRADICTION_S = 0.2
"""How long it must last to one side [s]: load cells lag by 10-15 ms, and a joint that swings after a blow makes the
difference swing with it, twenty times a second."""

UNMOVED_S = 0.1
"""How long a motor may be driven without its encoder moving by a count [s]."""

REVERSED_S = 0.05
"""A motor that is driven turns against its voltage, and faster in the second of two such times than in the first [s]:
something is connected the wrong way round. One that is being turned round by its voltage gets slower."""

_REVERSED_RAD = 5e-3
"""How much faster, as an angle in that time [rad]: some counts of the encoder."""

VOLTAGE_MARGIN = 1.0
"""Driven means this much [V] above what holds the largest tension against friction: after 0.1 s a thousandth of a
revolution lies behind the slowest motor."""

_MOTOR_MARGIN = 3.0
"""Times the motor's fastest speed without load: a reading that moves faster has jumped."""

_MARGIN_N = 1.0

TURNED_RAD = 2.0
"""A load cell that does not change in its last digit while its motor turns this far [rad] is stuck; slack before
pretension, where an exact reading of nothing is true, ends after 0.9 rad."""

_REVERSED_TICKS = round(REVERSED_S / T_s)

PLAUSIBLE, JUMPED, REVERSED, UNMOVED, STUCK, IMPLAUSIBLE = range(6)
"""What ``check_plausibility`` may say of the readings of a step."""

_PAST, _UNCHANGED_S, _UNMOVED_S, _TURNED_FROM, _CONTRADICTED_S, _SIGN, _TICKS, _BEFORE, _MIDDLE = range(9)
"""Rows of what is remembered: the first two by reading, the others by side."""


class Tendons(NamedTuple):
    """Radii [m] and the identified springs."""

    r_m: float
    r_j: float
    spring_A: Spring
    spring_B: Spring


@compiled
def has_slack(tendons: Tendons, m: Measurement) -> bool:
    """Whether the elongation (equation 1) of a tendon is at or below that of zero force: it pulls nothing."""
    x_A = tendons.r_m * m.theta_A - tendons.r_j * m.q
    x_B = tendons.r_m * m.theta_B + tendons.r_j * m.q
    return x_A <= tendons.spring_A.x_slack or x_B <= tendons.spring_B.x_slack


class SensorLimits(NamedTuple):
    """``reach`` of q, theta_A, theta_B [rad], F_A, F_B [N] in a tick; ``driven_V`` [V] is sure to turn a motor."""

    reach: tuple[float, float, float, float, float]
    driven_V: tuple[float, float]


class SensorVerdict(NamedTuple):
    """What ``check_plausibility`` says, and of which reading or side.

    ``still`` is a reading that has stood still all the while, -1 for none; ``excess`` is load cell minus spring [N],
    where they contradict each other.
    """

    kind: int
    which: int
    still: int
    excess: float


@compiled
def compute_force_differences(tendons: Tendons, m: Measurement) -> tuple[float, float]:
    """Load cell minus spring force at the elongation that the encoders give [N], for tendons A and B.

    A spring that is solid counts with the force at which it became so: beyond it, one encoder count is 12 N.
    """
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
    """Take the first readings for what was before."""
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
    """Look at the readings of a tick, ``periods`` after those before; the first doubt counts. Gives a ``Verdict``.

    ``raw`` is as read, ``m`` has the motor encoders' zeros, which are known where ``zeroed``; ``command`` is what was
    written in the tick before. All readings are numbers.
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
    """Return the first reading that has moved further than it can, -1 for none."""
    for index in range(5):
        change = readings[index] - memory[_PAST, index]
        memory[_UNCHANGED_S, index] = memory[_UNCHANGED_S, index] + T_s if change == 0.0 else 0.0
        if abs(change) > limits.reach[index] * periods:
            return index
    return -1


@compiled
def _is_reversed(memory: NDArray[np.float64], side: int, theta: float, driven: float) -> bool:
    """Tell whether a motor that is driven one way [V], 0 V where not, turned against it all the while, and faster.

    Two times of REVERSED_S are compared.
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
    """Tell whether a load cell has differed from its spring to one side for CONTRADICTION_S."""
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
    """Return which of the readings that contradict each other has stood still for CONTRADICTION_S, -1 for none."""
    for index in (0, 1 + side, 3 + side):
        if memory[_UNCHANGED_S, index] > CONTRADICTION_S:
            return index
    return -1


def build_tendons(parameters: PlantParameters) -> Tendons:
    """Tendons of a parameter set, as the controller knows them."""
    geometry = parameters.geometry
    return Tendons(
        geometry.r_m, geometry.r_j, parameters.make_identified_spring("A"), parameters.make_identified_spring("B")
    )


def build_sensor_limits(parameters: PlantParameters) -> SensorLimits:
    """How far readings of a plant can move in a tick, and what is sure to turn its motors."""
    return SensorLimits(
        _compute_reach_per_tick(parameters),
        (_compute_driving_voltage(parameters, "A"), _compute_driving_voltage(parameters, "B")),
    )


def _compute_reach_per_tick(parameters: PlantParameters) -> tuple[float, float, float, float, float]:
    """How far q, theta_A, theta_B [rad], F_A, F_B [N] can move in a tick.

    The joint at the speed at which its damping takes up the largest tension; each motor at a multiple of its fastest;
    each load cell at that speed of the joint on the steepest part of its spring.
    """
    geometry, u_max = parameters.geometry, parameters.motor.u_max
    q_dot = geometry.r_j * parameters.safety.F_max / max(geometry.B_j, 1e-6)
    A, B = (_MOTOR_MARGIN * parameters.select_identified(side).K_m * u_max * T_s for side in SIDES)
    springs = (parameters.make_identified_spring(side) for side in SIDES)
    F_A, F_B = (
        tendon_tension_slope(spring, spring.x_solid) * geometry.r_j * q_dot * T_s + _MARGIN_N for spring in springs
    )
    return 1.2 * q_dot * T_s, A, B, F_A, F_B


def _compute_driving_voltage(parameters: PlantParameters, side: Side) -> float:
    """Voltage [V] that is sure to turn a motor under any tension."""
    motor = parameters.select_motor(side)
    torque = parameters.geometry.r_m * parameters.safety.F_max
    return (torque * (1.0 + motor.stiction * motor.c1) + motor.stiction * motor.c0) / motor.K_t + VOLTAGE_MARGIN


# Checks --------------------------------------------------------------------------------------------
#
# Fault detection in the tick: each check says what it has found, as a number. The first one found
# counts.


SLACK_MAX_S = 0.1
"""How long a tendon may be slack while the loops are closed [s]."""

NO_FAULT, NOT_FINITE, TRIPPED, OUT_OF_BOUNDS, IMPLAUSIBLE_READING, SLACK, MISSED = range(7)
"""What may be found."""


class FaultDetectionLimits(NamedTuple):
    """What the checks know of a plant.

    ``F_slack``, ``F_max`` [N], ``q_trip`` [rad]; ``missed_max``: so many deadlines in a row are too many.
    """

    limits: SensorLimits
    tendons: Tendons
    F_slack: float
    F_max: float
    q_trip: float
    missed_max: int


class FaultDetectionState(NamedTuple):
    """What the checks remember: how long a tendon has been slack [s], and of the readings.

    ``memory`` is that of ``check_plausibility``; ``previous``: the reading before the newest, if there ``has_reading``.
    """

    slack_s: float
    has_reading: bool
    previous: Measurement
    newest: Measurement
    memory: NDArray[np.float64]


class DetectedFault(NamedTuple):
    """What was found, and where readings cannot be true the words of ``plausibility.Verdict``."""

    kind: int
    verdict: int
    which: int
    still: int
    excess: float


CLEAR = DetectedFault(NO_FAULT, PLAUSIBLE, 0, -1, 0.0)


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

    ``raw`` is as read; in ``m`` the motor encoders have their zeros, which are known where ``zeroed``. ``command`` is
    what was written last. ``tension_required``: the mode keeps tendons under tension; ``missed``: deadlines missed
    since the last tick.
    """
    if not math.isfinite(m.q + m.theta_A + m.theta_B + m.F_A + m.F_B):
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
    out_of_bounds = max(m.F_A, m.F_B) > fault_limits.F_max or abs(m.q) > fault_limits.q_trip
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
    """Return what the checks know of a parameter set."""
    bounds = compute_bounds(parameters)
    tendons = build_tendons(parameters)
    return FaultDetectionLimits(
        limits=build_sensor_limits(parameters),
        tendons=tendons,
        F_slack=bounds.F_slack,
        F_max=bounds.F_max,
        q_trip=bounds.q_trip,
        missed_max=missed_max,
    )
