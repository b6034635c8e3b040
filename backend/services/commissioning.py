"""Commissioning of the rig from the page: steps and their results."""

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
from backend.services import messages
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

# Views ---------------------------------------------------------------------------------------------
# The steps of the commissioning (page label: bring-up) as the page shows them.


def build_inapplicable_view(why_not: str) -> BringUpView:
    """Return the steps for a plant that needs no commissioning.

    ``why_not`` is the reason.
    """
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
    """Return one step with its newest result.

    ``blocked`` is the reason why it cannot start, or empty.
    """
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


# Results -------------------------------------------------------------------------------------------
# Stores the results of the steps, activates them in the control loop, and revokes the directions of
# the motors if the control loop disproves them.


_log = logging.getLogger(__name__)


class CommissioningResultStore:
    """Stores and activates results. Runs in the event loop of the service."""

    def __init__(self, actuator: ActuatorService, supervisor: Supervisor, database: Database) -> None:
        self.problem = ""
        """Which result could not be stored or is not active yet; empty for none."""

        self._actuator = actuator
        self._supervisor = supervisor
        self._database = database
        self._storing: set[asyncio.Task[None]] = set()
        supervisor.listen(self._handle_event)

    def explain_not_applicable(self) -> str:
        """Return why the plant needs no commissioning; empty if it does."""
        plant = self._actuator.live_state.plant
        if plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
            return ""
        return messages.plant_is_not_a_rig(plant=plant.name)

    async def close(self) -> None:
        """Wait until disproved directions are stored."""
        if self._storing:
            await asyncio.wait(self._storing)

    async def store(self, step: StepId, wiring: Wiring, finding: StepFinding, who: str) -> None:
        """Store the result of a step for all later loop processes.

        Restarts the control loop if the result contains calibrations, so that they take effect now.
        """
        await asyncio.to_thread(status.store_result, self._database, step, wiring, finding, who)
        commissioning_results = await asyncio.to_thread(status.load_commissioning_results, self._database, wiring)
        self._supervisor.setup = replace(self._supervisor.setup, commissioning_results=commissioning_results)
        if not (finding.calibrations and finding.passed):
            return
        try:
            await self._actuator.restart_loop_with(lambda: None, messages.calibration_of_bring_up(), who)
        except (RequestRejectedError, LoopExitedError) as error:
            self.problem = messages.result_not_active(title=STEP[step].title, reason=error.message)

    def _handle_event(self, event: Event | LoopExited) -> None:
        """Revoke the directions if a motor has turned the wrong way.

        The result holds for later loop processes, too.
        """
        if isinstance(event, Stopped) and event.fault is Fault.MOTOR_REVERSED and not self.explain_not_applicable():
            task = asyncio.create_task(self._store_wrong_directions(event.detail))
            self._storing.add(task)
            task.add_done_callback(self._storing.discard)

    async def _store_wrong_directions(self, detail: str) -> None:
        try:
            wiring = await asyncio.to_thread(self.load_wiring)
            finding = StepFinding(False, messages.loop_disproved_directions(detail=detail))
            await self.store(StepId.DIRECTION, wiring, finding, "the loop")
        except Exception as error:
            _log.exception("The service could not store that the directions are wrong.")
            self.problem = messages.wrong_directions_not_stored(title=STEP[StepId.DIRECTION].title, reason=str(error))
        finally:
            self._actuator.publish_change()

    def load_wiring(self) -> Wiring:
        """Return the current content of the wiring file. Raises PlantError."""
        return load_wiring_choice(self._actuator.live_state.plant)

    def explain_changed_wiring(self, wiring: Wiring) -> str:
        """Return why no step can run with a changed wiring file; empty if unchanged.

        The result would be stored for the new file, although it was measured with the old one.
        """
        if wiring_fingerprint(wiring) == self._supervisor.started_with.wired:
            return ""
        return messages.wiring_has_changed()


# Commissioning service -----------------------------------------------------------------------------
# Runs one step at a time, and stores and activates its result.


_SHOWN_S = 0.2
"""Longest wait [s] until the card shows that the drives were switched."""


@dataclass
class _RunningStep:
    """The step in progress."""

    step: StepId
    phase: str = "starting"
    prompt: str = ""
    """Text that asks the operator for a confirmation; empty while none is needed."""

    confirmed: asyncio.Future[None] | None = None
    started_s: float = field(default_factory=lambda: asyncio.get_running_loop().time())
    task: asyncio.Task[None] | None = None
    is_over: bool = False
    """Whether the procedure has ended, and only its result is being stored."""


class CommissioningService:
    """Runs the steps of the commissioning. Runs in the event loop of the service."""

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
        self._results = CommissioningResultStore(actuator, supervisor, database)
        self._running: _RunningStep | None = None
        self._loop_start = actuator.live_state.starts, datetime.now(UTC)  # number and time of the newest loop process

    @property
    def problem(self) -> str:
        """Which result could not be stored or is not active yet; empty for none."""
        return self._results.problem

    def set_parameters(self, parameters: PlantParameters) -> None:
        """Use other parameters from the next step on."""
        self._parameters = parameters

    async def view(self) -> BringUpView:
        """Return all steps with their status."""
        why_not = self._results.explain_not_applicable()
        if why_not:
            return build_inapplicable_view(why_not)
        wiring: Wiring | None = None
        try:
            wiring = await asyncio.to_thread(self._results.load_wiring)
            why_not = self._results.explain_changed_wiring(wiring)
        except PlantError as error:
            why_not = error.message
        stored = await asyncio.to_thread(status.load_results, self._database)
        statuses = self._determine_statuses(stored, wiring)
        steps = [
            build_step_view(
                step,
                statuses[step.id],
                stored.results.get(step.id),
                why_not or self._explain_blocked(step, statuses),
                self._view_running(step.id),
            )
            for step in STEPS
            if step.id in statuses
        ]
        earlier = self._drive_lockout.previous_lock
        return BringUpView(
            applies=True,
            why_not="",
            drives_on=self._supervisor.card.state().drive_enabled if self._supervisor.is_alive else None,
            drives_locked=self._supervisor.setup.drives_off,
            drives_left=None if earlier is None else EarlierLockout(who=earlier.who, at=earlier.at),
            steps=steps,
        )

    def _view_running(self, step: StepId) -> RunningStep | None:
        running = self._running
        if running is None or running.step is not step:
            return None
        elapsed_s = asyncio.get_running_loop().time() - running.started_s
        return RunningStep(phase=running.phase, elapsed_s=elapsed_s, confirm=running.prompt)

    async def start(self, step: StepId, values: dict[str, float], who: str) -> BringUpView:
        """Start a step with the entered ``values``.

        Raises RequestRejectedError, OutOfRangeError.
        """
        why_not = self._results.explain_not_applicable()
        if why_not:
            raise RequestRejectedError(ErrorCode.NOT_NOW, why_not)
        try:
            complete_values = collect_values(step, values)
            wiring = await asyncio.to_thread(self._results.load_wiring)
        except InvalidValueError:
            raise
        except ValueError as error:
            raise RequestRejectedError(ErrorCode.BAD_VALUE, str(error)) from None
        except PlantError as error:
            raise RequestRejectedError(ErrorCode.NOT_NOW, error.message) from None
        async with self._actuator.start_lock:
            stored = await asyncio.to_thread(status.load_results, self._database)
            blocked = self._results.explain_changed_wiring(wiring) or self._explain_blocked(
                STEP[step], self._determine_statuses(stored, wiring)
            )
            if blocked:
                raise RequestRejectedError(ErrorCode.NOT_NOW, blocked)
            self._results.problem = ""
            running = self._running = _RunningStep(step)
            self._set_occupied(running)
            running.task = asyncio.create_task(self._run(running, wiring, complete_values, who))
        self._actuator.publish_change()
        return await self.view()

    async def confirm(self) -> BringUpView:
        """Give the confirmation that the running step waits for.

        Raises RequestRejectedError if it waits for none.
        """
        running = self._running
        if running is None or running.confirmed is None or running.confirmed.done():
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.no_step_waits_for_confirmation())
        running.confirmed.set_result(None)
        return await self.view()

    async def cancel(self) -> BringUpView:
        """Cancel the running step.

        Raises RequestRejectedError without one, or while its result is being stored.
        """
        running = self._running
        if running is None or running.task is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.no_step_in_progress())
        if running.is_over:  # a cancellation now could interrupt a restart of the control loop
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.step_is_being_stored(title=STEP[running.step].title))
        running.task.cancel()
        await asyncio.wait((running.task,))
        return await self.view()

    async def switch_drives(self, on: bool, who: str) -> BringUpView:
        """Enable the drives between two steps, or disable them.

        Raises RequestRejectedError, LoopExitedError.
        """
        why_not = self._results.explain_not_applicable()
        if why_not:
            raise RequestRejectedError(ErrorCode.NOT_NOW, why_not)
        await self._actuator.switch_drives(on, who)
        read_card = self._supervisor.card.state
        with suppress(TimeoutError, LoopExitedError):  # the control loop reports a real card with its next write
            await self._supervisor.advance_until(lambda: read_card().drive_enabled is on, _SHOWN_S)
        return await self.view()

    async def close(self) -> None:
        """Cancel the running step at the end of the service.

        Waits for a result that is being stored.
        """
        await self._results.close()
        running = self._running
        if running is not None and running.task is not None:
            if not running.is_over:
                running.task.cancel()
            await asyncio.wait((running.task,))

    async def _run(self, running: _RunningStep, wiring: Wiring, values: dict[str, float], who: str) -> None:
        async def request_confirmation(prompt: str) -> None:
            running.prompt, running.confirmed = prompt, asyncio.get_running_loop().create_future()
            self._actuator.publish_change()
            try:
                await running.confirmed
            finally:
                running.prompt, running.confirmed = "", None
                self._actuator.publish_change()

        def report_phase(name: str) -> None:
            running.phase = name
            self._actuator.publish_change()

        # With the stored calibrations, active or not: a tare measures volts and keeps the stored slope.
        calibrated = apply_calibration(wiring, self._supervisor.setup.commissioning_results.calibrations)
        context = ProcedureContext(
            self._supervisor,
            calibrated,
            self._parameters,
            values,
            is_simulated=self._actuator.live_state.plant.simulated,
            request_confirmation=request_confirmation,
            set_drives=lambda on: switch_drives(self._supervisor, self._drive_lockout, on, who),
            report_phase=report_phase,
        )
        try:
            try:
                finding = await run_step(running.step, context)
            except LoopExitedError as error:
                finding = StepFinding(False, str(error))
            running.is_over = True
            report_phase(messages.storing_result())
            await self._results.store(running.step, wiring, finding, who)
        except Exception as error:
            _log.exception("Step %s of the commissioning failed.", running.step)
            title = STEP[running.step].title
            self._results.problem = messages.step_failed(title=title, reason=str(error))
            if running.step is StepId.DIRECTION:  # a result that is not stored is not valid for the running loop either
                with suppress(LoopExitedError):
                    await self._supervisor.send(ProveDirections(proven=False))
        finally:
            self._running = None
            self._set_occupied(None)
            self._actuator.publish_change()

    def _determine_statuses(self, stored: StoredResults, wiring: Wiring | None) -> dict[StepId, StepStatus]:
        starts = self._actuator.live_state.starts
        if starts != self._loop_start[0]:
            self._loop_start = starts, datetime.now(UTC)
        statuses = status.determine_statuses(stored, wiring, self._loop_start[1])
        if self._supervisor.started_with.calibrations != self._supervisor.setup.commissioning_results.calibrations:
            for step in (StepId.TARE, StepId.CALIBRATE):
                if statuses[step].state is StepState.CURRENT:
                    statuses[step] = statuses[step]._replace(
                        state=StepState.OUT_OF_DATE, why=messages.calibration_not_active()
                    )
        return statuses

    def _set_occupied(self, running: _RunningStep | None) -> None:
        """Set in the live state which step occupies the rig, and which fault it provokes."""
        live_state = self._actuator.live_state
        live_state.occupied_by = "" if running is None else messages.step_occupies_rig(title=STEP[running.step].title)
        provokes_trip = running is not None and running.step is StepId.SAFETY_MODULE
        live_state.provoked_fault = Fault.SAFETY_MODULE if provokes_trip else Fault.NONE

    def _explain_blocked(self, step: CommissioningStep, statuses: dict[StepId, StepStatus]) -> str:
        """Return why a step cannot start now; empty if it can."""
        live_state = self._actuator.live_state
        if self._running is not None:
            return messages.other_step_in_progress(title=STEP[self._running.step].title)
        if live_state.task is not None:
            return messages.run_in_progress(run=live_state.task.run)
        if live_state.mode is not Mode.OFF:
            return messages.mode_is_not_off(mode=live_state.mode)
        return find_blocking_steps(step, statuses)
