"""A pause between two runs of one order: the actuator stands in pretension until the next one is let begin."""

import asyncio
from collections.abc import Callable

from backend.experiments.playing.play import SLICE_S, mode_of
from backend.loop.access import LoopAccess
from backend.loop.mode import Mode
from backend.operating.present_state import PresentState
from backend.refusal import Because, RefusalError

_TAKEN_AWAY = (Mode.OFF, Mode.STOPPING, Mode.TRIPPED)


class Pause:
    """Between runs is the only safe point: within one the loop plays a program whole, and its record is of one piece.

    ``wanted`` is what was last asked for of the order under way.
    """

    def __init__(self, present: PresentState, changed: Callable[[], None]) -> None:
        self.wanted = False
        self._present = present
        self._changed = changed

    def ask(self, wanted: bool) -> None:
        """Let the next run of the order wait, or begin. Raises RefusalError where none follows."""
        task = self._present.task
        if task is None or task.following == 0:
            what = "nothing is under way" if task is None else f"no run of the same order follows run {task.run}"
            remedy = "several tensions in turn can be paused between two of them"
            raise RefusalError(Because.NOT_NOW, f"{what}: {remedy}")
        self.wanted = wanted
        self._present.task = task.model_copy(update={"pause_wanted": wanted})
        self._changed()

    async def over(self, loop: LoopAccess, show: Callable[[], None]) -> bool:
        """Wait as long as a pause is wanted; whether the next run may begin. It may not once the motors were let go.

        ``show`` tells meanwhile that the order waits.
        """
        while self.wanted:
            show()
            await loop.advance(SLICE_S)
            await asyncio.sleep(0)  # a loop that is computed takes no time: others have their turn
            if mode_of(loop) in _TAKEN_AWAY:
                return False
        return True
