"""How far a run is, as the state shows it: of the time that it was expected to take when it was ordered."""

from backend.api.picture import Picture
from backend.api.schemas.state import TaskView
from backend.experiments.playing import Notify


def run_progress(picture: Picture, kind: str, run: int, duration_s: float, following: int) -> Notify:
    """Return what puts into ``picture`` how far a run is; ``following`` runs of the same order come after it.

    What it is told counts from the start of each phase; what is shown counts from the start of the run.
    """
    before_s = 0.0

    def show(phase: str, elapsed_s: float) -> None:
        nonlocal before_s
        if phase == "pretension":
            before_s = elapsed_s
        passed_s = {"starting": 0.0, "pretension": elapsed_s, "program": before_s + elapsed_s}.get(phase, duration_s)
        picture.task = TaskView(
            kind=kind, run=run, elapsed_s=passed_s, duration_s=duration_s, phase=phase, following=following
        )

    return show
