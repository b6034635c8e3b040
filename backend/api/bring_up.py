"""Bringing the rig up from the page: one step at a time, its results kept, what it has measured put in force."""

import asyncio
import logging
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from backend.api.bench import Bench
from backend.api.errors import ApiError
from backend.api.schemas.bring_up import BringUpStep, BringUpView, RunningStep, StepFigure, StepInput, StepResult
from backend.bring_up import standing
from backend.bring_up.engine import perform, values_of
from backend.bring_up.standing import Kept, Standing, StepState, blocked_by
from backend.bring_up.steps import STEP, STEPS, Step, StepId
from backend.bring_up.work import Finding, Work
from backend.faults import Fault
from backend.loop.access import LoopDied, LoopDiedError
from backend.loop.commands import Event, Stopped
from backend.loop.mode import Mode
from backend.loop.supervisor import Supervisor
from backend.refusal import RefusedValueError
from backend.storage import Database
from backend.storage.bring_up import StepResult as Stored
from plant.brought_up import NOT_BROUGHT_UP, BroughtUp, calibrated
from plant.catalog import wiring_of_choice
from plant.choice import PlantKind
from plant.interface import PlantError
from plant.parameters import PlantParameters
from plant.wiring import Wiring

_log = logging.getLogger(__name__)

_SHOWN_S = 0.2
_NOT_YET = "takes effect at the next start of the loop: do it again in off, or start the service anew"


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

    def __init__(self, bench: Bench, supervisor: Supervisor, database: Database, parameters: PlantParameters) -> None:
        self._bench = bench
        self._supervisor = supervisor
        self._database = database
        self._parameters = parameters
        self._running: _Running | None = None
        self._started = bench.picture.starts, datetime.now(UTC)
        self.problem = ""
        self._disproving: set[asyncio.Task[None]] = set()
        bench.occupied = bench.picture.occupied = self._occupies
        supervisor.listen(self._hear)
        bench.in_effect = self._in_effect

    async def view(self) -> BringUpView:
        """Return all steps and how each stands."""
        why_not = self._why_not()
        if why_not:
            states = dict.fromkeys(StepId, Standing(StepState.NEVER, why_not))
            return BringUpView(
                applies=False,
                why_not=why_not,
                drives_on=None,
                drives_locked=False,
                steps=[self._view(step, states, None, why_not) for step in STEPS],
            )
        wiring: Wiring | None = None
        try:
            wiring = await asyncio.to_thread(self._wiring)
            why_not = self._not_driven(wiring)
        except PlantError as error:
            why_not = str(error)
        kept = await asyncio.to_thread(standing.kept, self._database)
        states, results = self._states(kept, wiring), kept.results
        steps = [
            self._view(step, states, results.get(step.id), why_not or self._blocked(step, states))
            for step in STEPS
            if step.id in states
        ]
        drives_on = self._supervisor.card.state().drive_enabled if self._supervisor.alive else None
        locked = self._supervisor.setup.drives_off
        return BringUpView(applies=True, why_not="", drives_on=drives_on, drives_locked=locked, steps=steps)

    async def start(self, step: StepId, values: dict[str, float], who: str) -> BringUpView:
        """Start a step. Raises ApiError where it cannot be started now, OutOfRangeError."""
        why_not = self._why_not()
        if why_not:
            raise ApiError(409, why_not)
        try:
            wanted = values_of(step, values)
            wiring = await asyncio.to_thread(self._wiring)
        except RefusedValueError:
            raise
        except ValueError as error:
            raise ApiError(422, str(error)) from None
        except PlantError as error:
            raise ApiError(409, str(error)) from None
        kept = await asyncio.to_thread(standing.kept, self._database)
        blocked = self._not_driven(wiring) or self._blocked(STEP[step], self._states(kept, wiring))
        if blocked:
            raise ApiError(409, blocked)
        self.problem = ""
        running = self._running = _Running(step)
        running.task = asyncio.create_task(self._run(running, wiring, wanted, who))
        self._bench.changed()
        return await self.view()

    async def confirm(self) -> BringUpView:
        """Go on with the step under way. Raises ApiError where nothing waits for it."""
        running = self._running
        if running is None or running.confirmed is None or running.confirmed.done():
            raise ApiError(409, "no step of the bring-up waits for a confirmation")
        running.confirmed.set_result(None)
        return await self.view()

    async def cancel(self) -> BringUpView:
        """Give up the step under way. Raises ApiError where there is none."""
        running = self._running
        if running is None or running.task is None:
            raise ApiError(409, "no step of the bring-up is under way")
        if running.over:  # given up now, it would leave a loop that is starting to itself
            raise ApiError(409, f"{STEP[running.step].title} is over, and its result is being kept: wait a moment")
        running.task.cancel()
        await asyncio.wait((running.task,))
        return await self.view()

    async def switch_drives(self, on: bool, who: str) -> BringUpView:
        """Take the drives away or give them back, between two steps. Raises ApiError where that cannot be now."""
        why_not = self._why_not()
        if why_not:
            raise ApiError(409, why_not)
        await self._bench.switch_drives(on, who)
        shown = self._supervisor.card.state
        with suppress(TimeoutError, LoopDiedError):  # of a rig it is shown with the next write
            await self._supervisor.advance_until(lambda: shown().drive_enabled is on, _SHOWN_S)
        return await self.view()

    async def close(self) -> None:
        """Give up what is under way, at the end of the service; a result that is being kept is kept first."""
        if self._disproving:
            await asyncio.wait(self._disproving)
        running = self._running
        if running is not None and running.task is not None:
            if not running.over:
                running.task.cancel()
            await asyncio.wait((running.task,))

    async def _run(self, running: _Running, wiring: Wiring, values: dict[str, float], who: str) -> None:
        async def confirmed(words: str) -> None:
            running.ask, running.confirmed = words, asyncio.get_running_loop().create_future()
            self._bench.changed()
            try:
                await running.confirmed
            finally:
                running.ask, running.confirmed = "", None
                self._bench.changed()

        def phase(name: str) -> None:
            running.phase = name
            self._bench.changed()

        # What is stored, in force already or not: a tare measures volts, and keeps the slope it is given.
        in_force = calibrated(wiring, self._supervisor.setup.brought_up.calibrations)
        computed = self._bench.picture.plant.simulated
        work = Work(
            self._supervisor, in_force, self._parameters, values, computed=computed, confirmed=confirmed, phase=phase
        )
        try:
            try:
                finding = await perform(running.step, work)
            except LoopDiedError as died:
                finding = Finding(False, str(died))
            running.over = True
            phase("keeping the result")
            await self._keep(running.step, wiring, finding, who)
        except Exception as error:
            _log.exception("the step %s of the bring-up failed", running.step)
            self.problem = f"{STEP[running.step].title} of the bring-up was given up, and has to be done again: {error}"
        finally:
            self._running = None
            self._bench.changed()

    async def _keep(self, step: StepId, wiring: Wiring, finding: Finding, who: str) -> None:
        """Store what a step came to; each start of the loop from here on goes by it, the next one at once if needed."""
        await asyncio.to_thread(standing.keep, self._database, step, wiring, finding, who)
        brought_up = await asyncio.to_thread(standing.in_effect, self._database, wiring)
        self._supervisor.setup = replace(self._supervisor.setup, brought_up=brought_up)
        if not (finding.calibrations and finding.passed):
            return
        try:
            await self._bench.take_up(brought_up, who)
        except (ApiError, LoopDiedError) as error:
            self.problem = f"What {STEP[step].title} of the bring-up has measured {_NOT_YET} ({error})."

    def _hear(self, event: Event | LoopDied) -> None:
        """Take a motor that turned the wrong way for what it is: the directions are disproved, for later starts too."""
        if isinstance(event, Stopped) and event.fault is Fault.MOTOR_REVERSED and not self._why_not():
            keeping = asyncio.create_task(self._disprove(event.detail))
            self._disproving.add(keeping)
            keeping.add_done_callback(self._disproving.discard)

    async def _disprove(self, seen: str) -> None:
        try:
            wiring = await asyncio.to_thread(self._wiring)
            finding = Finding(False, f"the loop has stopped: {seen}")
            await self._keep(StepId.DIRECTION, wiring, finding, "the loop")
        except Exception as error:
            _log.exception("what disproves the directions could not be kept")
            self.problem = f"Do {STEP[StepId.DIRECTION].title} anew: that they are wrong could not be kept ({error})."
        finally:
            self._bench.changed()

    def _wiring(self) -> Wiring:
        return wiring_of_choice(self._bench.picture.plant)

    def _not_driven(self, wiring: Wiring) -> str:
        """Return why no step can be played: it would be kept for the file of now, and be found with another."""
        if standing.fingerprint(wiring) == self._bench.brought_up.wired:
            return ""
        return (
            "the wiring file has changed since the loop was started, which goes by the old one: start the service anew"
        )

    def _in_effect(self) -> BroughtUp:
        """Return what the next loop starts with: what was found with the wiring file that it will read."""
        known = self._supervisor.setup.brought_up
        if self._why_not():
            return known
        try:
            wiring = self._wiring()
        except PlantError:
            return NOT_BROUGHT_UP  # the loop says itself why it does not start
        # a start with the wiring of before waits for no database
        return known if standing.fingerprint(wiring) == known.wired else standing.in_effect(self._database, wiring)

    def _why_not(self) -> str:
        plant = self._bench.picture.plant
        if plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
            return ""
        return f"a rig is brought up; what is driven here is the {plant.name}"

    def _states(self, kept: Kept, wiring: Wiring | None) -> dict[StepId, Standing]:
        starts = self._bench.picture.starts
        if starts != self._started[0]:
            self._started = starts, datetime.now(UTC)
        found = standing.states(kept, wiring, self._started[1])
        if self._bench.brought_up.calibrations != self._supervisor.setup.brought_up.calibrations:
            for step in (StepId.TARE, StepId.CALIBRATE):
                if found[step].state is StepState.CURRENT:
                    found[step] = found[step]._replace(state=StepState.OUT_OF_DATE, why=f"what was measured {_NOT_YET}")
        return found

    def _occupies(self) -> str:
        return "" if self._running is None else f"{STEP[self._running.step].title} of the bring-up is under way"

    def _blocked(self, step: Step, states: dict[StepId, Standing]) -> str:
        picture = self._bench.picture
        if self._running is not None:
            return f"{STEP[self._running.step].title} is under way"
        if picture.task is not None:
            return f"run {picture.task.run} is under way"
        if picture.mode is not Mode.OFF:
            return f"the mode is {picture.mode}: bring it to off first"
        return blocked_by(step, states)

    def _view(self, step: Step, states: dict[StepId, Standing], result: Stored | None, blocked: str) -> BringUpStep:
        running = self._running if self._running is not None and self._running.step is step.id else None
        now_s = asyncio.get_running_loop().time()
        return BringUpStep(
            id=step.id,
            title=step.title,
            instruction=step.instruction,
            inputs=[StepInput(**vars(asked)) for asked in step.inputs],
            state=states[step.id].state,
            why=states[step.id].why,
            blocked=blocked,
            result=None if result is None else _result(result),
            running=None
            if running is None
            else RunningStep(phase=running.phase, elapsed_s=now_s - running.began_s, confirm=running.ask),
        )


def _result(stored: Stored) -> StepResult:
    figures = [StepFigure(**figure) for figure in stored.figures]
    return StepResult(passed=stored.passed, text=stored.text, figures=figures, who=stored.who, at=stored.at)
