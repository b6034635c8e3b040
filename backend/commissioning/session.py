"""A commissioning session without the service, and the step that it plays."""

import asyncio
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from backend.commissioning import status
from backend.commissioning.procedure import (
    Confirmed,
    DirectionsDisprovedError,
    ProcedureContext,
    StepFailedError,
    StepFinding,
)
from backend.commissioning.procedures import (
    calibrate,
    direction,
    home,
    pretension,
    require_weights,
    safety_module,
    tare,
    wiring_test,
    zero,
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
    NO_HAND,
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

# Engine --------------------------------------------------------------------------------------------
#
# Plays one step, whatever becomes of it: at its end nothing is driven and no hand is left.


_WORK: dict[StepId, Callable[[ProcedureContext], Awaitable[StepFinding]]] = {
    StepId.WIRING_TEST: wiring_test,
    StepId.TARE: tare,
    StepId.CALIBRATE: calibrate,
    StepId.ZERO: zero,
    StepId.DIRECTION: direction,
    StepId.HOME: home,
    StepId.PRETENSION: pretension,
    StepId.SAFETY_MODULE: safety_module,
}


def collect_values(step: StepId, given: Mapping[str, float]) -> dict[str, float]:
    """Return all numbers that a step asks for, and further weights that are given.

    Raises OutOfRangeError, ValueError for one it does not ask for.
    """
    further = [more for more in FURTHER_WEIGHTS if more.name in given] if step is StepId.CALIBRATE else []
    asked = {wanted.name: wanted for wanted in (*STEP[step].inputs, *further)}
    unknown = ", ".join(sorted(set(given) - set(asked)))
    if unknown:
        raise ValueError(f"{step} asks for no {unknown}; it asks for {', '.join(asked) or 'nothing'}")
    values = {name: float(given.get(name, wanted.default)) for name, wanted in asked.items()}
    for name, value in values.items():
        wanted = asked[name]
        check_range(name, value, wanted.minimum, wanted.maximum, wanted.unit, words=wanted.words)
    if step is StepId.CALIBRATE:
        require_weights(values)
    return values


async def run_step(step: StepId, work: ProcedureContext) -> StepFinding:
    """Play a step; what it fails on is its finding. Raises LoopExitedError, and CancelledError where it is given up.

    To give up the trial of a motor is a finding: who does may have seen it go the wrong way.
    """
    try:
        finding = await _WORK[step](work)
        if step is StepId.DIRECTION and finding.passed:
            await work.send(ProveDirections())
    except StepFailedError as failed:
        finding = StepFinding(False, str(failed), disproves_directions=isinstance(failed, DirectionsDisprovedError))
    except TimeoutError as late:
        finding = StepFinding(False, str(late))
    except asyncio.CancelledError:
        if not work.tried_motors:
            raise
        finding = StepFinding(False, "it was given up after a motor had been tried: do it again")
    finally:
        await _left_safe(work)
    doubted = finding.disproves_directions or step in (StepId.WIRING_TEST, StepId.DIRECTION)
    if doubted and not finding.passed:
        with suppress(LoopExitedError):  # the next one starts unproven
            await work.loop.send(ProveDirections(proven=False))
    return finding


async def _left_safe(work: ProcedureContext) -> None:
    try:
        if work.computed:
            await work.loop.send(SimulateManualInput(NO_HAND))
        # Whatever the newest sample says: a command of the last tick may not be in it. In OFF it is refused.
        await work.loop.send(SetMode(Mode.STOPPING))
    except LoopExitedError:
        pass  # what it drove is at zero volts without it


# Hands ---------------------------------------------------------------------------------------------
#
# That hands may be at the rig: told to the loop, which keeps the drives off, and kept for the next
# start.


_log = logging.getLogger(__name__)


class DriveLockout:
    """Keeps in the data folder whether hands may be at what is driven: a rig and a virtual card each by itself.

    ``left`` says who had the drives off and when, where that was before this start and nobody has switched them since.
    ``problem`` tells that it could not be kept.
    """

    def __init__(self, database: Database, plant: PlantChoice) -> None:
        self.problem = ""
        self._database = database
        self._turn = asyncio.Lock()
        self._name = f"hands at the {plant.name}"
        self.left: StoredSetting | None = None
        if plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
            with database.reading() as session:
                kept = settings.newest(session, self._name)
            self.left = kept if kept is not None and kept.value else None

    async def put(self, there: bool, who: str) -> None:
        """Keep it; where the disk refuses, what is driven is safe all the same, and the problem says so."""
        self.left = None
        try:
            async with self._turn:  # in the order in which the loop has obeyed
                await asyncio.to_thread(self._put, there, who)
        except StorageError as error:
            _log.exception("The service could not store whether somebody works at the rig.")
            stays = "off" if there else "on"
            self.problem = f"That the drives are {stays} could not be kept for the next start of the service ({error})."
        else:
            self.problem = ""

    def _put(self, there: bool, who: str) -> None:
        with self._database.session() as session:
            settings.save(session, self._name, there, who)


async def switch_drives(supervisor: Supervisor, kept: DriveLockout, on: bool, who: str) -> Accepted | Refused:
    """Take the drives away or give them back, and keep it. Raises LoopExitedError where they are to come on.

    Without a loop they are off already: the next one starts so. That they are to go off is kept whatever becomes of it.
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
            await kept.put(True, who)
    if on and isinstance(answer, Accepted):
        await kept.put(False, who)
    return answer


# Session -------------------------------------------------------------------------------------------
#
# One person brings a rig up without the service: a loop process of its own, the same steps, kept
# the same way.


@dataclass(frozen=True)
class Prompt:
    """Who brings the rig up: ``confirmed`` asks to do something at it, ``phase`` tells what goes on."""

    name: str
    confirmed: Confirmed
    phase: Callable[[str], None]


class BlockedError(SinewError):
    """A step cannot be started now; the message says what has to come before."""

    category = ErrorCode.NOT_NOW


class Session:
    """Steps over one loop. What a calibration measured takes effect with a new start of it, as in the service."""

    def __init__(
        self,
        database: Database,
        supervisor: Supervisor,
        parameters: PlantParameters,
        person: Prompt,
        wiring: Wiring,
        hands: DriveLockout,
    ) -> None:
        self._database = database
        self.supervisor = supervisor
        self._parameters = parameters
        self._person = person
        self._wiring = wiring
        self._hands = hands
        self._started = datetime.now(UTC)

    @property
    def lockout_problem(self) -> str:
        """What of the drives' lock could not be kept for the next start; empty where all was."""
        return self._hands.problem

    def states(self) -> dict[StepId, StepStatus]:
        """Return how each step stands now."""
        return status.states(status.kept(self._database), self._wiring, self._started)

    def require_startable(self, step: StepId) -> None:
        """Raise BlockedError where something has to come before, PlantError for a wiring file that is none any more."""
        file = load_wiring_choice(self.supervisor.setup.plant)
        if {wiring_fingerprint(file), wiring_fingerprint(self._wiring)} != {self.supervisor.started_with.wired}:
            raise BlockedError("the wiring file has changed since the loop was started: give the command again")
        blocked = find_blocking_steps(STEP[step], self.states())
        if blocked:
            raise BlockedError(f"{STEP[step].title}: {blocked}")

    async def play(self, step: StepId, values: Mapping[str, float], cells: str = "AB") -> StoredStepResult:
        """Play a step and keep what it came to. Raises BlockedError.

        Of a step that is given up nothing is stored; but once a motor was tried, directions are not proven any more.
        """
        self.require_startable(step)
        setup = self.supervisor.setup
        work = ProcedureContext(
            self.supervisor,
            apply_calibration(self._wiring, setup.brought_up.calibrations),
            self._parameters,
            dict(values),
            computed=setup.plant.simulated,
            confirmed=self._person.confirmed,
            switch=lambda on: switch_drives(self.supervisor, self._hands, on, self._person.name),
            phase=self._person.phase,
            cells=cells,
        )
        try:
            finding = await run_step(step, work)
        except LoopExitedError as died:
            finding = StepFinding(False, str(died))
        # Nothing is awaited on the way: it is given up before the result is kept, or after.
        kept = status.keep(self._database, step, self._wiring, finding, self._person.name)
        anew = finding.passed and finding.calibrations
        if anew:
            self._wiring = load_wiring_choice(setup.plant)  # what the new loop will read
        self.supervisor.setup = replace(
            self.supervisor.setup, brought_up=status.in_effect(self._database, self._wiring)
        )
        if anew:
            self._person.phase("starting the loop with what was measured")
            await self.supervisor.restart("with what the step has measured")
            self._started = datetime.now(UTC)
        return kept


@asynccontextmanager
async def open_session(
    database: Database, setup: Setup, parameters: PlantParameters, person: Prompt
) -> AsyncIterator[Session]:
    """Start a loop process; at the end of the block, however it comes, zero volts, and let go of the card.

    Who starts it has said that no hand is at the rig.
    Raises LoopExitedError, PlantError.
    """
    wiring = load_wiring_choice(setup.plant)
    setup = replace(setup, brought_up=status.in_effect(database, wiring))  # a person may have been asked meanwhile
    supervision = Supervision()
    supervisor = Supervisor(setup, supervision)
    try:
        hands = DriveLockout(database, setup.plant)
        await supervisor.start()
        if hands.left is not None:
            await hands.put(False, person.name)
        yield Session(
            database=database, supervisor=supervisor, parameters=parameters, person=person, wiring=wiring, hands=hands
        )
    finally:
        await supervisor.stop("the bring-up has ended")
        await supervision.close()
