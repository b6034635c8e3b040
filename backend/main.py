"""The service: puts the parts together, runs them while the web server runs, and takes them down again."""

import asyncio
import gc
import logging
import os
import socket
import sys
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from typing import Any

from fastapi import APIRouter, FastAPI

from backend.api import logs
from backend.api.app import create_app, put_routes_together
from backend.api.auth import signed_in
from backend.api.bench import Bench
from backend.api.bring_up import BringUp
from backend.api.care import Care
from backend.api.control import PART as CONTROL
from backend.api.control import Control
from backend.api.desk import Desk
from backend.api.door import raise_limit
from backend.api.downloads import Downloads
from backend.api.dry_runs import DryRuns
from backend.api.evaluations import Evaluations
from backend.api.gate import PART as GATE
from backend.api.gate import Gate
from backend.api.history import History
from backend.api.journal import PART as JOURNAL
from backend.api.journal import Journal
from backend.api.kept_tuning import KeptTuning
from backend.api.library import Library
from backend.api.live import PART as LIVE
from backend.api.live import LiveStream
from backend.api.picture import Picture
from backend.api.processes import Processes
from backend.api.replay import Replay
from backend.api.retention import PART as RETENTION
from backend.api.retention import Retention
from backend.api.safe_stop import SafeStop
from backend.api.schemas.live import MarkKind, StateMessage
from backend.api.server import Server
from backend.api.service import Service
from backend.api.session_runs import SessionRuns
from backend.api.sessions import Sessions
from backend.api.shelf import Shelf
from backend.api.tasks import Tasks
from backend.api.tokens import TokenFiles, Tokens
from backend.api.tuning_in_use import TuningInUse
from backend.api.upkeep import Upkeep
from backend.bring_up.standing import brought_up_of
from backend.data_folder import PART as FOLDER
from backend.data_folder import FolderWatch, HeldFolder, only_service_on
from backend.ending import Ending, address_on
from backend.experiments.evaluation import evaluate
from backend.experiments.runner import Station
from backend.faults import Fault
from backend.forks import refuse_forks
from backend.loop.channel import Setup
from backend.loop.supervisor import Supervisor
from backend.private import UMASK, make_private
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
from plant.parameters import load_parameters

SEED = 0
NICENESS = -10
SWITCH_S = 0.5e-3
"""Each thread that answers somebody may keep Python's lock from the event loop, and so from STOP, for so long [s]."""

_log = logging.getLogger(__name__)


class CannotListenError(Exception):
    """The address cannot be listened on."""


def serve(settings: Settings, ready: Callable[[str, Tokens | None], None]) -> None:
    """Run the service until it is told to end. ``ready`` gets the address and the tokens once it answers.

    Raises AlreadyRunningError, DataFolderError, CannotListenError, and what keeps a part from starting.
    """
    os.umask(UMASK)
    logs.begin()
    raise_limit()
    refuse_forks()
    with only_service_on(settings.data) as folder, _listening(settings) as listening:
        make_private(settings.data)
        _ask_for_priority()
        sys.setswitchinterval(SWITCH_S)
        asyncio.run(_serve(settings, folder, listening, ready))


async def _serve(
    settings: Settings, folder: HeldFolder, listening: socket.socket, ready: Callable[[str, Tokens | None], None]
) -> None:
    files = TokenFiles(settings.data) if settings.require_token else None
    gate = Gate(files, Sessions(settings.data))
    parts, ending = AsyncExitStack(), Ending()

    @asynccontextmanager
    async def lifespan(_app: FastAPI) -> AsyncIterator[None]:
        async with parts:
            yield

    try:
        # All that computes for long is done before the loop starts: it counts on the heartbeat.
        supervision = Supervision()
        parts.push_async_callback(supervision.close)
        supervisor, recorder, service, scenes = _build(settings, folder, gate, supervision, parts)
        app = create_app(lifespan, scenes, settings.allowed_hosts)
        app.state.service, app.state.gate = service, gate
        await put_routes_together(app)
        _collect_garbage()
        await _start_loop(supervisor, recorder, supervision, ending, parts)
        parts.push_async_callback(lambda: service.tasks.close(ending.cause))
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
    settings: Settings, folder: HeldFolder, gate: Gate, supervision: Supervision, stack: AsyncExitStack
) -> tuple[Supervisor, Recorder, Service, list[APIRouter]]:
    """Put all parts together, each taken down again by ``stack``, in reverse."""

    def keep(
        part: Part, work: Callable[[], Coroutine[Any, Any, None]], on_death: Callable[[], None] | None = None
    ) -> None:
        stack.push_async_callback(supervision.keep_task(part, work, on_death).end)

    parameters = load_parameters(settings.params)
    database = open_database(settings.data, settings.database_url, settings.database_password())
    stack.callback(database.close)
    care = Care(database, settings.data)
    care.before_start()
    _close_interrupted(database)
    kept = KeptTuning(database)
    tuning, said = kept.restore(parameters)
    brought_up = brought_up_of(database, settings.plant_choice)
    setup = Setup(settings.plant_choice, settings.params, SEED, tuning.command(), brought_up)
    supervisor = Supervisor(setup, supervision)
    recorder = Recorder(database, supervisor.ring)
    supervisor.listen(recorder.hear)

    quota = Quota(settings.flight_records, settings.flight_records_MB * 1_000_000)
    flights = FlightRecorder(database, lambda: supervisor.ring, quota)
    supervisor.listen(flights.hear)
    stack.callback(flights.close)
    keep(FLIGHTS, flights.run)

    def problems() -> list[str]:
        parts = watch, care, recorder, flights, journal, supervisor.guard, retention, gate.sessions, bring_up
        return [*(part.problem for part in parts if part.problem), *supervision.problems, *tasks.problems]

    retention = Retention(database, Rule(round(settings.recordings_GB * 1e9), settings.recordings_keep_days))
    keep(RETENTION, retention.run)

    journal = Journal(database)
    stack.callback(journal.close)
    keep(JOURNAL, journal.run)
    if said:
        journal.note(MarkKind.TUNING, said, tick=0)
    picture = Picture(supervisor, parameters, tuning, problems)
    supervision.listen(lambda death: journal.note(MarkKind.FAULT, death, picture.tick))
    safe_stop = SafeStop(supervisor, picture, supervision)
    sessions = SessionRuns(database, settings.plant_choice.name, parameters)
    bench = Bench(supervisor, picture, sessions, journal, kept, recorder.follow, supervision)
    control = Control(bench.operator_lost, bench.note_control)
    control.let_go = bench.let_go
    picture.holder, picture.people = control.view, gate.people.view
    keep(GATE, gate.run)
    stack.push_async_callback(gate.sessions.save)
    keep(CONTROL, control.run, lambda: safe_stop.begin(Fault.OPERATOR_LOST))
    live = LiveStream(lambda: supervisor.ring, lambda: StateMessage(**dict(picture.state())))
    journal.on_mark(live.announce)
    bench.on_change(live.state_changed)
    keep(LIVE, live.run)
    watch = FolderWatch((folder.problem, care.displaced), bench.changed)
    keep(FOLDER, watch.run)
    care.start()

    history = History(database, parameters, lambda: _id_of_bank(picture.operators_tuning))
    processes = Processes(supervision)
    stack.callback(processes.close)
    downloads = Downloads(database, processes.reports)
    evaluations = Evaluations(database, processes.computing, lambda: picture.task)
    library = Library(database, lambda: picture.task, lambda run: evaluations.includes(run) or tasks.is_evaluating(run))
    shelf = Shelf(database, processes.computing, lambda: picture.tuning)
    station = Station(supervisor, database, settings.plant_choice.name, parameters, processes.computing.run)

    def prepare() -> None:
        """Load what evaluation and report need while the program still plays."""
        processes.computing.prepare(evaluate)
        downloads.prepare()

    tasks = Tasks(station, bench, shelf, prepare, SEED, DryRuns(processes.dry_runs), supervision, safe_stop)
    evaluations.done = tasks.evaluated

    replay = Replay(database)
    mirrors = {
        "/scene": SceneMirror(parameters, lambda: supervisor.ring.newest()),
        "/replay": SceneMirror(parameters, replay.row),
    }
    for mirror in mirrors.values():
        stack.callback(mirror.close)
        stack.callback(supervision.keep_thread(SCENE, mirror.run, mirror.end).end, 2.0)
    scenes = [scene_router(signed_in, mirror, path) for path, mirror in mirrors.items()]
    upkeep = Upkeep(database, settings.data, supervisor)
    bring_up = BringUp(bench, supervisor, database, parameters)
    stack.push_async_callback(bring_up.close)
    service = Service(
        bench,
        control,
        tasks,
        library,
        evaluations,
        shelf,
        Desk(database),
        history,
        replay,
        downloads,
        live,
        upkeep,
        retention,
        bring_up,
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


@contextmanager
def _listening(settings: Settings) -> Iterator[socket.socket]:
    family = socket.AF_INET6 if ":" in settings.host else socket.AF_INET
    try:
        listening = socket.create_server((settings.host, settings.port), family=family)
    except OSError as error:
        reason = error.strerror or error
        raise CannotListenError(
            f"cannot listen on {settings.host} port {settings.port}: {reason}; choose another --host or --port"
        ) from None
    with listening:
        yield listening
