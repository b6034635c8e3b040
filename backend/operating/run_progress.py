"""How far a run is, as the state shows it: of the time that it was expected to take when it was ordered."""

from backend.experiments.playing.progress import Doing, Notify
from backend.messages.state import TaskView
from backend.operating.present_state import PresentState


def run_progress(present: PresentState, kind: str, run: int, duration_s: float, following: int) -> Notify:
    """Return what puts into ``present`` how far a run is; ``following`` runs of the same order come after it.

    What it is told counts from the start of each part; what is shown counts from the start of the run.
    """
    before_s = 0.0

    def show(doing: Doing, elapsed_s: float) -> None:
        nonlocal before_s
        if doing is Doing.PRETENSION:
            before_s = elapsed_s
        passed_s = {
            Doing.STARTING: 0.0,
            Doing.PRETENSION: elapsed_s,
            Doing.PROGRAM: before_s + elapsed_s,
            Doing.EVALUATION: duration_s,
        }[doing]
        present.task = TaskView(
            kind=kind, run=run, elapsed_s=passed_s, duration_s=duration_s, phase=doing, following=following
        )

    return show
