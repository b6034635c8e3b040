"""Bringing the rig up from the page: one step at a time, its results kept."""

from backend.api.bench import Bench
from backend.api.errors import ApiError
from backend.api.schemas.bring_up import BringUpStep, BringUpView, StepInput, StepState
from backend.bring_up.steps import STEPS, Step, StepId
from plant.choice import PlantKind


class BringUp:
    """Belongs to the service's event loop."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench

    async def view(self) -> BringUpView:
        """Return all steps and how each stands."""
        why_not = self._why_not()
        return BringUpView(applies=not why_not, why_not=why_not, steps=[self._step(step) for step in STEPS])

    async def start(self, step: StepId, values: dict[str, float], who: str) -> BringUpView:
        """Start a step. Raises ApiError where it cannot be started now, OutOfRangeError."""
        self._require_applies()
        raise ApiError(409, f"{step} cannot be started yet")

    async def confirm(self) -> BringUpView:
        """Go on with the step under way. Raises ApiError where nothing waits for it."""
        raise ApiError(409, "no step of the bring-up waits for a confirmation")

    async def cancel(self) -> BringUpView:
        """Give up the step under way. Raises ApiError where there is none."""
        raise ApiError(409, "no step of the bring-up is under way")

    def _why_not(self) -> str:
        plant = self._bench.picture.plant
        if plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
            return ""
        return f"a rig is brought up; what is driven here is the {plant.name}"

    def _require_applies(self) -> None:
        why_not = self._why_not()
        if why_not:
            raise ApiError(409, why_not)

    def _step(self, step: Step) -> BringUpStep:
        return BringUpStep(
            id=step.id,
            title=step.title,
            instruction=step.instruction,
            inputs=[StepInput(**vars(asked)) for asked in step.inputs],
            state=StepState.NEVER,
            why="it has never been done with this wiring",
            blocked=self._why_not(),
            result=None,
            running=None,
        )
