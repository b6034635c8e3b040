"""The service process: starts the control loop, builds the service and runs it.

Modules that take long to import are imported where they are used, while the loop process starts in parallel.
"""

import asyncio
import gc
import logging
import os
import socket
import sys
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import AsyncExitStack, asynccontextmanager, contextmanager, suppress
from typing import TYPE_CHECKING

from backend import logs, workers
from backend.auth import TokenFiles, Tokens
from backend.data_folder import UMASK, LockedFolder, lock_for_service, make_private
from backend.realtime import launch_loop
from backend.server import Ending, browser_address, listening_socket, raise_limit
from backend.settings import Settings
from backend.supervision import Part, Supervision
from backend.workers import forbid_forks

if TYPE_CHECKING:
    from fastapi import FastAPI

    from backend.realtime import RealTimeStatus, Supervisor
    from backend.recording import Recorder
    from backend.storage import Database, HeldClaim


_log = logging.getLogger(__name__)

NICENESS = -10
SWITCH_INTERVAL_S = 0.5e-3
"""Longest time [s] a thread holds the interpreter lock, and so delays STOP."""

CLAIM_PART = Part("The renewal of the database claim", "Another service may claim the database.")
LIBRARIES_PART = Part("The library loader", "The first preview or forecast takes a few seconds longer.")


def serve(settings: Settings, on_ready: Callable[[str, Tokens | None], None]) -> None:
    """Run the service until a signal ends it.

    ``on_ready`` is called with address and tokens once the service answers. Raises AlreadyRunningError,
    DataFolderError, CannotListenError, and the errors of parts that cannot start.
    """
    os.umask(UMASK)
    logs.configure_logging(settings.log_level)
    raise_limit()
    forbid_forks()
    with lock_for_service(settings.data) as folder, listening_socket(settings.host, settings.port) as listening:
        make_private(settings.data)
        _raise_priority()
        sys.setswitchinterval(SWITCH_INTERVAL_S)
        with _defer_garbage_collection():
            asyncio.run(_serve(settings, folder, listening, on_ready))


async def _serve(
    settings: Settings, folder: LockedFolder, listening: socket.socket, on_ready: Callable[[str, Tokens | None], None]
) -> None:
    stack, ending = AsyncExitStack(), Ending()

    @asynccontextmanager
    async def lifespan(_app: "FastAPI") -> AsyncIterator[None]:
        async with stack:
            yield

    try:
        files = TokenFiles(settings.data) if settings.require_token else None
        launched = await launch_loop(settings.params)
        stack.push_async_callback(launched.discard)
        supervision = Supervision()
        stack.push_async_callback(supervision.close)

        from plant import load_parameters, require_tendons

        file_parameters = load_parameters(settings.params)
        require_tendons(file_parameters)
        # A claimed database is refused before the rest of the service is imported.
        database, claim = _claim_database(settings, supervision, stack)
        from backend.app import bootstrap

        boot = bootstrap(
            settings=settings,
            file_parameters=file_parameters,
            database=database,
            claim=claim,
            launched=launched,
            supervision=supervision,
            stack=stack,
        )
        starting = asyncio.create_task(boot.supervisor.start(), name="start of the loop")
        stack.push_async_callback(_stop_unused_loop, starting, boot.supervisor)
        await asyncio.sleep(0)  # sends the setup to the loop process, which rehearses while the service is built
        from backend.api import create_app
        from backend.app import build_services
        from backend.auth import Authentication, Sessions
        from backend.event_bus import EventBus
        from backend.server import Server, prepare_routes
        from backend.storage import EventKind

        events = EventBus()
        authentication = Authentication(files, Sessions(settings.data), events=events)
        # All listeners are registered before the event loop receives anything from the control loop.
        services = build_services(
            settings=settings,
            boot=boot,
            folder=folder,
            authentication=authentication,
            supervision=supervision,
            events=events,
            stack=stack,
        )
        # The service's own commands send requests to the address that it listens on.
        app = create_app(lifespan, services.scene_routers, (*settings.allowed_hosts, settings.host), settings.public)
        app.state.service, app.state.authentication = services.service, authentication
        await prepare_routes(app)
        _freeze_startup_objects()
        stack.callback(lambda: services.event_log.add_entry(EventKind.NOTE, ending.cause))
        await _wait_for_loop(
            starting=starting,
            supervisor=boot.supervisor,
            recorder=services.recorder,
            ending=ending,
            supervision=supervision,
            stack=stack,
        )
        stack.push_async_callback(lambda: services.service.ordered_runs.close(ending.cause))
    except BaseException:
        await stack.aclose()
        raise
    address = browser_address(settings.host, listening.getsockname()[1])

    def load_libraries() -> None:
        workers.import_modules(*workers.NUMERIC_LIBRARIES)
        boot.robustness_cache.save()

    def announce() -> None:
        _log.info("The service started: plant %s, data folder %s, address %s", settings.plant, settings.data, address)
        folder.write_address(address, settings.public_url)
        services.start_views()
        on_ready(address, files.tokens if files else None)
        supervision.start_thread(LIBRARIES_PART, load_libraries, lambda: None)

    try:
        await Server(app, announce, ending).serve([listening])
    finally:
        _log.info("The service stopped: %s", ending.cause)


def _claim_database(
    settings: Settings, supervision: Supervision, stack: AsyncExitStack
) -> "tuple[Database, HeldClaim]":
    """Open the database and claim it for this service.

    ``stack`` closes and releases it. Raises StorageError, StationTakenError and SchemaError.
    """
    from backend.storage import HeldClaim, HeldStation, find_database_file, open_database, recover_database

    file = find_database_file(settings.data, settings.database_url)
    for message in [] if file is None else recover_database(file):
        _log.warning("%s", message)
    database = open_database(settings.data, settings.database_url, settings.database_password(), settings.station)
    stack.callback(database.close)
    stack.callback(HeldStation(database.engine, settings.station).release)
    claim = HeldClaim(database.engine, settings.station)
    stack.callback(claim.release)
    supervision.start_thread(CLAIM_PART, claim.run, claim.end)
    return database, claim


@contextmanager
def _defer_garbage_collection() -> Iterator[None]:
    """Disable garbage collection during the start, which creates little garbage.

    ``_freeze_startup_objects`` enables it again.
    """
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _freeze_startup_objects() -> None:
    """Exclude the objects of the start from garbage collection, and enable it.

    Scanning them would take a third of a second.
    """
    gc.freeze()
    gc.enable()


async def _wait_for_loop(
    starting: "asyncio.Task[RealTimeStatus]",
    supervisor: "Supervisor",
    recorder: "Recorder",
    ending: Ending,
    supervision: Supervision,
    stack: AsyncExitStack,
) -> None:
    """Wait for the control loop's start and record it.

    Recorder and control loop end before the other parts.
    """
    from backend.recording import RECORDER_PART as RECORDER

    await starting
    recorder.follow(supervisor.ring)
    stack.push_async_callback(asyncio.to_thread, recorder.close)
    stack.callback(supervision.start_thread(RECORDER, recorder.run_recording, recorder.end).end)
    stack.push_async_callback(lambda: supervisor.stop(ending.cause))


async def _stop_unused_loop(starting: "asyncio.Task[RealTimeStatus]", supervisor: "Supervisor") -> None:
    """End a loop process whose service could not start."""
    if not starting.done():
        starting.cancel()
        await asyncio.wait((starting,))
    if starting.cancelled() or starting.exception() is not None or supervisor.is_alive:
        await supervisor.stop("the service could not start")


def _raise_priority() -> None:
    """Raise the priority of this process, if permitted.

    The control loop stops when the service sends no heartbeat in time.
    """
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
