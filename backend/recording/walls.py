"""Which walls stood in the joint's way in the samples that are stored, from what the loop tells of them."""

from backend.documents.kept_wall import KeptWall, kept_wall
from backend.realtime.commands import WallChanged
from plant.dynamics import Obstacle
from plant.interface import T_s

_MOST_WAITING = 10_000


class Walls:
    """Changes that were told, until the samples in which they happened are stored. Belongs to the recorder.

    Both come by roads of their own: a change may be told before its sample is read, or a little after.
    """

    def __init__(self) -> None:
        self._waiting: list[WallChanged] = []
        self._standing: Obstacle | None = None
        self._first_tick = 0
        self._begins = False

    def tell(self, change: WallChanged) -> None:
        """Take note of a change."""
        self._waiting.append(change)
        if len(self._waiting) > _MOST_WAITING:  # of those before a run only the last counts
            self._standing = self._waiting.pop(0).wall

    def forget(self) -> None:
        """Begin anew with a loop in whose plant's way nothing stands."""
        self._waiting, self._standing = [], None

    def begin(self, tick: int) -> None:
        """Take note that the samples from ``tick`` on belong to another run."""
        self._first_tick, self._begins = tick, True

    def until(self, tick: int) -> list[KeptWall]:
        """Return what is to be kept of the run, whose samples up to ``tick`` are being stored."""
        due = [change for change in self._waiting if change.tick <= tick]
        kept = []
        if self._begins:
            before = [change.wall for change in due if change.tick <= self._first_tick]
            stands = before[-1] if before else self._standing
            kept = [] if stands is None else [kept_wall(0.0, stands)]
            due = due[len(before) :]
        return kept + [kept_wall(max(change.tick - self._first_tick, 0) * T_s, change.wall) for change in due]

    def stored(self, tick: int) -> None:
        """Take note that all up to ``tick`` is stored."""
        due = [change for change in self._waiting if change.tick <= tick]
        self._standing = due[-1].wall if due else self._standing
        self._waiting = self._waiting[len(due) :]
        self._begins = False
