"""Static decoupler: from joint position and stiffness to motor positions and back (equations 18-21)."""

from typing import NamedTuple

from plant.compiled import compiled
from plant.parameters import PlantParameters


class Decoupler(NamedTuple):
    """Geometry and identified spring: ``r_m``, ``r_j`` [m], ``k_1`` [N/m], ``k_2`` [N/m²]."""

    r_m: float
    r_j: float
    k_1: float
    k_2: float


@compiled
def motor_positions(d: Decoupler, q_c: float, S_c: float) -> tuple[float, float]:
    """theta_A, theta_B [rad] that hold q_c [rad] and S_c [N·m/rad] at equilibrium (equations 18, 19)."""
    difference = d.r_j / d.r_m * q_c
    common = (S_c - 2.0 * d.k_1 * d.r_j**2) / (4.0 * d.k_2 * d.r_j**2 * d.r_m)
    return difference + common, -difference + common


@compiled
def stiffness(d: Decoupler, theta_A: float, theta_B: float) -> float:
    """S [N·m/rad] estimated from motor positions: 2 r_j² (k1 + k2 r_m (θ_A + θ_B)) (equation 16, order 2)."""
    return 2.0 * d.r_j**2 * (d.k_1 + d.k_2 * d.r_m * (theta_A + theta_B))


@compiled
def equilibrium(d: Decoupler, theta_A: float, theta_B: float) -> float:
    """q_e [rad] at which the joint rests without load (equation 15)."""
    return d.r_m * (theta_A - theta_B) / (2.0 * d.r_j)


def decoupler_for(parameters: PlantParameters) -> Decoupler:
    """Decoupler of a parameter set's geometry and nominal spring."""
    k = parameters.spring.k
    return Decoupler(parameters.geometry.r_m, parameters.geometry.r_j, k[1], k[2])
