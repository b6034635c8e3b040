"""What an experiment plays, laid out, and where it was written. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass

from backend.errors import Path
from backend.models.run import Phase, Value
from backend.realtime.program import Segment, Touch
from plant.dynamics import Obstacle


@dataclass(frozen=True)
class Laid:
    """What the loop plays. ``places`` (one of each segment) say where it was written.

    ``changes`` are the tunings that segments put into use, each with all that differs from the one at the start, and
    ``change_places`` where they were written; ``walls`` and ``wall_places`` likewise what stands in the joint's way.
    ``touches`` are what contacts are given way to on the way.
    """

    segments: tuple[Segment, ...]
    places: tuple[Path, ...]
    phases: tuple[Phase, ...]
    changes: tuple[Mapping[str, Value], ...]
    change_places: tuple[Path, ...]
    walls: tuple[Obstacle | None, ...] = ()
    wall_places: tuple[Path, ...] = ()
    touches: tuple[Touch, ...] = ()
