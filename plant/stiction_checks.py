"""What a motor's numbers must have in common for its friction to stick."""

import math

from plant.dynamics import SUBSTEPS
from plant.interface import T_s
from plant.parameter_entries import ParameterError
from plant.parameter_sections import MotorParameters

_COMPANIONS = ("sigma_1", "stiction_ratio", "omega_s")


def require_stiction(label: str, motor: MotorParameters, *, given: bool) -> None:
    """Raise ParameterError for friction that can neither stick nor be smoothed; ``given``: sigma_0 was, maybe as 0."""
    if motor.sigma_0 == 0.0:
        alone = [name for name in _COMPANIONS if getattr(motor, name) != 0.0]
        if alone and not given:
            raise ParameterError(
                f"{label}.sigma_0 is missing, without which {' and '.join(alone)} say nothing: give it, 0 for smoothed "
                "Coulomb friction"
            )
        return
    for name in ("stiction_ratio", "omega_s"):
        if getattr(motor, name) == 0.0:
            raise ParameterError(f"{label}.{name} is missing: with sigma_0 above 0 friction sticks, and needs it")
    if motor.c0 == 0.0:
        raise ParameterError(
            f"{label}.c0 = 0 N·m with sigma_0 above 0: a slack tendon leaves nothing to stick by, give c0 above 0"
        )
    _require_steps_short_enough(label, motor)


def _require_steps_short_enough(label: str, motor: MotorParameters) -> None:
    """Refuse bristles on which the motor swings faster than a Runge-Kutta step can follow."""
    at_most, J_m = SUBSTEPS / T_s, motor.motor().J_m
    for name, rate in (("sigma_0", math.sqrt(motor.sigma_0 / J_m)), ("sigma_1", motor.sigma_1 / J_m)):
        if rate > at_most:
            raise ParameterError(
                f"{label}.{name} = {getattr(motor, name):g} on a motor of {J_m:.3g} kg·m² is {rate:.3g}/s fast, above "
                f"the {at_most:g}/s that the simulator's steps resolve: lower it"
            )
