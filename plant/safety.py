"""The independent safety module: watches the springs and the joint, cuts the motors, stays tripped."""

from typing import NamedTuple

from plant.compiled import compiled
from plant.dynamics import Dynamics, PlantState
from plant.joint import elongation_A, elongation_B
from plant.spring import tension


class SafetyBounds(NamedTuple):
    """``F_max`` [N] on each tendon, ``q_max`` [rad] to either side."""

    F_max: float
    q_max: float


@compiled
def exceeded(plant: Dynamics, bounds: SafetyBounds, x: PlantState) -> bool:
    """Tell whether a tendon force or the joint position is beyond its bound, by the module's own sensors."""
    F_A = tension(plant.spring_A, elongation_A(plant.joint, x.theta_A, x.q))
    F_B = tension(plant.spring_B, elongation_B(plant.joint, x.theta_B, x.q))
    return bounds.F_max < F_A or bounds.F_max < F_B or abs(x.q) > bounds.q_max
