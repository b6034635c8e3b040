"""What is said of readings that cannot be true; ``backend.controllers.plausibility`` finds them."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from backend.controllers import plausibility
from backend.controllers.plausibility import Limits, Verdict
from backend.faults import Fault
from plant.compiled import Specialised
from plant.interface import NOT_MEASURED, ZERO_VOLTS, Measurement, MotorCommand, T_s
from plant.parameter_sections import SIDES, Side
from plant.parameters import PlantParameters
from plant.spring import tension_slope

VOLTAGE_MARGIN = 1.0
"""Driven means this much [V] above what holds the largest tension against friction: after 0.1 s a thousandth of a
revolution lies behind the slowest motor."""

_MOTOR_MARGIN = 3.0
"""Times the motor's fastest speed without load: a reading that moves faster has jumped."""

_NAMES: Final = ("q", "theta_A", "theta_B", "F_A", "F_B")
_UNITS: Final = ("rad", "rad", "rad", "N", "N")
_MARGIN_N = 1.0


class SensorChecks:
    """Looks at every reading, whatever the mode, so that it knows the past when it counts."""

    def __init__(self, parameters: PlantParameters) -> None:
        self._tendons = plausibility.tendons_for(parameters)
        driven_V = _driving_voltage(parameters, "A"), _driving_voltage(parameters, "B")
        self._limits = Limits(_reach_in_a_tick(parameters), driven_V)
        self._past: Measurement | None = None
        self._memory: NDArray[np.float64] = plausibility.remembered(NOT_MEASURED)
        self._look = Specialised(
            plausibility.look,
            self._limits,
            self._tendons,
            self._memory,
            NOT_MEASURED,
            NOT_MEASURED,
            ZERO_VOLTS,
            False,
            1,
        )

    def step(
        self, raw: Measurement, m: Measurement, command: MotorCommand, zeroed: bool, missed: int
    ) -> tuple[Fault, str]:
        """Return the first fault found and what was seen, or ``Fault.NONE``.

        ``raw`` is as read, ``m`` has the motor encoders' zeros; ``command`` is what was written in the tick before;
        ``zeroed``: the zeros are known; ``missed``: deadlines missed since the last tick. All readings are numbers.
        """
        past, self._past = self._past, raw
        if past is None:
            self._memory = plausibility.remembered(raw)
            return Fault.NONE, ""
        found = self._look(self._limits, self._tendons, self._memory, raw, m, command, zeroed, 1 + missed)
        if found[0] == plausibility.CREDIBLE:
            return Fault.NONE, ""
        return _told(Verdict(*found), past, raw, m, command)


def _told(
    verdict: Verdict, past: Measurement, raw: Measurement, m: Measurement, command: MotorCommand
) -> tuple[Fault, str]:
    """Fault and words of a verdict."""
    what, side, still, excess = verdict
    if what == plausibility.JUMPED:
        way = f"{past[side]:.3f} to {raw[side]:.3f} {_UNITS[side]}"
        return Fault.SENSOR_JUMP, f"{_NAMES[side]} went from {way}"
    theta, F = _NAMES[1 + side], _NAMES[3 + side]
    if what == plausibility.REVERSED:
        return Fault.MOTOR_REVERSED, f"{theta} runs away from {command[side]:.1f} V, faster and faster"
    if what == plausibility.UNMOVED:
        stands = f"{theta} stands at {raw[1 + side]:.3f} rad although its motor gets {command[side]:.1f} V"
        return Fault.SENSOR_STUCK, stands
    if what == plausibility.STUCK:
        turned = f"although its motor turned by {plausibility.TURNED_RAD:g} rad"
        return Fault.SENSOR_STUCK, f"{F} stands at {raw[3 + side]:.2f} N {turned}"
    seen = f"{F} = {m[3 + side]:.1f} N, but the encoders stretch that spring to {m[3 + side] - excess:.1f} N"
    if still >= 0:
        return Fault.SENSOR_STUCK, f"{_NAMES[still]} stands still; {seen}"
    return Fault.IMPLAUSIBLE, seen


def _reach_in_a_tick(parameters: PlantParameters) -> tuple[float, float, float, float, float]:
    """How far q, theta_A, theta_B [rad], F_A, F_B [N] can move in a tick.

    The joint at the speed at which its damping takes up the largest tension; each motor at a multiple of its fastest;
    each load cell at that speed of the joint on the steepest part of its spring.
    """
    geometry, u_max = parameters.geometry, parameters.motor.u_max
    q_dot = geometry.r_j * parameters.safety.F_max / max(geometry.B_j, 1e-6)
    A, B = (_MOTOR_MARGIN * parameters.identified_of(side).K_m * u_max * T_s for side in SIDES)
    springs = (parameters.identified_spring(side) for side in SIDES)
    F_A, F_B = (tension_slope(spring, spring.x_solid) * geometry.r_j * q_dot * T_s + _MARGIN_N for spring in springs)
    return 1.2 * q_dot * T_s, A, B, F_A, F_B


def _driving_voltage(parameters: PlantParameters, side: Side) -> float:
    """Voltage [V] that is sure to turn a motor under any tension."""
    motor = parameters.motor_of(side)
    load = parameters.geometry.r_m * parameters.safety.F_max
    return (load * (1.0 + motor.c1) + motor.c0) / motor.K_t + VOLTAGE_MARGIN
