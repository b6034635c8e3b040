"""Bringing the rig up from the page: one step at a time, its results kept, what it has measured put in force."""

import asyncio
import logging
from contextlib import suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime

from backend.commissioning import steps as standing
from backend.commissioning.session import KeptHands, perform, switch_drives, values_of
from backend.commissioning.steps import STEP, STEPS, Finding, Kept, Standing, Step, StepId, StepState, Work, blocked_by
from backend.errors import Because, RefusalError, RefusedValueError
from backend.faults import Fault
from backend.operating.actuator import Actuator
from backend.operating.bring_up_view import nothing_to_do, step_view
from backend.operating.findings import NOT_YET, Findings
from backend.realtime.commands import ProveDirections
from backend.realtime.program import Mode
from backend.realtime.supervisor import LoopDiedError, Supervisor
from backend.schemas.commissioning import BringUpView, DrivesLeft, RunningStep
from backend.storage.database import Database
from plant.calibration import calibrated
from plant.interface import PlantError
from plant.parameters import PlantParameters
from plant.wiring import Wiring

_log = logging.getLogger(__name__)

_SHOWN_S = 0.2


@dataclass
class _Running:
    """The step under way; ``confirmed`` is what it waits for, None for nothing; ``over`` once its result is kept."""

    step: StepId
    phase: str = "starting"
    ask: str = ""
    confirmed: asyncio.Future[None] | None = None
    began_s: float = field(default_factory=lambda: asyncio.get_running_loop().time())
    task: asyncio.Task[None] | None = None
    over: bool = False


class BringUp:
    """Belongs to the service's event loop."""

    def __init__(
        self,
        actuator: Actuator,
        supervisor: Supervisor,
        database: Database,
        parameters: PlantParameters,
        hands: KeptHands,
    ) -> None:
        self._actuator = actuator
        self._supervisor = supervisor
        self._database = database
        self._parameters = parameters
        self._hands = hands
        self._findings = Findings(actuator, supervisor, database)
        self._running: _Running | None = None
        self._started = actuator.present.starts, datetime.now(UTC)
        actuator.occupied = actuator.present.occupied = self._occupies
        actuator.present.provoked_trip = self._provoked_trip

    @property
    def problem(self) -> str:
        """What of it could not be kept, or is not in force yet."""
        return self._findings.problem

    def use(self, parameters: PlantParameters) -> None:
        """Work by these parameters from now on."""
        self._parameters = parameters

    async def view(self) -> BringUpView:
        """Return all steps and how each stands."""
        why_not = self._findings.why_not()
        if why_not:
            return nothing_to_do(why_not)
        wiring: Wiring | None = None
        try:
            wiring = await asyncio.to_thread(self._findings.wiring)
            why_not = self._findings.not_driven(wiring)
        except PlantError as error:
            why_not = str(error)
        kept = await asyncio.to_thread(standing.kept, self._database)
        states, results = self._states(kept, wiring), kept.results
        steps = [
            step_view(
                step,
                states[step.id],
                results.get(step.id),
                why_not or self._blocked(step, states),
                self._running_view(step.id),
            )
            for step in STEPS
            if step.id in states
        ]
        left = self._hands.left
        return BringUpView(
            applies=True,
            why_not="",
            drives_on=self._supervisor.card.state().drive_enabled if self._supervisor.alive else None,
            drives_locked=self._supervisor.setup.drives_off,
            drives_left=None if left is None else DrivesLeft(who=left.who, at=left.at),
            steps=steps,
        )

    def _running_view(self, step: StepId) -> RunningStep | None:
        running = self._running
        if running is None or running.step is not step:
            return None
        elapsed_s = asyncio.get_running_loop().time() - running.began_s
        return RunningStep(phase=running.phase, elapsed_s=elapsed_s, confirm=running.ask)

    async def start(self, step: StepId, values: dict[str, float], who: str) -> BringUpView:
        """Start a step. Raises RefusalError where it cannot be started now, OutOfRangeError."""
        why_not = self._findings.why_not()
        if why_not:
            raise RefusalError(Because.NOT_NOW, why_not)
        try:
            wanted = values_of(step, values)
            wiring = await asyncio.to_thread(self._findings.wiring)
        except RefusedValueError:
            raise
        except ValueError as error:
            raise RefusalError(Because.BAD_VALUE, str(error)) from None
        except PlantError as error:
            raise RefusalError(Because.NOT_NOW, str(error)) from None
        async with self._actuator.starting:
            kept = await asyncio.to_thread(standing.kept, self._database)
            blocked = self._findings.not_driven(wiring) or self._blocked(STEP[step], self._states(kept, wiring))
            if blocked:
                raise RefusalError(Because.NOT_NOW, blocked)
            self._findings.problem = ""
            running = self._running = _Running(step)
            running.task = asyncio.create_task(self._run(running, wiring, wanted, who))
        self._actuator.changed()
        return await self.view()

    async def confirm(self) -> BringUpView:
        """Go on with the step under way. Raises RefusalError where nothing waits for it."""
        running = self._running
        if running is None or running.confirmed is None or running.confirmed.done():
            raise RefusalError(Because.NOT_NOW, "no step of the bring-up waits for a confirmation")
        running.confirmed.set_result(None)
        return await self.view()

    async def cancel(self) -> BringUpView:
        """Give up the step under way. Raises RefusalError where there is none."""
        running = self._running
        if running is None or running.task is None:
            raise RefusalError(Because.NOT_NOW, "no step of the bring-up is under way")
        if running.over:  # given up now, it would leave a loop that is starting to itself
            title = STEP[running.step].title
            raise RefusalError(Because.NOT_NOW, f"{title} is over, and its result is being kept: wait a moment")
        running.task.cancel()
        await asyncio.wait((running.task,))
        return await self.view()

    async def switch_drives(self, on: bool, who: str) -> BringUpView:
        """Take the drives away or give them back, between two steps. Raises RefusalError where that cannot be now."""
        why_not = self._findings.why_not()
        if why_not:
            raise RefusalError(Because.NOT_NOW, why_not)
        await self._actuator.switch_drives(on, who)
        shown = self._supervisor.card.state
        with suppress(TimeoutError, LoopDiedError):  # of a rig it is shown with the next write
            await self._supervisor.advance_until(lambda: shown().drive_enabled is on, _SHOWN_S)
        return await self.view()

    async def close(self) -> None:
        """Give up what is under way, at the end of the service; a result that is being kept is kept first."""
        await self._findings.close()
        running = self._running
        if running is not None and running.task is not None:
            if not running.over:
                running.task.cancel()
            await asyncio.wait((running.task,))

    async def _run(self, running: _Running, wiring: Wiring, values: dict[str, float], who: str) -> None:
        async def confirmed(words: str) -> None:
            running.ask, running.confirmed = words, asyncio.get_running_loop().create_future()
            self._actuator.changed()
            try:
                await running.confirmed
            finally:
                running.ask, running.confirmed = "", None
                self._actuator.changed()

        def phase(name: str) -> None:
            running.phase = name
            self._actuator.changed()

        # What is stored, in force already or not: a tare measures volts, and keeps the slope it is given.
        in_force = calibrated(wiring, self._supervisor.setup.brought_up.calibrations)
        computed = self._actuator.present.plant.simulated
        work = Work(
            self._supervisor,
            in_force,
            self._parameters,
            values,
            computed=computed,
            confirmed=confirmed,
            switch=lambda on: switch_drives(self._supervisor, self._hands, on, who),
            phase=phase,
        )
        try:
            try:
                finding = await perform(running.step, work)
            except LoopDiedError as died:
                finding = Finding(False, str(died))
            running.over = True
            phase("keeping the result")
            await self._findings.keep(running.step, wiring, finding, who)
        except Exception as error:
            _log.exception("the step %s of the bring-up failed", running.step)
            title = STEP[running.step].title
            self._findings.problem = f"{title} of the bring-up was given up, and has to be done again: {error}"
            if running.step is StepId.DIRECTION:  # what is not kept does not count for this loop either
                with suppress(LoopDiedError):
                    await self._supervisor.send(ProveDirections(proven=False))
        finally:
            self._running = None
            self._actuator.changed()

    def _states(self, kept: Kept, wiring: Wiring | None) -> dict[StepId, Standing]:
        starts = self._actuator.present.starts
        if starts != self._started[0]:
            self._started = starts, datetime.now(UTC)
        found = standing.states(kept, wiring, self._started[1])
        if self._supervisor.started_with.calibrations != self._supervisor.setup.brought_up.calibrations:
            for step in (StepId.TARE, StepId.CALIBRATE):
                if found[step].state is StepState.CURRENT:
                    found[step] = found[step]._replace(state=StepState.OUT_OF_DATE, why=f"what was measured {NOT_YET}")
        return found

    def _provoked_trip(self) -> Fault:
        tries_module = self._running is not None and self._running.step is StepId.SAFETY_MODULE
        return Fault.SAFETY_MODULE if tries_module else Fault.NONE

    def _occupies(self) -> str:
        return "" if self._running is None else f"{STEP[self._running.step].title} of the bring-up is under way"

    def _blocked(self, step: Step, states: dict[StepId, Standing]) -> str:
        present = self._actuator.present
        if self._running is not None:
            return f"{STEP[self._running.step].title} is under way"
        if present.task is not None:
            return f"run {present.task.run} is under way"
        if present.mode is not Mode.OFF:
            return f"the mode is {present.mode}: bring it to off first"
        return blocked_by(step, states)
