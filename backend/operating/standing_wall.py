"""What stands in the joint's way, for page and journal."""

from typing import NamedTuple

from backend.schemas.state import Wall
from plant.dynamics import K_LEAST, SUBSTEPS, Obstacle, most_damped, stiffest
from plant.interface import T_s
from plant.parameters import PlantParameters


class WallBounds(NamedTuple):
    """Least and largest stiffness [N/m] and largest damping [s/m] of a wall; all 0 where none can be put up."""

    k_min: float
    k_max: float
    c_max: float


NO_WALL_POSSIBLE = WallBounds(0.0, 0.0, 0.0)


def wall_bounds(parameters: PlantParameters) -> WallBounds:
    """Return what the steps of the simulation resolve of a wall."""
    joint, step_s = parameters.dynamics().joint, T_s / SUBSTEPS
    return WallBounds(K_LEAST, stiffest(joint, step_s), most_damped(joint, parameters.safety.F_max, step_s))


def wall_in_words(wall: Obstacle | None) -> str:
    """Say what stands in the joint's way."""
    if wall is None:
        return "no wall"
    side = "above" if wall.side > 0.0 else "below"
    return f"wall {side} {wall.q_wall:.4g} rad, {wall.k_wall:.4g} N/m, {wall.c_wall:.4g} s/m"


def wall_view(wall: Obstacle | None) -> Wall | None:
    """Return a wall as the page shows it."""
    if wall is None:
        return None
    side, q_wall, k_wall, c_wall = wall
    return Wall(q_wall=q_wall, side="above" if side > 0.0 else "below", k_wall=k_wall, c_wall=c_wall)
