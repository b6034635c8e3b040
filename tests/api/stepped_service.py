"""The parts of the service with a loop that is stepped in this process, without another process or a port."""

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, TypeVar

from backend.auth.authentication import User
from backend.commissioning.session import DriveLockout
from backend.event_bus import EventBus
from backend.execution.runner import ExperimentRig
from backend.realtime.commands import Accepted, Command, Refused
from backend.realtime.headless import SimulatedLoop
from backend.realtime.ipc import Setup
from backend.realtime.program import SetTuning
from backend.realtime.ring_buffer import Ring
from backend.realtime.supervisor import EventListener, LoopExitedError, Supervisor
from backend.recording.recorder import Recorder
from backend.schemas.session import Role
from backend.schemas.state import State
from backend.services.actuator import ActuatorService, SafeStop, SessionRuns
from backend.services.background_work import TextWork
from backend.services.banks import StoredBanks
from backend.services.event_log import EventLog
from backend.services.identifications import StoredIdentifications
from backend.services.jobs import JobManager
from backend.services.library import OwnExperiments
from backend.services.queue import DryRuns
from backend.services.runs import StoredRuns
from backend.services.state import LiveState, ServiceState
from backend.services.tuning import SavedTunings
from backend.services.tuning_state import TuningStore
from backend.storage.database import Database
from backend.supervision import Supervision
from backend.workers import WorkerProcess
from plant.interface import SIMULATOR, Plant
from plant.parameters import PlantParameters
from plant.simulator import Simulator

T = TypeVar("T")
SEED = 0
OPERATOR = User("A. Operator", Role.OPERATOR, "session")


class Stepped(Supervisor):
    """A supervisor whose loop is stepped in this process.

    With ``dead`` it answers as after the death of its process, with ``refuses`` it rejects a tuning with this reason.
    """

    def __init__(self, setup: Setup, loop: SimulatedLoop) -> None:
        super().__init__(setup)
        self._stepped = loop
        self.ring = loop.ring
        self.dead = False
        self.refuses = ""

    @property
    def is_alive(self) -> bool:
        return not self.dead

    def listen(self, listener: EventListener) -> Callable[[], None]:
        return self._stepped.listen(listener)

    async def send(self, command: Command) -> Accepted | Refused:
        if self.dead:
            raise LoopExitedError("the loop process was killed")
        if self.refuses and isinstance(command, SetTuning):
            return Refused(0, 0, self.refuses)
        return await self._stepped.send(command)

    async def advance(self, seconds: float) -> None:
        await self._stepped.advance(seconds)

    async def advance_until(self, reached: Callable[[], bool], timeout_s: float) -> None:
        await self._stepped.advance_until(reached, timeout_s)


class InProcessWorker(WorkerProcess):
    """A worker that executes its work in this process."""

    async def run(self, work: Callable[..., T], *arguments: Any, **_none: Any) -> T:
        return await asyncio.to_thread(work, *arguments)


@dataclass(frozen=True)
class Parts:
    """The parts of the service that execute requests."""

    supervisor: Stepped
    live_state: LiveState
    service_state: ServiceState
    actuator: ActuatorService
    ordered_runs: JobManager
    saved_tunings: SavedTunings
    runs: StoredRuns
    identifications: StoredIdentifications
    tuning_store: TuningStore
    event_log: EventLog
    events: EventBus
    database: Database

    def state(self) -> State:
        """Return the state as the page shows it."""
        return self.service_state.view()

    async def ended(self) -> None:
        """Wait until no run is active and the queue has nothing to start."""
        while self.live_state.task is not None or self.ordered_runs.queue.view().running:
            await asyncio.sleep(0.01)


@contextmanager
def stepped_service(database: Database, parameters: PlantParameters, plant: Plant | None = None) -> Iterator[Parts]:
    """Build the parts of a service in this process, as after a start on this database."""
    tuning_store = TuningStore(database)
    tuning, _ = tuning_store.restore(parameters)
    recorders: list[Recorder] = []

    def record(_ring: Ring) -> None:
        for recorder in recorders:
            recorder.drain()

    loop = SimulatedLoop(plant or Simulator(parameters, SEED), parameters, tuning.build_command(), record)
    recorder = Recorder(database, loop.ring)
    recorders.append(recorder)
    loop.listen(recorder.on_event)
    supervisor, supervision = (
        Stepped(Setup(SIMULATOR, parameters.name, SEED, tuning.build_command()), loop),
        Supervision(),
    )
    events = EventBus()
    live_state, event_log = LiveState(supervisor, parameters, tuning), EventLog(database, events)
    sessions = SessionRuns(database, "simulator")
    hands = DriveLockout(database, SIMULATOR)
    actuator = ActuatorService(
        supervisor, live_state, database, sessions, event_log, tuning_store, recorder.follow, supervision, hands, events
    )
    service_state = ServiceState(
        live_state=live_state,
        contact=actuator.contact.view,
        trial=actuator.tuning_service.view_trial,
        trigger=lambda: None,
        player=actuator.player.view,
        holder=lambda: None,
        users=list,
        handovers=list,
        problems=list,
    )
    here = InProcessWorker(lambda _cause: None)
    ordered_runs = JobManager(
        ExperimentRig(supervisor, database, "simulator", parameters),
        actuator,
        StoredBanks(database, here, lambda: live_state.tuning),
        OwnExperiments(database),
        lambda: None,
        SEED,
        DryRuns(here),
        TextWork(here, here),
        supervision,
        SafeStop(supervisor, live_state, supervision),
    )
    runs = StoredRuns(database, lambda: live_state.task, lambda _run: False)
    try:
        yield Parts(
            supervisor,
            live_state,
            service_state,
            actuator,
            ordered_runs,
            SavedTunings(database),
            runs,
            StoredIdentifications(database, runs.compute_progress, here, lambda: live_state.tuning),
            tuning_store,
            event_log,
            events,
            database,
        )
    finally:
        event_log.close()
        loop.close()
        recorder.close()


def stepped(
    database: Database,
    parameters: PlantParameters,
    work: Callable[[Parts], Coroutine[Any, Any, T]],
    plant: Plant | None = None,
) -> T:
    """Start the service, execute ``work`` with its parts, and end it."""

    async def whole() -> T:
        with stepped_service(database, parameters, plant) as parts:
            return await work(parts)

    return asyncio.run(whole())
