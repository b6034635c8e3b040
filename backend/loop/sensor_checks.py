"""Can the readings be true? Each sensor against its own past, and encoders against load cells."""

import math

from backend.controllers.plausibility import contradictions, tendons_for
from backend.faults import Fault
from plant.compiled import Specialised
from plant.interface import NOT_MEASURED, Measurement, MotorCommand, T_s
from plant.parameter_sections import SIDES, Side
from plant.parameters import PlantParameters
from plant.spring import tension_slope

CONTRADICTION_N = 6.0
"""Difference between load cell and spring that is a fault [N]: several times a spring's misfit and a cell's error."""

CONTRADICTION_S = 0.2
"""How long it must last to one side [s]: load cells lag by 10-15 ms, and a joint that swings after a blow makes the
difference swing with it, twenty times a second."""

UNMOVED_S = 0.1
"""How long a motor may be driven without its encoder moving by a count [s]."""

VOLTAGE_MARGIN = 1.0
"""Driven means this much [V] above what holds the largest tension against friction: after 0.1 s a thousandth of a
revolution lies behind the slowest motor."""

REVERSED_S = 0.05
"""A motor that is driven turns against its voltage, and faster in the second of two such times than in the first [s]:
something is connected the wrong way round. One that is being turned round by its voltage gets slower."""

_REVERSED_RAD = 5e-3
"""How much faster, as an angle in that time [rad]: some counts of the encoder."""

TURNED_RAD = 2.0
"""A load cell that does not change in its last digit while its motor turns this far [rad] is stuck; slack before
pretension, where an exact reading of nothing is true, ends after 0.9 rad."""

_MOTOR_MARGIN = 3.0
"""Times the motor's fastest speed without load: a reading that moves faster has jumped."""

_REVERSED_TICKS = round(REVERSED_S / T_s)
_NAMES = ("q", "theta_A", "theta_B", "F_A", "F_B")
_UNITS = ("rad", "rad", "rad", "N", "N")
_MARGIN_N = 1.0


class SensorChecks:
    """Looks at every reading, whatever the mode, so that it knows the past when it counts."""

    def __init__(self, parameters: PlantParameters) -> None:
        self._tendons = tendons_for(parameters)
        self._contradictions = Specialised(contradictions, self._tendons, NOT_MEASURED)
        self._reach = _reach_in_a_tick(parameters)
        self._driven_V = _driving_voltage(parameters, "A"), _driving_voltage(parameters, "B")
        self._past: tuple[float, ...] | None = None
        self._unchanged_s = [0.0] * len(_NAMES)
        self._unmoved_s = [0.0, 0.0]
        self._turned_from = [0.0, 0.0]
        self._turning = _Turning(), _Turning()
        self._contradicted_s = [0.0, 0.0]

    def step(
        self, raw: Measurement, m: Measurement, command: MotorCommand, zeroed: bool, missed: int
    ) -> tuple[Fault, str]:
        """Return the first fault found and what was seen, or ``Fault.NONE``.

        ``raw`` is as read, ``m`` has the motor encoders' zeros; ``command`` is what was written in the tick before;
        ``zeroed``: the zeros are known; ``missed``: deadlines missed since the last tick. All readings are numbers.
        """
        readings = raw[:5]
        past, self._past = self._past, readings
        if past is None:
            self._turned_from = [raw.theta_A, raw.theta_B]
            return Fault.NONE, ""
        periods = 1 + missed
        for index, reach in enumerate(self._reach):
            change = readings[index] - past[index]
            self._unchanged_s[index] = 0.0 if change else self._unchanged_s[index] + T_s
            if abs(change) > reach * periods:
                way = f"{past[index]:.3f} to {readings[index]:.3f} {_UNITS[index]}"
                return Fault.SENSOR_JUMP, f"{_NAMES[index]} went from {way}"
        excess = self._contradictions(self._tendons, m) if zeroed else (0.0, 0.0)
        known_slack = [zeroed and m[3 + side] - excess[side] <= 0.0 for side in (0, 1)]
        for side, turning in enumerate(self._turning):
            driven = command[side] if abs(command[side]) > self._driven_V[side] else 0.0
            if turning.is_reversed(raw[1 + side], driven):
                reversed_ = f"{_NAMES[1 + side]} runs away from {command[side]:.1f} V, faster and faster"
                return Fault.MOTOR_REVERSED, reversed_
        stuck = self._stuck(raw, command, known_slack)
        return (Fault.SENSOR_STUCK, stuck) if stuck else self._contradiction(m, excess)

    def _stuck(self, raw: Measurement, command: MotorCommand, known_slack: list[bool]) -> str:
        turned = raw.theta_A, raw.theta_B
        for side in (0, 1):
            theta, F = 1 + side, 3 + side
            driven = abs(command[side]) > self._driven_V[side] and self._unchanged_s[theta] > 0.0
            self._unmoved_s[side] = self._unmoved_s[side] + T_s if driven else 0.0
            if self._unmoved_s[side] > UNMOVED_S:
                return f"{_NAMES[theta]} stands at {raw[theta]:.3f} rad although its motor gets {command[side]:.1f} V"
            if self._unchanged_s[F] == 0.0 or known_slack[side]:
                self._turned_from[side] = turned[side]
            elif abs(turned[side] - self._turned_from[side]) > TURNED_RAD:
                return f"{_NAMES[F]} stands at {raw[F]:.2f} N although its motor turned by {TURNED_RAD:g} rad"
        return ""

    def _contradiction(self, m: Measurement, excesses: tuple[float, float]) -> tuple[Fault, str]:
        for side, excess in enumerate(excesses):
            lasting_s = self._contradicted_s[side]
            if excess > CONTRADICTION_N:
                lasting_s = max(lasting_s, 0.0) + T_s
            elif excess < -CONTRADICTION_N:
                lasting_s = min(lasting_s, 0.0) - T_s
            else:
                lasting_s = 0.0
            self._contradicted_s[side] = lasting_s
            if abs(lasting_s) > CONTRADICTION_S:
                F = m[3 + side]
                seen = f"{_NAMES[3 + side]} = {F:.1f} N, but the encoders stretch that spring to {F - excess:.1f} N"
                for index in (0, 1 + side, 3 + side):
                    if self._unchanged_s[index] > CONTRADICTION_S:
                        return Fault.SENSOR_STUCK, f"{_NAMES[index]} stands still; {seen}"
                return Fault.IMPLAUSIBLE, seen
        return Fault.NONE, ""


class _Turning:
    """Looks at one motor over two times of REVERSED_S in which it was driven one way."""

    def __init__(self) -> None:
        self._sign = 0.0
        self._ticks = 0
        self._angles = [0.0, 0.0]

    def is_reversed(self, theta: float, driven: float) -> bool:
        """Tell whether it turned [rad] against a voltage [V] all the while and got faster; 0 V where not driven."""
        sign = math.copysign(1.0, driven) if driven else 0.0
        if sign != self._sign or not sign:
            self._sign, self._ticks, self._angles = sign, 0, [theta, theta]
            return False
        self._ticks += 1
        if self._ticks % _REVERSED_TICKS:
            return False
        before, middle = self._angles
        self._angles = [middle, theta]
        first, second = sign * (middle - before), sign * (theta - middle)
        return self._ticks > _REVERSED_TICKS and first < 0.0 and second < first - _REVERSED_RAD


def _reach_in_a_tick(parameters: PlantParameters) -> tuple[float, ...]:
    """How far q, theta_A, theta_B [rad], F_A, F_B [N] can move in a tick.

    The joint at the speed at which its damping takes up the largest tension; each motor at a multiple of its fastest;
    each load cell at that speed of the joint on the steepest part of its spring.
    """
    geometry, u_max = parameters.geometry, parameters.motor.u_max
    q_dot = geometry.r_j * parameters.safety.F_max / max(geometry.B_j, 1e-6)
    motors = [_MOTOR_MARGIN * parameters.identified_of(side).K_m * u_max * T_s for side in SIDES]
    springs = [parameters.identified_spring(side) for side in SIDES]
    cells = [tension_slope(spring, spring.x_solid) * geometry.r_j * q_dot * T_s + _MARGIN_N for spring in springs]
    return 1.2 * q_dot * T_s, *motors, *cells


def _driving_voltage(parameters: PlantParameters, side: Side) -> float:
    """Voltage [V] that is sure to turn a motor under any tension."""
    motor = parameters.motor_of(side)
    load = parameters.geometry.r_m * parameters.safety.F_max
    return (load * (1.0 + motor.c1) + motor.c0) / motor.K_t + VOLTAGE_MARGIN
