"""The service: starts the loop process, puts its parts together, runs them and ends them.

Modules that take long to import are imported where they are used: the loop process loads in parallel.
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


_log = logging.getLogger(__name__)

NICENESS = -10
SWITCH_S = 0.5e-3
"""Each thread that answers somebody may keep Python's lock from the event loop, and so from STOP, for so long [s]."""

LIBRARIES = Part("The loading of libraries", "The first preview or forecast takes some seconds longer.")


def serve(settings: Settings, ready: Callable[[str, Tokens | None], None]) -> None:
    """Run the service until it is told to end. ``ready`` gets the address and the tokens once it answers.

    Raises AlreadyRunningError, DataFolderError, CannotListenError, and what keeps a part from starting.
    """
    os.umask(UMASK)
    logs.configure_logging(settings.log_level)
    raise_limit()
    forbid_forks()
    with lock_for_service(settings.data) as folder, listening_socket(settings.host, settings.port) as listening:
        make_private(settings.data)
        _ask_for_priority()
        sys.setswitchinterval(SWITCH_S)
        with _garbage_kept():
            asyncio.run(_serve(settings, folder, listening, ready))


async def _serve(
    settings: Settings, folder: LockedFolder, listening: socket.socket, ready: Callable[[str, Tokens | None], None]
) -> None:
    parts, ending = AsyncExitStack(), Ending()

    @asynccontextmanager
    async def lifespan(_app: "FastAPI") -> AsyncIterator[None]:
        async with parts:
            yield

    try:
        files = TokenFiles(settings.data) if settings.require_token else None
        launched = await launch_loop(settings.params)
        parts.push_async_callback(launched.discard)
        supervision = Supervision()
        parts.push_async_callback(supervision.close)

        from backend.app import bootstrap

        foundation = bootstrap(settings, launched, supervision, parts)
        starting = asyncio.create_task(foundation.supervisor.start(), name="start of the loop")
        parts.push_async_callback(_abandon, starting, foundation.supervisor)
        await asyncio.sleep(0)  # the loop process is told what to drive, and rehearses while the rest is put together
        from backend.api import create_app
        from backend.app import build_services
        from backend.auth import Authentication, Sessions
        from backend.event_bus import EventBus
        from backend.server import Server, prepare_routes
        from backend.storage import EventKind

        events = EventBus()
        authentication = Authentication(files, Sessions(settings.data), events=events)
        # All who listen to the loop are there before the event loop gets to hear from it.
        assembled = build_services(
            settings=settings,
            foundation=foundation,
            folder=folder,
            authentication=authentication,
            supervision=supervision,
            events=events,
            stack=parts,
        )
        # The service's own commands ask at the address that it listens on.
        app = create_app(lifespan, assembled.scenes, (*settings.allowed_hosts, settings.host), settings.public)
        app.state.service, app.state.authentication = assembled.service, authentication
        await prepare_routes(app)
        _leave_what_was_made()
        parts.callback(lambda: assembled.event_log.add_entry(EventKind.NOTE, ending.cause))
        await _join_loop(
            starting=starting,
            supervisor=foundation.supervisor,
            recorder=assembled.recorder,
            ending=ending,
            supervision=supervision,
            stack=parts,
        )
        parts.push_async_callback(lambda: assembled.service.ordered_runs.close(ending.cause))
    except BaseException:
        await parts.aclose()
        raise
    address = browser_address(settings.host, listening.getsockname()[1])

    def load_the_rest() -> None:
        workers.import_modules(*workers.NUMERIC_LIBRARIES)
        foundation.figures.save()

    def announce() -> None:
        _log.info("The service started: plant %s, data folder %s, address %s", settings.plant, settings.data, address)
        folder.write_address(address, settings.public_url)
        assembled.draw()
        ready(address, files.tokens if files else None)
        supervision.start_thread(LIBRARIES, load_the_rest, lambda: None)

    try:
        await Server(app, announce, ending).serve([listening])
    finally:
        _log.info("The service stopped: %s", ending.cause)


@contextmanager
def _garbage_kept() -> Iterator[None]:
    """Look for no garbage while nearly all that is made stays; whoever has started says so by ``gc.enable``."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


def _leave_what_was_made() -> None:
    """Leave what the start has made to the end of the process: to look through it takes a third of a second."""
    gc.freeze()
    gc.enable()


async def _join_loop(
    starting: "asyncio.Task[RealTimeStatus]",
    supervisor: "Supervisor",
    recorder: "Recorder",
    ending: Ending,
    supervision: Supervision,
    stack: AsyncExitStack,
) -> None:
    """Wait until the loop ticks and record it; both end before the other parts do."""
    from backend.recording import RECORDER_PART as RECORDER

    await starting
    recorder.follow(supervisor.ring)
    stack.push_async_callback(asyncio.to_thread, recorder.close)
    stack.callback(supervision.start_thread(RECORDER, recorder.run_recording, recorder.end).end)
    stack.push_async_callback(lambda: supervisor.stop(ending.cause))


async def _abandon(starting: "asyncio.Task[RealTimeStatus]", supervisor: "Supervisor") -> None:
    """End a loop process that nobody got to use."""
    if not starting.done():
        starting.cancel()
        await asyncio.wait((starting,))
    if starting.cancelled() or starting.exception() is not None or supervisor.is_alive:
        await supervisor.stop("the service could not start")


def _ask_for_priority() -> None:
    """Come before ordinary programs where the machine grants it: the loop stops where it hears nothing."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
