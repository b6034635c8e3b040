"""Whether a plant's joint and stiffness may be brought where an experiment asks, told with line and bound. Pure."""

from backend.control.decoupler import bounds_for
from backend.errors import require_within
from backend.experiments.composing.laid import Laid
from backend.experiments.composing.refused import ExperimentError, Lines, at, line_of
from backend.realtime.program import OSCILLATING, left_at
from plant.dynamics import SUBSTEPS, require_possible
from plant.interface import PlantError, T_s
from plant.parameters import PlantParameters


def require_reach(laid: Laid, parameters: PlantParameters, lines: Lines) -> None:
    """Raise ExperimentError for the first reference outside the plant's bounds; what oscillates, on both sides.

    And for a wall that cannot stand in this plant's way.
    """
    bounds = bounds_for(parameters)
    q, S = 0.0, 0.0
    for segment, place in zip(laid.segments, laid.places, strict=True):
        asked = [(segment.q_ref, segment.S_ref)]
        if segment.shape in OSCILLATING:
            asked.append((2.0 * q - segment.q_ref, 2.0 * S - segment.S_ref))
        for q_ref, S_ref in asked:
            with at(place, lines):
                require_within("q_ref", q_ref, bounds.q_min, bounds.q_max, "rad", path=(*place, "q_ref"))
                require_within("S_ref", S_ref, bounds.S_min, bounds.S_max, "N·m/rad", path=(*place, "S_ref"))
        q, S = left_at(segment, q, S)
    g, joint = parameters.geometry, parameters.dynamics().joint
    for wall, place in zip(laid.walls, laid.wall_places, strict=True):
        try:
            if wall is not None:
                require_possible(wall, joint, parameters.safety.F_max, g.q_max, T_s / SUBSTEPS)
        except PlantError as error:
            raise ExperimentError(str(error), place, line_of(place, lines)) from None
