"""How far a run is, as the state shows it: of the time that it was expected to take when it was ordered."""

from dataclasses import dataclass

from backend.documents.result import Phase
from backend.experiments.plans.plan import IdentificationPlan, Plan
from backend.experiments.playing.progress import Doing, Notify
from backend.messages.state import PartView, TaskView
from backend.operating.present_state import PresentState


@dataclass(frozen=True)
class Ordered:
    """A run of a plan, expected to take ``duration_s``: the ``number``th ``of`` those that were ordered together."""

    plan: Plan
    run: int
    duration_s: float
    number: int = 1
    of: int = 1

    @property
    def parts(self) -> tuple[Phase, ...]:
        """The parts of its program by their times; none of what first travels for as long as that takes."""
        return () if isinstance(self.plan, IdentificationPlan) else self.plan.phases()


def run_progress(present: PresentState, ordered: Ordered) -> Notify:
    """Return what puts into ``present`` how far a run is.

    What it is told counts from the start of each part; what is shown counts from the start of the run.
    """
    before_s, parts = 0.0, ordered.parts

    def show(doing: Doing, elapsed_s: float) -> None:
        nonlocal before_s
        if doing is Doing.PRETENSION:
            before_s = elapsed_s
        passed_s = {
            Doing.STARTING: 0.0,
            Doing.PRETENSION: elapsed_s,
            Doing.PROGRAM: before_s + elapsed_s,
            Doing.EVALUATION: ordered.duration_s,
        }[doing]
        present.task = TaskView(
            kind=ordered.plan.kind,
            run=ordered.run,
            elapsed_s=passed_s,
            duration_s=ordered.duration_s,
            phase=doing,
            part=part_at(parts, elapsed_s) if doing is Doing.PROGRAM else None,
            number=ordered.number,
            following=ordered.of - ordered.number,
        )

    return show


def part_at(parts: tuple[Phase, ...], t: float) -> PartView | None:
    """Return the part of a program ``t`` [s] after its start; what is past the end is in the last one."""
    if not parts:
        return None
    at = next((place for place, part in enumerate(parts) if t < part.end_s), len(parts) - 1)
    left_s = max(0.0, parts[at].end_s - t)
    return PartView(title=parts[at].title, number=at + 1, of=len(parts), left_s=left_s, t=t)
