"""Whether the plant can be read and written: told when that begins and when it is over, not in every tick."""

from backend.loop.commands import Event, PlantAnswers, PlantFailing
from plant.interface import T_s

ANSWERS_S = 1.0
"""So long without a failure [s] and the plant answers again: one that fails now and then is told of once."""


class PlantWatch:
    """Counts ticks without a failure. ``failure`` is what went wrong in the present tick, empty when nothing did."""

    def __init__(self) -> None:
        self.failure = ""
        self._told = False
        self._good_ticks = 0

    @property
    def answers(self) -> bool:
        """Whether nothing has to be told of the plant unless it fails."""
        return not self._told

    def begin(self) -> None:
        """Begin a tick."""
        self.failure = ""

    def end(self, tick: int) -> list[Event]:
        """End a tick; return what has changed."""
        self._good_ticks = 0 if self.failure else self._good_ticks + 1
        if self.failure and not self._told:
            self._told = True
            return [PlantFailing(tick, self.failure)]
        if self._told and self._good_ticks * T_s >= ANSWERS_S:
            self._told = False
            return [PlantAnswers(tick)]
        return []
