"""The plant that a preview simulates: what was identified, with the friction and the sensors of the parameter file.

A preview must not know more than the operator can: it has the identified motors and springs, not the simulator's true
ones, and no scatter between the two sides. Friction, electrical lag, encoder counts and the delay of the load cells
are those of the parameter set in use.
"""

from dataclasses import replace
from typing import Any

from plant.parameters import SIDES, Asymmetry, PlantParameters

_ALIKE = Asymmetry(spring_A=1.0, spring_B=1.0, motor_A=1.0, motor_B=1.0)


def expected_plant(parameters: PlantParameters) -> PlantParameters:
    """Return the set whose true motors and springs are the identified ones of ``parameters``, without asymmetry."""
    sided: dict[str, dict[str, Any]] = dict(parameters.sided)
    for side in SIDES:
        known = parameters.identified_of(side)
        motor, spring = (parameters.sided.get(f"{section}_{side}", {}) for section in ("motor", "spring"))
        sided[f"motor_{side}"] = {**motor, "K_m": known.K_m, "T_m": known.T_m}
        sided[f"spring_{side}"] = {**spring, "k": known.k, "points": known.points}
    return replace(parameters, asymmetry=_ALIKE, sided=sided)
