"""The joint: tendon elongations, torque balance, stiffness (equations 1, 2, 5, 13-16)."""

from typing import NamedTuple

from plant.compiled import compiled
from plant.spring import Spring, tension_slope


class Joint(NamedTuple):
    """``r_m``, ``r_j`` [m], ``J_j`` [kg·m²], ``B_j`` [N·m·s/rad]."""

    r_m: float
    r_j: float
    J_j: float
    B_j: float


@compiled
def elongation_A(joint: Joint, theta_A: float, q: float) -> float:
    """Elongation of spring A [m] (equation 1)."""
    return joint.r_m * theta_A - joint.r_j * q


@compiled
def elongation_B(joint: Joint, theta_B: float, q: float) -> float:
    """Elongation of spring B [m] (equation 2)."""
    return joint.r_m * theta_B + joint.r_j * q


@compiled
def joint_acceleration(joint: Joint, q_dot: float, F_A: float, F_B: float, tau_ext: float) -> float:
    """Q'' [rad/s²]: J_j q'' + B_j q' = r_j (F_A − F_B) + tau_ext (equations 5, 13)."""
    return (joint.r_j * (F_A - F_B) + tau_ext - joint.B_j * q_dot) / joint.J_j


@compiled
def joint_stiffness(joint: Joint, spring_A: Spring, spring_B: Spring, x_A: float, x_B: float) -> float:
    """S = −∂φ/∂q = r_j² (F_A'(x_A) + F_B'(x_B)) [N·m/rad] (equation 14; exact off equilibrium too, erratum E4)."""
    return joint.r_j**2 * (tension_slope(spring_A, x_A) + tension_slope(spring_B, x_B))
