"""What the encoders say about the tendons: each tension twice, by its load cell and by the spring that it stretches."""

from typing import NamedTuple

from plant.compiled import compiled
from plant.interface import Measurement
from plant.parameters import PlantParameters
from plant.spring import Spring, tension


class Tendons(NamedTuple):
    """Radii [m] and the identified springs."""

    r_m: float
    r_j: float
    spring_A: Spring
    spring_B: Spring


@compiled
def contradictions(tendons: Tendons, m: Measurement) -> tuple[float, float]:
    """Load cell minus spring force at the elongation that the encoders give [N], for tendons A and B.

    A spring that is solid counts with the force at which it became so: beyond it, one encoder count is 12 N.
    """
    x_A = tendons.r_m * m.theta_A - tendons.r_j * m.q
    x_B = tendons.r_m * m.theta_B + tendons.r_j * m.q
    F_A = min(tension(tendons.spring_A, x_A), tendons.spring_A.F_solid)
    F_B = min(tension(tendons.spring_B, x_B), tendons.spring_B.F_solid)
    return m.F_A - F_A, m.F_B - F_B


def tendons_for(parameters: PlantParameters) -> Tendons:
    """Tendons of a parameter set, as the controller knows them."""
    geometry = parameters.geometry
    return Tendons(geometry.r_m, geometry.r_j, parameters.identified_spring("A"), parameters.identified_spring("B"))
