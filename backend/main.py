"""The service: puts the parts together, runs them while the web server runs, and takes them down again."""

import asyncio
import gc
import logging
import os
import socket
import sys
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from typing import Any

from fastapi import APIRouter, FastAPI

from backend import logs
from backend.access.authentication import PART as TOKENS
from backend.access.authentication import Authentication
from backend.access.control import PART as CONTROL
from backend.access.control import Control
from backend.access.sessions import Sessions
from backend.access.tokens import TokenFiles, Tokens
from backend.api.app import create_app, put_routes_together
from backend.api.auth import signed_in
from backend.api.service import Service
from backend.archive.downloads import Downloads
from backend.archive.evaluations import Evaluations
from backend.archive.history import History
from backend.archive.maintenance import Maintenance
from backend.archive.preferences import StoredPreferences
from backend.archive.replay import Replay
from backend.archive.retention import PART as RETENTION
from backend.archive.retention import Retention
from backend.archive.soundness import Soundness
from backend.archive.stored_banks import StoredBanks
from backend.archive.stored_identifications import StoredIdentifications
from backend.archive.stored_runs import StoredRuns
from backend.bring_up.hands import KeptHands
from backend.bring_up.standing import brought_up_of
from backend.data_folder import PART as FOLDER
from backend.data_folder import FolderWatch, HeldFolder, only_service_on
from backend.ending import Ending, address_on
from backend.experiments.playing.runner import Station
from backend.experiments.results.evaluation import evaluate
from backend.faults import Fault
from backend.forks import refuse_forks
from backend.loop.channel import Setup
from backend.loop.supervisor import Supervisor
from backend.messages.live import MarkKind, StateMessage
from backend.operating.actuator import Actuator
from backend.operating.bring_up import BringUp
from backend.operating.dry_runs import DryRuns
from backend.operating.journal import PART as JOURNAL
from backend.operating.journal import Journal
from backend.operating.kept_tuning import KeptTuning
from backend.operating.live_stream import PART as LIVE
from backend.operating.live_stream import LiveStream
from backend.operating.ordered_runs import OrderedRuns
from backend.operating.present_state import PresentState
from backend.operating.safe_stop import SafeStop
from backend.operating.saved_tunings import SavedTunings
from backend.operating.session_runs import SessionRuns
from backend.operating.tuning_in_use import TuningInUse
from backend.private import UMASK, make_private
from backend.processes import Processes
from backend.recording.flight import PART as FLIGHTS
from backend.recording.flight import FlightRecorder, Quota
from backend.recording.recorder import PART as RECORDER
from backend.recording.recorder import Recorder
from backend.recording.retention import Rule
from backend.scene.mirror import PART as SCENE
from backend.scene.mirror import SceneMirror
from backend.scene.proxy import router as scene_router
from backend.settings import Settings
from backend.storage import Database, open_database, runs
from backend.supervision import Part, Supervision
from backend.web_server.places import raise_limit
from backend.web_server.server import Server, listening_on
from plant.parameters import load_parameters

SEED = 0
NICENESS = -10
SWITCH_S = 0.5e-3
"""Each thread that answers somebody may keep Python's lock from the event loop, and so from STOP, for so long [s]."""

_log = logging.getLogger(__name__)


def serve(settings: Settings, ready: Callable[[str, Tokens | None], None]) -> None:
    """Run the service until it is told to end. ``ready`` gets the address and the tokens once it answers.

    Raises AlreadyRunningError, DataFolderError, CannotListenError, and what keeps a part from starting.
    """
    os.umask(UMASK)
    logs.begin()
    raise_limit()
    refuse_forks()
    with only_service_on(settings.data) as folder, listening_on(settings.host, settings.port) as listening:
        make_private(settings.data)
        _ask_for_priority()
        sys.setswitchinterval(SWITCH_S)
        asyncio.run(_serve(settings, folder, listening, ready))


async def _serve(
    settings: Settings, folder: HeldFolder, listening: socket.socket, ready: Callable[[str, Tokens | None], None]
) -> None:
    files = TokenFiles(settings.data) if settings.require_token else None
    authentication = Authentication(files, Sessions(settings.data))
    parts, ending = AsyncExitStack(), Ending()

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        async with parts:
            yield

    try:
        # All that computes for long is done before the loop starts: it counts on the heartbeat.
        supervision = Supervision()
        parts.push_async_callback(supervision.close)
        supervisor, recorder, service, scenes = _build(settings, folder, authentication, supervision, parts)
        app = create_app(lifespan, scenes, settings.allowed_hosts)
        app.state.service, app.state.authentication = service, authentication
        await put_routes_together(app)
        _collect_garbage()
        await _start_loop(supervisor, recorder, supervision, ending, parts)
        parts.push_async_callback(lambda: service.ordered_runs.close(ending.cause))
    except BaseException:
        await parts.aclose()
        raise
    address = address_on(settings.host, listening.getsockname()[1])

    def announce() -> None:
        folder.say_address(address)
        ready(address, files.tokens if files else None)

    await Server(app, announce, ending).serve([listening])


def _collect_garbage() -> None:
    """Leave what the start has made to the end of the process: to look through it again takes a third of a second."""
    gc.collect()
    gc.freeze()


def _build(
    settings: Settings,
    folder: HeldFolder,
    authentication: Authentication,
    supervision: Supervision,
    stack: AsyncExitStack,
) -> tuple[Supervisor, Recorder, Service, list[APIRouter]]:
    """Put all parts together, each taken down again by ``stack``, in reverse."""

    def keep(
        part: Part, work: Callable[[], Coroutine[Any, Any, None]], on_death: Callable[[], None] | None = None
    ) -> None:
        stack.push_async_callback(supervision.keep_task(part, work, on_death).end)

    parameters = load_parameters(settings.params)
    database = open_database(settings.data, settings.database_url, settings.database_password())
    stack.callback(database.close)
    soundness = Soundness(database, settings.data)
    soundness.before_start()
    _close_interrupted(database)
    kept = KeptTuning(database)
    tuning, said = kept.restore(parameters)
    brought_up = brought_up_of(database, settings.plant_choice)
    hands = KeptHands(database, settings.plant_choice)
    setup = Setup(settings.plant_choice, settings.params, SEED, tuning.command(), brought_up, hands.left is not None)
    supervisor = Supervisor(setup, supervision)
    recorder = Recorder(database, supervisor.ring)
    supervisor.listen(recorder.hear)

    quota = Quota(settings.flight_records, settings.flight_records_MB * 1_000_000)
    flights = FlightRecorder(database, lambda: supervisor.ring, quota)
    supervisor.listen(flights.hear)
    stack.callback(flights.close)
    keep(FLIGHTS, flights.run)

    def problems() -> list[str]:
        first = watch, soundness, recorder, flights, journal
        parts = *first, supervisor.guard, retention, authentication.sessions, bring_up, hands
        return [*(part.problem for part in parts if part.problem), *supervision.problems, *ordered_runs.problems]

    retention = Retention(database, Rule(round(settings.recordings_GB * 1e9), settings.recordings_keep_days))
    keep(RETENTION, retention.run)

    journal = Journal(database)
    stack.callback(journal.close)
    keep(JOURNAL, journal.run)
    if said:
        journal.note(MarkKind.TUNING, said, tick=0)
    present = PresentState(supervisor, parameters, tuning, problems)
    supervision.listen(lambda death: journal.note(MarkKind.FAULT, death, present.tick))
    safe_stop = SafeStop(supervisor, present, supervision)
    sessions = SessionRuns(database, settings.plant_choice.name, parameters)
    actuator = Actuator(supervisor, present, sessions, journal, kept, recorder.follow, supervision, hands)
    control = Control(actuator.operator_lost, actuator.note_control)
    control.let_go = actuator.let_go
    present.holder, present.people = control.view, authentication.people.view
    keep(TOKENS, authentication.run)
    stack.push_async_callback(authentication.sessions.save)
    keep(CONTROL, control.run, lambda: safe_stop.begin(Fault.OPERATOR_LOST))
    live = LiveStream(lambda: supervisor.ring, lambda: StateMessage(**dict(present.state())))
    journal.on_mark(live.announce)
    actuator.on_change(live.state_changed)
    keep(LIVE, live.run)
    watch = FolderWatch((folder.problem, soundness.displaced), actuator.changed)
    keep(FOLDER, watch.run)
    soundness.start()

    history = History(database, parameters, lambda: _id_of_bank(present.operators_tuning))
    processes = Processes(supervision)
    stack.callback(processes.close)
    downloads = Downloads(database, processes.reports)
    evaluations = Evaluations(database, processes.computing, lambda: present.task)
    stored_runs = StoredRuns(
        database, lambda: present.task, lambda run: evaluations.includes(run) or ordered_runs.is_evaluating(run)
    )
    banks = StoredBanks(database, processes.computing, lambda: present.tuning)
    station = Station(supervisor, database, settings.plant_choice.name, parameters, processes.computing.run)

    def prepare() -> None:
        """Load what evaluation and report need while the program still plays."""
        processes.computing.prepare(evaluate)
        downloads.prepare()

    ordered_runs = OrderedRuns(
        station, actuator, banks, prepare, SEED, DryRuns(processes.dry_runs), supervision, safe_stop
    )
    evaluations.done = ordered_runs.evaluated

    replay = Replay(database)
    mirrors = {
        "/scene": SceneMirror(parameters, lambda: supervisor.ring.newest()),
        "/replay": SceneMirror(parameters, replay.row),
    }
    for mirror in mirrors.values():
        stack.callback(mirror.close)
        stack.callback(supervision.keep_thread(SCENE, mirror.run, mirror.end).end, 2.0)
    scenes = [scene_router(signed_in, mirror, path) for path, mirror in mirrors.items()]
    bring_up = BringUp(actuator, supervisor, database, parameters, hands)
    stack.push_async_callback(bring_up.close)
    service = Service(
        actuator=actuator,
        control=control,
        ordered_runs=ordered_runs,
        saved_tunings=SavedTunings(database),
        bring_up=bring_up,
        live=live,
        runs=stored_runs,
        identifications=StoredIdentifications(database, stored_runs.progress),
        evaluations=evaluations,
        banks=banks,
        preferences=StoredPreferences(database),
        history=history,
        replay=replay,
        downloads=downloads,
        maintenance=Maintenance(database, settings.data, supervisor),
        retention=retention,
    )
    return supervisor, recorder, service, scenes


async def _start_loop(
    supervisor: Supervisor, recorder: Recorder, supervision: Supervision, ending: Ending, stack: AsyncExitStack
) -> None:
    """Start the loop process and record it; both end before the other parts do."""

    async def stop() -> None:
        recorder.ended_by = ending.cause
        await supervisor.stop(ending.cause)

    await supervisor.start()
    recorder.follow(supervisor.ring)
    stack.push_async_callback(asyncio.to_thread, recorder.close)
    stack.callback(supervision.keep_thread(RECORDER, recorder.keep_recording, recorder.end).end)
    stack.push_async_callback(stop)


def _close_interrupted(database: Database) -> None:
    with database.session() as session:
        interrupted = runs.close_interrupted(session)
    if interrupted:
        _log.warning("runs closed that the last service left open: %s", interrupted)


def _id_of_bank(tuning: TuningInUse) -> int | None:
    return None if tuning.bank is None else tuning.bank.id


def _ask_for_priority() -> None:
    """Come before ordinary programs where the machine grants it: the loop stops where it hears nothing."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
