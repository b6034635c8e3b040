"""How far a run is, as the state shows it: of the time that it is expected to take."""

from dataclasses import dataclass

from backend.execution.runner import Doing, Notify
from backend.experiments.forecast import Expected, Stage
from backend.experiments.plans import KIND, ComposedPlan, Plan
from backend.operating.pause import Pause
from backend.operating.present_state import PresentState
from backend.plain_text import as_line
from backend.schemas.state import PartView, TaskView
from plant.interface import T_s


@dataclass(frozen=True)
class Part:
    """A part of a program until ``end_s`` after its begin, the ``number``th ``of``; ``doing`` what at a set point."""

    title: str
    number: int
    of: int
    end_s: float
    doing: Stage | None = None


@dataclass(frozen=True)
class Ordered:
    """A run of a plan, as it is expected to go: the ``number``th ``of`` those that were ordered together."""

    plan: Plan
    run: int
    expected: Expected
    number: int = 1
    of: int = 1

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts of its program by their times; set points are counted over all that was ordered together."""
        told = self.expected.timetable
        if told is None:
            phases = self.plan.phases()
            return tuple(Part(one.title, at, len(phases), one.end_s) for at, one in enumerate(phases, start=1))
        return tuple(
            Part(
                title=told.title(one),
                number=(self.number - 1) * one.of + one.number,
                of=self.of * one.of,
                end_s=one.end * T_s,
                doing=one.stage,
            )
            for one in told.stretches
        )


def run_progress(present: PresentState, ordered: Ordered, pause: Pause) -> Notify:
    """Return what puts into ``present`` how far a run is.

    What it is told counts from the start of each part; what is shown counts from the start of the run. Once the program
    plays, the way to it took as long as it took.
    """
    before_s, expected_s, parts = 0.0, ordered.expected.duration_s, ordered.parts
    plan = ordered.plan
    title = as_line(plan.experiment.title) if isinstance(plan, ComposedPlan) and plan.kind == KIND else ""

    def show(doing: Doing, elapsed_s: float) -> None:
        nonlocal before_s, expected_s
        if doing is Doing.PRETENSION:
            before_s = elapsed_s
        if doing is Doing.PROGRAM:
            expected_s = before_s + ordered.expected.program_s
        passed_s = {
            Doing.STARTING: 0.0,
            Doing.PRETENSION: elapsed_s,
            Doing.PROGRAM: before_s + elapsed_s,
            Doing.PAUSED: expected_s,
            Doing.EVALUATION: expected_s,
        }[doing]
        present.task = TaskView(
            kind=plan.kind,
            title=title,
            run=ordered.run,
            elapsed_s=passed_s,
            duration_s=expected_s,
            phase=doing,
            part=part_at(parts, elapsed_s) if doing is Doing.PROGRAM else None,
            number=ordered.number,
            following=pause.following,
            pause_wanted=pause.wanted,
        )

    return show


def part_at(parts: tuple[Part, ...], t: float) -> PartView | None:
    """Return the part of a program ``t`` [s] after its start; what is past the end is in the last one."""
    if not parts:
        return None
    part = next((one for one in parts if t < one.end_s), parts[-1])
    left_s = max(0.0, part.end_s - t)
    return PartView(title=part.title, number=part.number, of=part.of, doing=part.doing, left_s=left_s, t=t)
