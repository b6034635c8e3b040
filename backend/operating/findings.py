"""What the steps of the bring-up come to in the service: kept, put in force, and taken back where it proved wrong."""

import asyncio
import logging
from dataclasses import replace

from backend.commissioning import steps
from backend.commissioning.steps import STEP, Finding, StepId
from backend.errors import RefusalError
from backend.faults import Fault
from backend.operating.actuator import Actuator
from backend.realtime.commands import Event, Stopped
from backend.realtime.supervisor import LoopDied, LoopDiedError, Supervisor
from backend.storage.database import Database
from plant.calibration import NOT_BROUGHT_UP, BroughtUp, fingerprint
from plant.factory import wiring_of_choice
from plant.interface import PlantError, PlantKind
from plant.wiring import Wiring

NOT_YET = "takes effect at the next start of the loop: do it again in off, or start the service anew"

_log = logging.getLogger(__name__)


class Findings:
    """Belongs to the service's event loop. ``problem`` tells what could not be kept, or is not in force yet."""

    def __init__(self, actuator: Actuator, supervisor: Supervisor, database: Database) -> None:
        self.problem = ""
        self._actuator = actuator
        self._supervisor = supervisor
        self._database = database
        self._disproving: set[asyncio.Task[None]] = set()
        supervisor.listen(self._hear)
        actuator.in_effect = self._in_effect

    def why_not(self) -> str:
        """Return why there is nothing to be brought up; empty where there is."""
        plant = self._actuator.present.plant
        if plant.kind in (PlantKind.RIG, PlantKind.VIRTUAL_CARD):
            return ""
        return f"a rig is brought up; what is driven here is the {plant.name}"

    async def close(self) -> None:
        """Wait until what was found wrong is kept."""
        if self._disproving:
            await asyncio.wait(self._disproving)

    async def keep(self, step: StepId, wiring: Wiring, finding: Finding, who: str) -> None:
        """Store what a step came to; each start of the loop from here on goes by it, the next one at once if needed."""
        await asyncio.to_thread(steps.keep, self._database, step, wiring, finding, who)
        brought_up = await asyncio.to_thread(steps.in_effect, self._database, wiring)
        self._supervisor.setup = replace(self._supervisor.setup, brought_up=brought_up)
        if not (finding.calibrations and finding.passed):
            return
        try:
            await self._actuator.take_up(lambda: None, "what the bring-up has measured", who)
        except (RefusalError, LoopDiedError) as error:
            self.problem = f"What {STEP[step].title} of the bring-up has measured {NOT_YET} ({error})."

    def _hear(self, event: Event | LoopDied) -> None:
        """Take a motor that turned the wrong way for what it is: the directions are disproved, for later starts too."""
        if isinstance(event, Stopped) and event.fault is Fault.MOTOR_REVERSED and not self.why_not():
            keeping = asyncio.create_task(self._disprove(event.detail))
            self._disproving.add(keeping)
            keeping.add_done_callback(self._disproving.discard)

    async def _disprove(self, seen: str) -> None:
        try:
            wiring = await asyncio.to_thread(self.wiring)
            finding = Finding(False, f"the loop has stopped: {seen}")
            await self.keep(StepId.DIRECTION, wiring, finding, "the loop")
        except Exception as error:
            _log.exception("what disproves the directions could not be kept")
            self.problem = f"Do {STEP[StepId.DIRECTION].title} anew: that they are wrong could not be kept ({error})."
        finally:
            self._actuator.changed()

    def wiring(self) -> Wiring:
        """Return the wiring as its file says it now. Raises PlantError."""
        return wiring_of_choice(self._actuator.present.plant)

    def not_driven(self, wiring: Wiring) -> str:
        """Return why no step can be played: it would be kept for the file of now, and be found with another."""
        if fingerprint(wiring) == self._supervisor.started_with.wired:
            return ""
        return (
            "the wiring file has changed since the loop was started, which goes by the old one: start the service anew"
        )

    def _in_effect(self) -> BroughtUp:
        """Return what the next loop starts with: what was found with the wiring file that it will read."""
        known = self._supervisor.setup.brought_up
        if self.why_not():
            return known
        try:
            wiring = self.wiring()
        except PlantError:
            return NOT_BROUGHT_UP  # the loop says itself why it does not start
        # a start with the wiring of before waits for no database
        return known if fingerprint(wiring) == known.wired else steps.in_effect(self._database, wiring)
