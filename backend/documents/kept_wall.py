"""The walls that stood in a simulated joint's way during a run, as its settings keep them. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from plant.dynamics import Obstacle

MOST = 1000
"""So many changes are kept of a run; after the last of them no wall is known to stand."""


@dataclass(frozen=True)
class KeptWall:
    """What stands from ``t`` [s] since the run's first sample on; ``side`` 0 is no wall, the rest as in Obstacle."""

    t: float
    side: float
    q_wall: float
    k_wall: float
    c_wall: float

    @property
    def obstacle(self) -> Obstacle | None:
        """The wall; None for no wall."""
        return Obstacle(self.side, self.q_wall, self.k_wall, self.c_wall) if self.side else None


def kept_wall(t: float, wall: Obstacle | None) -> KeptWall:
    """Return what is kept of a change at ``t`` [s]."""
    return KeptWall(t, 0.0, 0.0, 0.0, 0.0) if wall is None else KeptWall(t, *map(float, wall))


def joined(earlier: Sequence[KeptWall], later: Sequence[KeptWall]) -> tuple[KeptWall, ...]:
    """Return all changes in order of time, the later told of two at one moment; past MOST, that no wall is known."""
    by_time = {change.t: change for change in (*earlier, *later)}
    changes = [by_time[t] for t in sorted(by_time)]
    if len(changes) > MOST:
        changes = [*changes[: MOST - 1], kept_wall(changes[MOST - 1].t, None)]
    return tuple(changes)


def standing(changes: Sequence[KeptWall], t: float) -> Obstacle | None:
    """Return what stands at ``t`` [s] since the run's first sample; None for no wall."""
    before = [change for change in changes if change.t <= t]
    return before[-1].obstacle if before else None
