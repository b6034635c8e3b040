"""An obstacle in the joint's way: a wall that gives way like a spring with damping, and never pulls. Pure.

The contact law is that of Hunt and Crossley (1975), linear in the depth: F = k δ (1 + c δ') while δ > 0 and never below
0. Its force begins and ends at 0, where a spring with a damper beside it jumps at the touch and sticks at the end. On a
rate of approach v it gives back the speed -w with c v − ln(1 + c v) = −c w − ln(1 − c w), whatever stiffness and mass.
"""

import math
from typing import NamedTuple, Protocol, runtime_checkable

from plant.compiled import compiled
from plant.interface import PlantError
from plant.joint import Joint


class Obstacle(NamedTuple):
    """A wall at ``q_wall`` [rad]. ``side``: 1 stands above it and lets the joint be below, -1 below, 0 is no wall.

    ``k_wall`` [N/m] is its stiffness and ``c_wall`` [s/m] its damping, both where the tendon runs, tangential at r_j.
    """

    side: float
    q_wall: float
    k_wall: float
    c_wall: float


NO_OBSTACLE = Obstacle(0.0, 0.0, 0.0, 0.0)


@runtime_checkable
class Obstructed(Protocol):
    """A plant in whose way a wall can be put (what is simulated)."""

    def obstacle(self, obstacle: Obstacle | None) -> None:
        """Put a wall in the joint's way from the next period on, None takes it away. PlantError for what cannot be."""
        ...


K_LEAST = 100.0
"""Least stiffness of a wall [N/m]; a softer one would let the whole joint's range through."""

STEP_ANGLE = 0.15
"""Largest angle [rad] by which the undamped joint at the wall oscillates in an integration step: 21 in each contact."""


@compiled
def contact_force(obstacle: Obstacle, joint: Joint, q: float, q_dot: float) -> float:
    """Force [N] of the wall on the joint at r_j, positive towards +q; 0 without contact and without a wall."""
    depth = joint.r_j * obstacle.side * (q - obstacle.q_wall)
    if depth <= 0.0 or obstacle.side == 0.0:
        return 0.0
    pressed = obstacle.k_wall * depth * (1.0 + obstacle.c_wall * joint.r_j * obstacle.side * q_dot)
    return -obstacle.side * max(pressed, 0.0)


@compiled
def beside(obstacle: Obstacle, joint: Joint, q: float, q_dot: float, tau_ext: float) -> float:
    """Return the external joint torque [N·m] with the wall's; to the last bit what it was where there is none."""
    if obstacle.side == 0.0:
        return tau_ext
    return tau_ext + joint.r_j * contact_force(obstacle, joint, q, q_dot)


def stiffest(joint: Joint, step_s: float) -> float:
    """Stiffness [N/m] of the wall at which the joint alone turns its phase by STEP_ANGLE in a step of the integration.

    With m = J_j/r_j² it oscillates at √(k/m); the Runge-Kutta steps are stable up to an angle of 2.8 and off by less
    than a thousandth of the peak up to this one.
    """
    return joint.J_j / joint.r_j**2 * (STEP_ANGLE / step_s) ** 2


def most_damped(joint: Joint, F_max: float, step_s: float) -> float:
    """Damping [s/m] that brakes the joint, pressed by F_max [N], with a time constant of one step: c F = m/h."""
    return joint.J_j / (joint.r_j**2 * step_s * F_max)


def require_possible(obstacle: Obstacle, joint: Joint, F_max: float, q_max: float, step_s: float) -> None:
    """Raise PlantError for a wall that cannot be, or that steps of ``step_s`` [s] do not resolve on this joint."""
    if obstacle.side not in (-1.0, 1.0):
        raise PlantError(f"side of the wall: {obstacle.side:g} is neither 1 (above q_wall) nor -1 (below it)")
    k_max, c_max = stiffest(joint, step_s), most_damped(joint, F_max, step_s)
    for words, value, low, high, unit, remedy in (
        ("angle of the wall", obstacle.q_wall, -q_max, q_max, "rad", "the safety module stops the joint there"),
        (
            "stiffness of the wall",
            obstacle.k_wall,
            K_LEAST,
            k_max,
            "N/m",
            "the simulator's steps resolve no stiffer one",
        ),
        ("damping of the wall", obstacle.c_wall, 0.0, c_max, "s/m", "the simulator's steps resolve no stronger one"),
    ):
        if not (math.isfinite(value) and low <= value <= high):
            raise PlantError(f"{words}: {value:g} {unit} is outside {low:.6g} to {high:.6g} {unit}; {remedy}")


def require_free(obstacle: Obstacle, q: float) -> None:
    """Raise PlantError for a wall that would stand where the joint is [rad]: it would be thrown out."""
    if not obstacle.side * (q - obstacle.q_wall) <= 0.0:
        where = "above" if obstacle.side < 0.0 else "below"
        raise PlantError(
            f"the joint stands at {q:.4g} rad, in a wall at {obstacle.q_wall:.4g} rad: bring it {where} that first, "
            "or put the wall elsewhere"
        )
