"""Runs single steps of the commissioning, and whole sessions on the command line without the service."""

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from backend.commissioning import messages, status
from backend.commissioning.procedure import (
    DirectionsDisprovedError,
    ProcedureContext,
    RequestConfirmation,
    StepFailedError,
    StepFinding,
)
from backend.commissioning.procedures import (
    apply_pretension,
    calibrate_load_cells,
    check_directions,
    check_safety_module,
    check_wiring,
    home_joint,
    require_weights,
    set_zero,
    tare_load_cells,
)
from backend.commissioning.status import StepStatus, find_blocking_steps
from backend.commissioning.steps import FURTHER_WEIGHTS, STEP, StepId
from backend.errors import check_range
from backend.realtime import (
    Accepted,
    LoopExitedError,
    Mode,
    ProveDirections,
    Refused,
    SetMode,
    Setup,
    SimulateManualInput,
    Supervisor,
    SwitchDrives,
)
from backend.storage import Database, StorageError, StoredSetting, StoredStepResult, settings
from backend.supervision import Supervision
from plant import (
    NO_MANUAL_INPUT,
    ErrorCode,
    PlantChoice,
    PlantKind,
    PlantParameters,
    SinewError,
    Wiring,
    apply_calibration,
    load_wiring_choice,
    wiring_fingerprint,
)

# Steps ---------------------------------------------------------------------------------------------
# Runs one step. However it ends, the outputs are at zero volts and no manual input is simulated.


_PROCEDURES: dict[StepId, Callable[[ProcedureContext], Awaitable[StepFinding]]] = {
    StepId.WIRING_TEST: check_wiring,
    StepId.TARE: tare_load_cells,
    StepId.CALIBRATE: calibrate_load_cells,
    StepId.ZERO: set_zero,
    StepId.DIRECTION: check_directions,
    StepId.HOME: home_joint,
    StepId.PRETENSION: apply_pretension,
    StepId.SAFETY_MODULE: check_safety_module,
}


def collect_values(step: StepId, given: Mapping[str, float]) -> dict[str, float]:
    """Return all inputs of a step, with defaults, and the further weights of a calibration.

    Raises OutOfRangeError, ValueError for an input that the step does not have.
    """
    further = [more for more in FURTHER_WEIGHTS if more.name in given] if step is StepId.CALIBRATE else []
    asked = {wanted.name: wanted for wanted in (*STEP[step].inputs, *further)}
    unknown = ", ".join(sorted(set(given) - set(asked)))
    if unknown:
        raise ValueError(messages.unknown_inputs(step=step, unknown=unknown, known=", ".join(asked)))
    values = {name: float(given.get(name, wanted.default)) for name, wanted in asked.items()}
    for name, value in values.items():
        wanted = asked[name]
        check_range(name, value, wanted.minimum, wanted.maximum, wanted.unit, label=wanted.words)
    if step is StepId.CALIBRATE:
        require_weights(values)
    return values


async def run_step(step: StepId, context: ProcedureContext) -> StepFinding:
    """Run a step and return its finding, also if it fails.

    Raises LoopExitedError, and CancelledError if it is cancelled. A cancelled motor test is a failed finding instead:
    the person may have cancelled it because the motor turned the wrong way.
    """
    try:
        finding = await _PROCEDURES[step](context)
        if step is StepId.DIRECTION and finding.passed:
            await context.send(ProveDirections())
    except StepFailedError as error:
        finding = StepFinding(False, error.message, disproves_directions=isinstance(error, DirectionsDisprovedError))
    except TimeoutError as error:
        finding = StepFinding(False, str(error))
    except asyncio.CancelledError:
        if not context.has_tried_motors:
            raise
        finding = StepFinding(False, messages.abandoned_after_motor_test())
    finally:
        await _ensure_safe_end(context)
    is_in_doubt = finding.disproves_directions or step in (StepId.WIRING_TEST, StepId.DIRECTION)
    if is_in_doubt and not finding.passed:
        with suppress(LoopExitedError):  # the next loop starts with unproven directions
            await context.loop.send(ProveDirections(proven=False))
    return finding


async def _ensure_safe_end(context: ProcedureContext) -> None:
    try:
        if context.is_simulated:
            await context.loop.send(SimulateManualInput(NO_MANUAL_INPUT))
        # Without a check of the mode: the newest sample may miss a command of the last tick. Mode off rejects this.
        await context.loop.send(SetMode(Mode.STOPPING))
    except LoopExitedError:
        pass  # the outputs are at zero volts without the loop


# Drive lockout -------------------------------------------------------------------------------------
# While people work at the rig, the control loop keeps the drives disabled. The database stores the
# lockout for the next start of the service.


_log = logging.getLogger(__name__)


class DriveLockout:
    """Stores whether the drives are locked, separately for the rig and the virtual card.

    ``previous_lock``: who locked the drives and when, if that was before this start and nobody has switched them since.
    ``problem``: why the lockout could not be stored; empty otherwise.
    """

    def __init__(self, database: Database, plant: PlantChoice) -> None:
        self.problem: str = ""
        self._database = database
        self._lock = asyncio.Lock()
        self._key = f"people at the {plant.name}"
        self.previous_lock: StoredSetting | None = None
        if plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
            with database.reading() as session:
                lockout = settings.newest(session, self._key)
            self.previous_lock = lockout if lockout is not None and lockout.value else None

    async def store(self, is_locked: bool, who: str) -> None:
        """Store the lockout. A failure sets ``problem`` and does not raise."""
        self.previous_lock = None
        try:
            async with self._lock:  # in the order in which the loop switched
                await asyncio.to_thread(self._store, is_locked, who)
        except StorageError as error:
            _log.exception("The service could not store the drive lockout.")
            self.problem = messages.lockout_not_stored(state="off" if is_locked else "on", reason=error.message)
        else:
            self.problem = ""

    def _store(self, is_locked: bool, who: str) -> None:
        with self._database.session() as session:
            settings.save(session, self._key, is_locked, who)


async def switch_drives(supervisor: Supervisor, lockout: DriveLockout, on: bool, who: str) -> Accepted | Refused:
    """Switch the drives on or off and store the lockout.

    If the loop process has exited, the drives are off, and the next loop starts with locked drives; to switch them on
    then raises LoopExitedError. A lock is stored even if the loop does not answer.
    """
    try:
        answer = await supervisor.send(SwitchDrives(on))
    except LoopExitedError:
        if on:
            raise
        supervisor.setup = replace(supervisor.setup, drives_off=True)
        answer = Accepted(0, 0)
    finally:
        if not on:
            await lockout.store(True, who)
    if on and isinstance(answer, Accepted):
        await lockout.store(False, who)
    return answer


# Session -------------------------------------------------------------------------------------------
# Commissioning from the command line: a control loop of its own, with the steps and the stored
# results of the service.


@dataclass(frozen=True)
class OperatorDialog:
    """The person at the terminal: name, a function that waits for a confirmation, one that shows the phase."""

    name: str
    request_confirmation: RequestConfirmation
    report_phase: Callable[[str], None]


class BlockedError(SinewError):
    """A step cannot start yet; the message says what must be done first."""

    category = ErrorCode.NOT_NOW


class CommissioningSession:
    """Runs steps on one control loop, which it restarts with the results of a calibration, as the service does."""

    def __init__(
        self,
        database: Database,
        supervisor: Supervisor,
        parameters: PlantParameters,
        dialog: OperatorDialog,
        wiring: Wiring,
        lockout: DriveLockout,
    ) -> None:
        self._database = database
        self.supervisor = supervisor
        self._parameters = parameters
        self._dialog = dialog
        self._wiring = wiring
        self._lockout = lockout
        self._started = datetime.now(UTC)

    @property
    def lockout_problem(self) -> str:
        """Why the drive lockout could not be stored for the next start; empty otherwise."""
        return self._lockout.problem

    def states(self) -> dict[StepId, StepStatus]:
        """Return the status of each step."""
        return status.determine_statuses(status.load_results(self._database), self._wiring, self._started)

    def require_startable(self, step: StepId) -> None:
        """Raise BlockedError unless the step can start, PlantError for an unreadable wiring file."""
        file = load_wiring_choice(self.supervisor.setup.plant)
        if {wiring_fingerprint(file), wiring_fingerprint(self._wiring)} != {self.supervisor.started_with.wired}:
            raise BlockedError(messages.wiring_file_changed())
        blocked = find_blocking_steps(STEP[step], self.states())
        if blocked:
            raise BlockedError(messages.step_blocked(step=STEP[step].title, reason=blocked))

    async def run(self, step: StepId, values: Mapping[str, float], cells: str = "AB") -> StoredStepResult:
        """Run a step and store its result. Raises BlockedError.

        A cancelled step stores nothing; but after the test of a motor, directions are no longer proven.
        """
        self.require_startable(step)
        setup = self.supervisor.setup
        context = ProcedureContext(
            self.supervisor,
            apply_calibration(self._wiring, setup.commissioning_results.calibrations),
            self._parameters,
            dict(values),
            is_simulated=setup.plant.simulated,
            request_confirmation=self._dialog.request_confirmation,
            set_drives=lambda on: switch_drives(self.supervisor, self._lockout, on, self._dialog.name),
            report_phase=self._dialog.report_phase,
            cells=cells,
        )
        try:
            finding = await run_step(step, context)
        except LoopExitedError as error:
            finding = StepFinding(False, str(error))
        # No await between the end of the step and the storing of its result, so it cannot be cancelled in between.
        lockout = status.store_result(self._database, step, self._wiring, finding, self._dialog.name)
        must_restart = finding.passed and finding.calibrations
        if must_restart:
            self._wiring = load_wiring_choice(setup.plant)  # the file that the new loop reads
        self.supervisor.setup = replace(
            self.supervisor.setup, commissioning_results=status.load_commissioning_results(self._database, self._wiring)
        )
        if must_restart:
            self._dialog.report_phase(messages.restarting_with_measured_values())
            await self.supervisor.restart(messages.restarted_with_measured_values())
            self._started = datetime.now(UTC)
        return lockout


@asynccontextmanager
async def open_session(
    database: Database, setup: Setup, parameters: PlantParameters, dialog: OperatorDialog
) -> AsyncIterator[CommissioningSession]:
    """Start a control loop; at the end of the block set zero volts and release the card.

    The caller has confirmed that nobody works at the rig. Raises LoopExitedError, PlantError.
    """
    wiring = load_wiring_choice(setup.plant)
    setup = replace(
        setup, commissioning_results=status.load_commissioning_results(database, wiring)
    )  # results may be new since
    supervision = Supervision()
    supervisor = Supervisor(setup, supervision)
    try:
        lockout = DriveLockout(database, setup.plant)
        await supervisor.start()
        if lockout.previous_lock is not None:
            await lockout.store(False, dialog.name)
        yield CommissioningSession(
            database=database,
            supervisor=supervisor,
            parameters=parameters,
            dialog=dialog,
            wiring=wiring,
            lockout=lockout,
        )
    finally:
        await supervisor.stop(messages.bring_up_ended())
        await supervision.close()
