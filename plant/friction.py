"""Coulomb friction at the gearbox outlet that grows with the tendon load."""

import math
from typing import NamedTuple

from plant.compiled import compiled


class Friction(NamedTuple):
    """``c0`` [N·m] without load, ``c1`` [1] times the load torque r_m F, smoothed over ``omega_smooth`` [rad/s]."""

    c0: float
    c1: float
    omega_smooth: float


@compiled
def friction_torque(friction: Friction, omega: float, load: float) -> float:
    """Torque [N·m] against the motion at outlet speed omega [rad/s] under load torque r_m F [N·m]."""
    return (friction.c0 + friction.c1 * load) * math.tanh(omega / friction.omega_smooth)
