"""How far a run is, as the state shows it: of the time that it was expected to take when it was ordered."""

from backend.experiments.playing.play import Notify
from backend.messages.state import TaskView
from backend.operating.present_state import PresentState


def run_progress(present: PresentState, kind: str, run: int, duration_s: float, following: int) -> Notify:
    """Return what puts into ``present`` how far a run is; ``following`` runs of the same order come after it.

    What it is told counts from the start of each phase; what is shown counts from the start of the run.
    """
    before_s = 0.0

    def show(phase: str, elapsed_s: float) -> None:
        nonlocal before_s
        if phase == "pretension":
            before_s = elapsed_s
        passed_s = {"starting": 0.0, "pretension": elapsed_s, "program": before_s + elapsed_s}.get(phase, duration_s)
        present.task = TaskView(
            kind=kind, run=run, elapsed_s=passed_s, duration_s=duration_s, phase=phase, following=following
        )

    return show
