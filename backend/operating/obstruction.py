"""A wall in the way of a simulated joint: put up and taken away in flight."""

from backend.errors import Because, RefusalError, require_within
from backend.operating.actuator import Actuator
from backend.operating.standing_wall import wall_bounds, wall_in_words
from backend.realtime.commands import Obstruct
from backend.schemas.state import Wall, WallOrder
from plant.dynamics import Obstacle
from plant.parameters import PlantParameters


async def obstruct(actuator: Actuator, order: WallOrder, who: str) -> WallOrder:
    """Put a wall up, or take it away.

    Raises RefusalError on what is not simulated, where the joint stands in it and while a program puts up its own, and
    OutOfRangeError.
    """
    plant = actuator.present.plant
    if not plant.simulated:
        message = f"a wall is put only in the way of what is simulated, and what is driven is the {plant.name}"
        raise RefusalError(Because.NOT_NOW, message, code="not_a_simulator")
    wall = None if order.wall is None else _possible(order.wall, actuator.present.parameters)
    await actuator.carry_out(Obstruct(wall), wall_in_words(wall), who)
    return order


def _possible(wall: Wall, parameters: PlantParameters) -> Obstacle:
    bounds, q_max = wall_bounds(parameters), parameters.geometry.q_max
    remedy = "the simulator's steps do not resolve more"
    require_within("q_wall", wall.q_wall, -q_max, q_max, "rad", path=("wall", "q_wall"))
    require_within("k_wall", wall.k_wall, bounds.k_min, bounds.k_max, "N/m", remedy, path=("wall", "k_wall"))
    require_within("c_wall", wall.c_wall, 0.0, bounds.c_max, "s/m", remedy, path=("wall", "c_wall"))
    return Obstacle(1.0 if wall.side == "above" else -1.0, wall.q_wall, wall.k_wall, wall.c_wall)
