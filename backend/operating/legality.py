"""Whether the actuator may go to another mode now, and in which words it is refused."""

from backend.errors import Because, RefusalError
from backend.operating.present_state import PresentState
from backend.realtime.program import LEGAL, MOVING, Mode


def require_legal(present: PresentState, wanted: Mode, *, loop_alive: bool) -> None:
    """Raise RefusalError for a mode that cannot be gone to; a dead or unready loop says so itself."""
    mode = present.mode
    legal = present.legal(mode)
    paused = present.task is not None and present.task.paused and wanted in MOVING
    if wanted in legal or (present.unready and wanted in LEGAL[mode] and not paused) or not loop_alive:
        return
    if mode is Mode.TRIPPED:
        reason = "a fault is latched: reset it first"
    elif wanted in LEGAL[mode] and paused:
        reason = "the order under way is paused, and its next run starts from pretension: go on, or stop softly"
    elif wanted in LEGAL[mode]:
        reason = f"{wanted} has to wait until both tendons hold the pretension"
    else:
        reason = f"{mode} cannot go to {wanted}"
    names = [str(choice) for choice in legal]
    raise RefusalError(
        Because.NOT_NOW, f"{reason}; legal now: {', '.join(names) or 'none'}", code="illegal_mode", legal=names
    )
