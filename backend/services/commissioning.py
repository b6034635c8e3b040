"""Commissioning from the page: steps, their results, and what takes effect of them."""

import asyncio
import logging
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from backend.commissioning import (
    STEP,
    STEPS,
    CommissioningStep,
    DriveLockout,
    ProcedureContext,
    StepFinding,
    StepId,
    StepState,
    StepStatus,
    StoredResults,
    collect_values,
    find_blocking_steps,
    run_step,
    status,
    switch_drives,
)
from backend.errors import InvalidValueError, RequestRejectedError
from backend.faults import Fault
from backend.realtime import Event, LoopExited, LoopExitedError, Mode, ProveDirections, Stopped, Supervisor
from backend.schemas import BringUpStep, BringUpView, EarlierLockout, RunningStep, StepFigure, StepResult
from backend.services.actuator import ActuatorService
from backend.storage import Database, StoredStepResult
from plant import (
    ErrorCode,
    PlantError,
    PlantKind,
    PlantParameters,
    Wiring,
    apply_calibration,
    load_wiring_choice,
    wiring_fingerprint,
)

# Bring up view -------------------------------------------------------------------------------------
#
# How the steps of the bring-up are shown.


def build_inapplicable_view(why_not: str) -> BringUpView:
    """Return the steps where there is no rig to be brought up."""
    never = StepStatus(StepState.NEVER, why_not)
    return BringUpView(
        applies=False,
        why_not=why_not,
        drives_on=None,
        drives_locked=False,
        drives_left=None,
        steps=[build_step_view(step, never, None, why_not, None) for step in STEPS],
    )


def build_step_view(
    step: CommissioningStep,
    step_status: StepStatus,
    result: StoredStepResult | None,
    blocked: str,
    running: RunningStep | None,
) -> BringUpStep:
    """Return one step, with its newest result."""
    return BringUpStep(
        id=step.id,
        title=step.title,
        instruction=step.instruction,
        inputs=list(step.inputs),
        state=step_status.state,
        why=step_status.why,
        blocked=blocked,
        result=None if result is None else _build_result(result),
        running=running,
    )


def _build_result(stored: StoredStepResult) -> StepResult:
    figures = [StepFigure(**figure) for figure in stored.figures]
    return StepResult(passed=stored.passed, text=stored.text, figures=figures, who=stored.who, at=stored.at)


# Findings ------------------------------------------------------------------------------------------
#
# What the steps of the bring-up come to in the service: kept, put in force, and taken back where it
# proved wrong.


NOT_YET = "takes effect at the next start of the loop: do it again in off, or start the service anew"

_log = logging.getLogger(__name__)


class CommissioningResults:
    """Belongs to the service's event loop. ``problem`` tells what could not be kept, or is not in force yet."""

    def __init__(self, actuator: ActuatorService, supervisor: Supervisor, database: Database) -> None:
        self.problem = ""
        self._actuator = actuator
        self._supervisor = supervisor
        self._database = database
        self._storing: set[asyncio.Task[None]] = set()
        supervisor.listen(self._handle_event)

    def explain_not_applicable(self) -> str:
        """Return why there is nothing to be brought up; empty where there is."""
        plant = self._actuator.live_state.plant
        if plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
            return ""
        return f"a rig is brought up; what is driven here is the {plant.name}"

    async def close(self) -> None:
        """Wait until what was found wrong is kept."""
        if self._storing:
            await asyncio.wait(self._storing)

    async def store(self, step: StepId, wiring: Wiring, finding: StepFinding, who: str) -> None:
        """Store what a step came to; each start of the loop from here on goes by it, the next one at once if needed."""
        await asyncio.to_thread(status.store_result, self._database, step, wiring, finding, who)
        brought_up = await asyncio.to_thread(status.load_brought_up, self._database, wiring)
        self._supervisor.setup = replace(self._supervisor.setup, brought_up=brought_up)
        if not (finding.calibrations and finding.passed):
            return
        try:
            await self._actuator.restart_loop_with(lambda: None, "what the bring-up has measured", who)
        except (RequestRejectedError, LoopExitedError) as error:
            self.problem = f"What {STEP[step].title} of the bring-up has measured {NOT_YET} ({error})."

    def _handle_event(self, event: Event | LoopExited) -> None:
        """Take a motor that turned the wrong way for what it is: the directions are disproved, for later starts too."""
        if isinstance(event, Stopped) and event.fault is Fault.MOTOR_REVERSED and not self.explain_not_applicable():
            keeping = asyncio.create_task(self._store_wrong_directions(event.detail))
            self._storing.add(keeping)
            keeping.add_done_callback(self._storing.discard)

    async def _store_wrong_directions(self, seen: str) -> None:
        try:
            wiring = await asyncio.to_thread(self.load_wiring)
            finding = StepFinding(False, f"the loop has stopped: {seen}")
            await self.store(StepId.DIRECTION, wiring, finding, "the loop")
        except Exception as error:
            _log.exception("The service could not store that the directions are wrong.")
            self.problem = f"Do {STEP[StepId.DIRECTION].title} anew: that they are wrong could not be kept ({error})."
        finally:
            self._actuator.publish_change()

    def load_wiring(self) -> Wiring:
        """Return the wiring as its file says it now. Raises PlantError."""
        return load_wiring_choice(self._actuator.live_state.plant)

    def explain_changed_wiring(self, wiring: Wiring) -> str:
        """Return why no step can be played: it would be kept for the file of now, and be found with another."""
        if wiring_fingerprint(wiring) == self._supervisor.started_with.wired:
            return ""
        return (
            "the wiring file has changed since the loop was started, which goes by the old one: start the service anew"
        )


# Bring up ------------------------------------------------------------------------------------------
#
# Bringing the rig up from the page: one step at a time, its results kept, what it has measured put
# in force.


_SHOWN_S = 0.2


@dataclass
class _RunningStep:
    """The step under way; ``confirmed`` is what it waits for, None for nothing; ``over`` once its result is kept."""

    step: StepId
    phase: str = "starting"
    ask: str = ""
    confirmed: asyncio.Future[None] | None = None
    began_s: float = field(default_factory=lambda: asyncio.get_running_loop().time())
    task: asyncio.Task[None] | None = None
    over: bool = False


class CommissioningService:
    """Belongs to the service's event loop."""

    def __init__(
        self,
        actuator: ActuatorService,
        supervisor: Supervisor,
        database: Database,
        parameters: PlantParameters,
        drive_lockout: DriveLockout,
    ) -> None:
        self._actuator = actuator
        self._supervisor = supervisor
        self._database = database
        self._parameters = parameters
        self._drive_lockout = drive_lockout
        self._results = CommissioningResults(actuator, supervisor, database)
        self._running: _RunningStep | None = None
        self._started = actuator.live_state.starts, datetime.now(UTC)

    @property
    def problem(self) -> str:
        """What of it could not be kept, or is not in force yet."""
        return self._results.problem

    def set_parameters(self, parameters: PlantParameters) -> None:
        """Work by these parameters from now on."""
        self._parameters = parameters

    async def view(self) -> BringUpView:
        """Return all steps and how each stands."""
        why_not = self._results.explain_not_applicable()
        if why_not:
            return build_inapplicable_view(why_not)
        wiring: Wiring | None = None
        try:
            wiring = await asyncio.to_thread(self._results.load_wiring)
            why_not = self._results.explain_changed_wiring(wiring)
        except PlantError as error:
            why_not = str(error)
        kept = await asyncio.to_thread(status.load_results, self._database)
        states, results = self._compute_states(kept, wiring), kept.results
        steps = [
            build_step_view(
                step,
                states[step.id],
                results.get(step.id),
                why_not or self._find_blocker(step, states),
                self._view_running(step.id),
            )
            for step in STEPS
            if step.id in states
        ]
        left = self._drive_lockout.previous_lock
        return BringUpView(
            applies=True,
            why_not="",
            drives_on=self._supervisor.card.state().drive_enabled if self._supervisor.is_alive else None,
            drives_locked=self._supervisor.setup.drives_off,
            drives_left=None if left is None else EarlierLockout(who=left.who, at=left.at),
            steps=steps,
        )

    def _view_running(self, step: StepId) -> RunningStep | None:
        running = self._running
        if running is None or running.step is not step:
            return None
        elapsed_s = asyncio.get_running_loop().time() - running.began_s
        return RunningStep(phase=running.phase, elapsed_s=elapsed_s, confirm=running.ask)

    async def start(self, step: StepId, values: dict[str, float], who: str) -> BringUpView:
        """Start a step. Raises RequestRejectedError where it cannot be started now, OutOfRangeError."""
        why_not = self._results.explain_not_applicable()
        if why_not:
            raise RequestRejectedError(ErrorCode.NOT_NOW, why_not)
        try:
            wanted = collect_values(step, values)
            wiring = await asyncio.to_thread(self._results.load_wiring)
        except InvalidValueError:
            raise
        except ValueError as error:
            raise RequestRejectedError(ErrorCode.BAD_VALUE, str(error)) from None
        except PlantError as error:
            raise RequestRejectedError(ErrorCode.NOT_NOW, str(error)) from None
        async with self._actuator.start_lock:
            kept = await asyncio.to_thread(status.load_results, self._database)
            blocked = self._results.explain_changed_wiring(wiring) or self._find_blocker(
                STEP[step], self._compute_states(kept, wiring)
            )
            if blocked:
                raise RequestRejectedError(ErrorCode.NOT_NOW, blocked)
            self._results.problem = ""
            running = self._running = _RunningStep(step)
            self._set_occupied(running)
            running.task = asyncio.create_task(self._run(running, wiring, wanted, who))
        self._actuator.publish_change()
        return await self.view()

    async def confirm(self) -> BringUpView:
        """Go on with the step under way. Raises RequestRejectedError where nothing waits for it."""
        running = self._running
        if running is None or running.confirmed is None or running.confirmed.done():
            raise RequestRejectedError(ErrorCode.NOT_NOW, "no step of the bring-up waits for a confirmation")
        running.confirmed.set_result(None)
        return await self.view()

    async def cancel(self) -> BringUpView:
        """Give up the step under way. Raises RequestRejectedError where there is none."""
        running = self._running
        if running is None or running.task is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, "no step of the bring-up is under way")
        if running.over:  # given up now, it would leave a loop that is starting to itself
            title = STEP[running.step].title
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, f"{title} is over, and its result is being kept: wait a moment"
            )
        running.task.cancel()
        await asyncio.wait((running.task,))
        return await self.view()

    async def switch_drives(self, on: bool, who: str) -> BringUpView:
        """Take the drives away or give them back, between two steps.

        Raises RequestRejectedError where that cannot be now.
        """
        why_not = self._results.explain_not_applicable()
        if why_not:
            raise RequestRejectedError(ErrorCode.NOT_NOW, why_not)
        await self._actuator.switch_drives(on, who)
        shown = self._supervisor.card.state
        with suppress(TimeoutError, LoopExitedError):  # of a rig it is shown with the next write
            await self._supervisor.advance_until(lambda: shown().drive_enabled is on, _SHOWN_S)
        return await self.view()

    async def close(self) -> None:
        """Give up what is under way, at the end of the service; a result that is being kept is kept first."""
        await self._results.close()
        running = self._running
        if running is not None and running.task is not None:
            if not running.over:
                running.task.cancel()
            await asyncio.wait((running.task,))

    async def _run(self, running: _RunningStep, wiring: Wiring, values: dict[str, float], who: str) -> None:
        async def confirmed(words: str) -> None:
            running.ask, running.confirmed = words, asyncio.get_running_loop().create_future()
            self._actuator.publish_change()
            try:
                await running.confirmed
            finally:
                running.ask, running.confirmed = "", None
                self._actuator.publish_change()

        def phase(name: str) -> None:
            running.phase = name
            self._actuator.publish_change()

        # What is stored, in force already or not: a tare measures volts, and keeps the slope it is given.
        calibrated = apply_calibration(wiring, self._supervisor.setup.brought_up.calibrations)
        computed = self._actuator.live_state.plant.simulated
        work = ProcedureContext(
            self._supervisor,
            calibrated,
            self._parameters,
            values,
            is_simulated=computed,
            request_confirmation=confirmed,
            set_drives=lambda on: switch_drives(self._supervisor, self._drive_lockout, on, who),
            report_phase=phase,
        )
        try:
            try:
                finding = await run_step(running.step, work)
            except LoopExitedError as died:
                finding = StepFinding(False, str(died))
            running.over = True
            phase("keeping the result")
            await self._results.store(running.step, wiring, finding, who)
        except Exception as error:
            _log.exception("Step %s of the bring-up failed.", running.step)
            title = STEP[running.step].title
            self._results.problem = f"{title} of the bring-up was given up, and has to be done again: {error}"
            if running.step is StepId.DIRECTION:  # what is not kept does not count for this loop either
                with suppress(LoopExitedError):
                    await self._supervisor.send(ProveDirections(proven=False))
        finally:
            self._running = None
            self._set_occupied(None)
            self._actuator.publish_change()

    def _compute_states(self, kept: StoredResults, wiring: Wiring | None) -> dict[StepId, StepStatus]:
        starts = self._actuator.live_state.starts
        if starts != self._started[0]:
            self._started = starts, datetime.now(UTC)
        found = status.determine_statuses(kept, wiring, self._started[1])
        if self._supervisor.started_with.calibrations != self._supervisor.setup.brought_up.calibrations:
            for step in (StepId.TARE, StepId.CALIBRATE):
                if found[step].state is StepState.CURRENT:
                    found[step] = found[step]._replace(state=StepState.OUT_OF_DATE, why=f"what was measured {NOT_YET}")
        return found

    def _set_occupied(self, running: _RunningStep | None) -> None:
        """Say in the state what has the rig for itself, and which trip it provokes."""
        live_state = self._actuator.live_state
        live_state.occupied_by = "" if running is None else f"{STEP[running.step].title} of the bring-up is under way"
        tries_module = running is not None and running.step is StepId.SAFETY_MODULE
        live_state.provoked_fault = Fault.SAFETY_MODULE if tries_module else Fault.NONE

    def _find_blocker(self, step: CommissioningStep, states: dict[StepId, StepStatus]) -> str:
        live_state = self._actuator.live_state
        if self._running is not None:
            return f"{STEP[self._running.step].title} is under way"
        if live_state.task is not None:
            return f"run {live_state.task.run} is under way"
        if live_state.mode is not Mode.OFF:
            return f"the mode is {live_state.mode}: bring it to off first"
        return find_blocking_steps(step, states)
