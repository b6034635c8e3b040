"""How the steps of the bring-up are shown."""

from backend.commissioning.steps import STEPS, Standing, Step, StepState
from backend.schemas.commissioning import BringUpStep, BringUpView, RunningStep, StepFigure, StepInput, StepResult
from backend.storage.commissioning import StepResult as Stored


def nothing_to_do(why_not: str) -> BringUpView:
    """Return the steps where there is no rig to be brought up."""
    never = Standing(StepState.NEVER, why_not)
    return BringUpView(
        applies=False,
        why_not=why_not,
        drives_on=None,
        drives_locked=False,
        drives_left=None,
        steps=[step_view(step, never, None, why_not, None) for step in STEPS],
    )


def step_view(
    step: Step, standing: Standing, result: Stored | None, blocked: str, running: RunningStep | None
) -> BringUpStep:
    """Return one step, with its newest result."""
    return BringUpStep(
        id=step.id,
        title=step.title,
        instruction=step.instruction,
        inputs=[StepInput(**vars(asked)) for asked in step.inputs],
        state=standing.state,
        why=standing.why,
        blocked=blocked,
        result=None if result is None else _result(result),
        running=running,
    )


def _result(stored: Stored) -> StepResult:
    figures = [StepFigure(**figure) for figure in stored.figures]
    return StepResult(passed=stored.passed, text=stored.text, figures=figures, who=stored.who, at=stored.at)
