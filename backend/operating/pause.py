"""A pause between two runs of one order: the actuator stands in pretension until the next one is let begin."""

import asyncio
from collections.abc import Callable

from backend.errors import Because, RefusalError
from backend.execution.runner import SLICE_S, NotReadyError, mode_of
from backend.operating.present_state import PresentState
from backend.realtime.program import Mode
from backend.realtime.supervisor import LoopAccess

_TAKEN_AWAY = {
    Mode.OFF: "the motors were switched off",
    Mode.STOPPING: "it was stopped softly",
    Mode.TRIPPED: "a fault or STOP took the motors",
}


class Pause:
    """Between runs is the only safe point: within one the loop plays a program whole, and its record is of one piece.

    ``wanted`` is what was last asked for of the order under way; ``following`` are its runs that have still to begin.
    """

    def __init__(self, present: PresentState, changed: Callable[[], None]) -> None:
        self.wanted = False
        self.following = 0
        self._present = present
        self._changed = changed

    def begin(self, following: int) -> None:
        """Take note of an order whose first run begins; with none ``following``, that no further one will."""
        self.wanted, self.following = False, following

    def ask(self, wanted: bool) -> None:
        """Let the next run of the order wait, or begin. Raises RefusalError where none follows."""
        task = self._present.task
        if task is None or self.following == 0:
            what = "nothing is under way" if task is None else "no run of the same order follows"
            remedy = "several tensions in turn can be paused between two of them"
            raise RefusalError(Because.NOT_NOW, f"{what}: {remedy}")
        self.wanted = wanted
        self._present.task = task.model_copy(update={"pause_wanted": wanted})
        self._changed()

    async def over(self, loop: LoopAccess, show: Callable[[], None]) -> None:
        """Wait as long as a pause is wanted; then the next run begins, and one less follows.

        ``show`` tells meanwhile that the order waits. Raises NotReadyError once the motors were let go, LoopDiedError.
        """
        while self.wanted:
            show()
            await loop.advance(SLICE_S)
            await asyncio.sleep(0)  # a loop that is computed takes no time: others have their turn
            if (why := _TAKEN_AWAY.get(mode := mode_of(loop))) is not None:
                raise NotReadyError(f"{why} in its pause", mode)
        self.following -= 1  # at once: a pause behind the last run is not to be asked for while that one is prepared


def not_begun(run: int, why: Exception, count: int) -> str:
    """Say why an order ended after a run, and that ``count`` runs of it were not begun."""
    runs, them = ("1 run was", "it") if count == 1 else (f"{count} runs were", "them")
    return f"The order ended after run {run}: {str(why).rstrip('.')}; {runs} not begun. Order {them} anew."
