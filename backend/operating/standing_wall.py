"""What stands in the joint's way, for page and journal."""

from backend.messages.state import Wall
from plant.obstacle import Obstacle


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
