"""When something is done to the loop: after which tick, and after what was measured."""

from typing import NamedTuple

from plant.interface import Measurement


class Now(NamedTuple):
    """The newest tick, and what was measured in it."""

    tick: int
    m: Measurement
