"""The geared DC motor: equations 6-9 at the gearbox outlet."""

from typing import NamedTuple

from plant.compiled import compiled
from plant.friction import Friction, friction_torque


class Motor(NamedTuple):
    """Constants at the gearbox outlet.

    ``J_m`` [kg·m²], ``B_m`` [N·m·s/rad] with the back-EMF in it, ``K_t`` [N·m/V] = μ N K_mu / R,
    ``tau_e`` [s] = L/R, and the friction.
    """

    J_m: float
    B_m: float
    K_t: float
    tau_e: float
    friction: Friction


@compiled
def motor_torque_rate(motor: Motor, tau: float, u: float) -> float:
    """D tau_m/dt [N·m/s]: tau_m = K_t/(L/R s + 1) u (equations 8, 9)."""
    return (motor.K_t * u - tau) / motor.tau_e


@compiled
def motor_acceleration(motor: Motor, omega: float, tau: float, load: float, z: float) -> float:
    """Theta'' [rad/s²]: J_m theta'' + B_m theta' + r_m F + friction = tau_m (equations 6, 7), bristles at z [rad]."""
    return (tau - motor.B_m * omega - load - friction_torque(motor.friction, omega, load, z)) / motor.J_m
