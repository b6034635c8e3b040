"""One person brings a rig up without the service: a loop process of its own, the same steps, kept the same way."""

from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime

from backend.bring_up import standing
from backend.bring_up.engine import perform
from backend.bring_up.hands import KeptHands, switch_drives
from backend.bring_up.standing import Standing, blocked_by
from backend.bring_up.steps import STEP, StepId
from backend.bring_up.work import Confirmed, Finding, Work
from backend.realtime.ipc import Setup
from backend.realtime.supervisor import LoopDiedError, Supervisor
from backend.storage.commissioning import StepResult
from backend.storage.database import Database
from backend.supervision import Supervision
from plant.calibration import calibrated, fingerprint
from plant.factory import wiring_of_choice
from plant.parameters import PlantParameters
from plant.wiring import Wiring


@dataclass(frozen=True)
class Person:
    """Who brings the rig up: ``confirmed`` asks to do something at it, ``phase`` tells what goes on."""

    name: str
    confirmed: Confirmed
    phase: Callable[[str], None]


class BlockedError(Exception):
    """A step cannot be started now; the message says what has to come before."""


class Session:
    """Steps over one loop. What a calibration measured takes effect with a new start of it, as in the service."""

    def __init__(
        self,
        database: Database,
        supervisor: Supervisor,
        parameters: PlantParameters,
        person: Person,
        wiring: Wiring,
        hands: KeptHands,
    ) -> None:
        self._database = database
        self.supervisor = supervisor
        self._parameters = parameters
        self._person = person
        self._wiring = wiring
        self._hands = hands
        self._started = datetime.now(UTC)

    @property
    def unkept(self) -> str:
        """What of the drives' lock could not be kept for the next start; empty where all was."""
        return self._hands.problem

    def states(self) -> dict[StepId, Standing]:
        """Return how each step stands now."""
        return standing.states(standing.kept(self._database), self._wiring, self._started)

    def require_free(self, step: StepId) -> None:
        """Raise BlockedError where something has to come before, PlantError for a wiring file that is none any more."""
        file = wiring_of_choice(self.supervisor.setup.plant)
        if {fingerprint(file), fingerprint(self._wiring)} != {self.supervisor.started_with.wired}:
            raise BlockedError("the wiring file has changed since the loop was started: give the command again")
        blocked = blocked_by(STEP[step], self.states())
        if blocked:
            raise BlockedError(f"{STEP[step].title}: {blocked}")

    async def play(self, step: StepId, values: Mapping[str, float], cells: str = "AB") -> StepResult:
        """Play a step and keep what it came to. Raises BlockedError.

        Of a step that is given up nothing is stored; but once a motor was tried, directions are not proven any more.
        """
        self.require_free(step)
        setup = self.supervisor.setup
        work = Work(
            self.supervisor,
            calibrated(self._wiring, setup.brought_up.calibrations),
            self._parameters,
            dict(values),
            computed=setup.plant.simulated,
            confirmed=self._person.confirmed,
            switch=lambda on: switch_drives(self.supervisor, self._hands, on, self._person.name),
            phase=self._person.phase,
            cells=cells,
        )
        try:
            finding = await perform(step, work)
        except LoopDiedError as died:
            finding = Finding(False, str(died))
        # Nothing is awaited on the way: it is given up before the result is kept, or after.
        kept = standing.keep(self._database, step, self._wiring, finding, self._person.name)
        anew = finding.passed and finding.calibrations
        if anew:
            self._wiring = wiring_of_choice(setup.plant)  # what the new loop will read
        self.supervisor.setup = replace(
            self.supervisor.setup, brought_up=standing.in_effect(self._database, self._wiring)
        )
        if anew:
            self._person.phase("starting the loop with what was measured")
            await self.supervisor.restart("with what the step has measured")
            self._started = datetime.now(UTC)
        return kept


@asynccontextmanager
async def session(
    database: Database, setup: Setup, parameters: PlantParameters, person: Person
) -> AsyncIterator[Session]:
    """Start a loop process; at the end of the block, however it comes, zero volts, and let go of the card.

    Who starts it has said that no hand is at the rig.
    Raises LoopDiedError, PlantError.
    """
    wiring = wiring_of_choice(setup.plant)
    setup = replace(setup, brought_up=standing.in_effect(database, wiring))  # a person may have been asked meanwhile
    supervision = Supervision()
    supervisor = Supervisor(setup, supervision)
    try:
        hands = KeptHands(database, setup.plant)
        await supervisor.start()
        if hands.left is not None:
            await hands.put(False, person.name)
        yield Session(database, supervisor, parameters, person, wiring, hands)
    finally:
        await supervisor.stop("the bring-up has ended")
        await supervision.close()
