"""A push on the joint that an operator orders, where the plant can push (the simulator): held for a time and let go.

The loop itself lets go when the time is over and whenever it leaves the modes in which a hand may push, so that no push
outlives the page, the service or the control that ordered it.
"""

from backend.errors import require_within
from backend.loop.commands import Push, PushReleased
from backend.loop.mode import Mode, RefusedError
from plant.interface import Plant, PlantError, T_s

PUSH_MAX_S = 10.0
"""Longest push [s]: what is to last is ordered again."""

PUSHED_IN = (Mode.RUN, Mode.COMPLIANCE)
"""Modes in which an operator may push: the joint is under control, and no program pushes by itself."""


class HandPush:
    """At most one push at a time; a new one takes the place of the one before."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self._until: int | None = None

    @property
    def is_idle(self) -> bool:
        """Whether nothing is pushed by hand."""
        return self._until is None

    def begin(self, command: Push, tick: int, mode: Mode) -> None:
        """Push from ``tick`` on; 0 N lets go.

        Raises RefusedError in another mode, OutOfRangeError, and PlantError where nothing can push.
        """
        if command.F_push != 0.0 and mode not in PUSHED_IN:
            wanted = " and ".join(PUSHED_IN)
            raise RefusedError(f"a push takes a joint under the operator's control, in {wanted}; the mode is {mode}")
        require_within("F_push", command.F_push, None, None, "N")
        require_within("duration_s", command.duration_s, 0.0, PUSH_MAX_S, "s", "order it again to push for longer")
        if command.F_push == 0.0 and self._until is None:
            return  # a program's push is not an operator's to let go of
        self._plant.push(command.F_push)
        self._until = tick + round(command.duration_s / T_s) if command.F_push != 0.0 else None

    def step(self, tick: int, mode: Mode) -> tuple[PushReleased, ...]:
        """At the start of a tick: let go when the time is over or the mode is another, and tell so."""
        if self._until is None or (mode in PUSHED_IN and tick < self._until):
            return ()
        self._until = None
        try:
            self._plant.push(0.0)
        except PlantError:  # whoever pushes the plant has let go of it with it
            return ()
        return (PushReleased(tick, "its time is over" if mode in PUSHED_IN else f"the mode is {mode}"),)
