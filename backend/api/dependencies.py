"""What routes depend on: the service, the person who asks, the units; and the live websocket."""

import asyncio
import logging
from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from typing import Annotated

from fastapi import Depends, Header, Path, Query, Request, WebSocket, WebSocketDisconnect
from fastapi.security import APIKeyCookie, HTTPBearer
from pydantic import ValidationError
from starlette.requests import HTTPConnection

from backend.auth import BEARER, CONTROL_HEADER, OPEN, ControlHandover, ControlLease, User, parse_command_token
from backend.errors import RequestRejectedError
from backend.schemas import Ping, Pong, Role
from backend.server import COOKIE, SHEETS, find_authentication, read_credentials
from backend.services import (
    ActuatorService,
    ChartSheets,
    CommissioningService,
    Downloads,
    DryRuns,
    Evaluations,
    Formulas,
    JobManager,
    LiveStream,
    Maintenance,
    OwnExperiments,
    ParameterService,
    RangeAnalysis,
    RejectionLog,
    ReplayView,
    Retention,
    RunHistory,
    RunLibrary,
    SavedTunings,
    ServiceState,
    StoredBanks,
    StoredIdentifications,
    StoredPreferences,
    StoredRuns,
    StoredTimeline,
    StreamClient,
    StudyScheduler,
    TextWork,
    Triggers,
    WorkLimiter,
)
from backend.storage import Database, StorageError
from backend.units import AngleUnit
from plant import ErrorCode

# Auth ----------------------------------------------------------------------------------------------
#
# Who is asking, as routes say what they need: anybody signed in, an operator, somebody who presses
# STOP.


__all__ = ["BEARER", "OPEN", "MayStop", "Operator", "SignedIn", "User", "may_stop", "require_signed_in"]

_SIGN_IN = "sign in again with the link that the service printed at its start, or with a token of the data folder"


def require_signed_in(connection: HTTPConnection) -> User:
    """Return the signed-in person. Raises RequestRejectedError for anybody else."""
    person = find_authentication(connection).authenticate(read_credentials(connection))
    if person is None:
        raise RequestRejectedError(ErrorCode.NOT_SIGNED_IN, f"not signed in: {_SIGN_IN}")
    return person


def may_stop(connection: HTTPConnection) -> User:
    """Return who presses STOP: also somebody whose session is not live any more. Raises RequestRejectedError."""
    person = find_authentication(connection).authenticate_for_stop(read_credentials(connection))
    if person is None:
        raise RequestRejectedError(ErrorCode.NOT_SIGNED_IN, f"not signed in, nothing was stopped: {_SIGN_IN}")
    return person


# Declared for the documentation only: the generated schema names both ways of proving who asks.
_bearer = HTTPBearer(auto_error=False, description="token from the data folder")
_cookie = APIKeyCookie(
    name=f"{COOKIE}8000", auto_error=False, description="from signing in; its name ends with the port of the address"
)

# All of these are coroutines: commands whose dependencies run in threads would overtake one another there.


async def _signed_in(
    request: Request, _token: Annotated[object, Depends(_bearer)], _session: Annotated[object, Depends(_cookie)]
) -> User:
    return require_signed_in(request)


SignedIn = Annotated[User, Depends(_signed_in)]


async def _may_stop(
    request: Request, _token: Annotated[object, Depends(_bearer)], _session: Annotated[object, Depends(_cookie)]
) -> User:
    return may_stop(request)


MayStop = Annotated[User, Depends(_may_stop)]


async def _operator(request: Request, person: SignedIn) -> User:
    if person.role is not Role.OPERATOR:
        if request.method not in ("GET", "HEAD"):
            request.state.commanding = person, b""  # the log tells who asked for what; a viewer's values are not read
        raise RequestRejectedError(
            ErrorCode.NOT_ALLOWED, f"{person.name} is signed in as {person.role}; this needs the operator's token"
        )
    return person


Operator = Annotated[User, Depends(_operator)]


# Live ----------------------------------------------------------------------------------------------
#
# The websocket /api/live: sends what the live stream has; who reads nothing or says nothing for
# long is dropped.


LIVE_PATIENCE_S = 20.0
SILENT_S = 75.0
"""A page, which pings every second, is gone when it has said nothing for so long: its laptop was closed, say.

One that is hidden for minutes is let speak by its browser once a minute only, and is there all the same.
"""

_log = logging.getLogger(__name__)


async def serve(stream: LiveStream, websocket: WebSocket, heard: Callable[[Ping], None] = lambda _ping: None) -> None:
    """Serve one accepted websocket until either side ends it; ``heard`` gets each ping."""
    with stream.connect() as (client, first):
        receiving = asyncio.create_task(_receive(websocket, client, heard))
        tasks = receiving, asyncio.create_task(_send(websocket, client, first))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            for ended in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(ended, Exception):
                    _log.error("A live stream to a page failed. The page connects again.", exc_info=ended)
    if not receiving.cancelled() and receiving.exception() is None and receiving.result():
        await _send_away(websocket)


async def _send_away(websocket: WebSocket) -> None:
    """Close with the reason; when nothing else is sent any more, which would find the connection half closed."""
    with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
        async with asyncio.timeout(LIVE_PATIENCE_S):
            await websocket.close(1008, "only pings are understood here, and they have to come")


async def _send(websocket: WebSocket, client: StreamClient, first: Iterable[str | bytes]) -> None:
    try:
        for message in first:
            await _send_one(websocket, message)
        while True:
            await _send_one(websocket, await client.next())
    except (TimeoutError, RuntimeError, WebSocketDisconnect):
        return


async def _send_one(websocket: WebSocket, message: str | bytes) -> None:
    async with asyncio.timeout(LIVE_PATIENCE_S):
        await (websocket.send_text(message) if isinstance(message, str) else websocket.send_bytes(message))


async def _receive(websocket: WebSocket, client: StreamClient, heard: Callable[[Ping], None]) -> bool:
    """Hear pings, and return whether the page is to be sent away; it may also have left by itself."""
    with suppress(RuntimeError, WebSocketDisconnect):
        patience_s = None  # who never pings is a script, of which the server itself sees whether it is there
        while (ping := await _ping(websocket, patience_s)) is not None:
            patience_s = SILENT_S
            heard(ping)
            client.queue_text(Pong(id=ping.id).model_dump_json())
        return True
    return False


async def _ping(websocket: WebSocket, patience_s: float | None) -> Ping | None:
    """Return the next ping; None for anything else, and for nothing in all that time."""
    try:
        async with asyncio.timeout(patience_s):
            return Ping.model_validate_json(await websocket.receive_text())
    except (ValidationError, KeyError, TimeoutError):
        return None


# Service -------------------------------------------------------------------------------------------
#
# The parts of a running service that routes call.


RowId = Annotated[int, Path(ge=1, le=2**53, description="identifier in the database")]


@dataclass(frozen=True)
class Service:
    """What the routes act on."""

    actuator: ActuatorService
    state: ServiceState
    applied: ParameterService
    control: ControlLease
    hand_over: ControlHandover
    ordered_runs: JobManager
    experiments: OwnExperiments
    saved_tunings: SavedTunings
    bring_up: CommissioningService
    live: LiveStream
    refusals: RejectionLog
    runs: StoredRuns
    figures: RangeAnalysis
    run_library: RunLibrary
    identifications: StoredIdentifications
    evaluations: Evaluations
    banks: StoredBanks
    preferences: StoredPreferences
    history: RunHistory
    timeline: StoredTimeline
    replay: ReplayView
    texts: TextWork
    sheets: ChartSheets
    dry_runs: DryRuns
    database: Database
    downloads: Downloads
    maintenance: Maintenance
    retention: Retention
    studies: StudyScheduler
    triggers: Triggers
    formulas: Formulas

    def places_for(self, method: str, path: str) -> WorkLimiter | None:
        """Return where a request takes its place before its body is read; None for one that needs none."""
        if method != "POST":
            return None
        return {
            SHEETS: self.sheets.limiter,
            "/api/experiments/check": self.texts.limiter,
            "/api/experiments/own": self.texts.limiter,
            "/api/studies/check": self.texts.limiter,
            "/api/spring-tables": self.texts.limiter,
            "/api/identifications/prediction": self.texts.preview_limiter,
            "/api/experiments/dry-run": self.dry_runs.limiter,
        }.get(path)


def service_of(connection: HTTPConnection) -> Service:
    """Return the running service."""
    service: Service = connection.app.state.service
    return service


async def _service_in_use(request: Request) -> Service:
    return service_of(request)


ServiceInUse = Annotated[Service, Depends(_service_in_use)]


Stamped = Annotated[
    str | None, Header(alias=CONTROL_HEADER, max_length=40, description="page.sequence of the page that holds control")
]


async def _holds_control(
    request: Request, service: ServiceInUse, person: Operator, stamp: Stamped = None
) -> AsyncIterator[User]:
    request.state.commanding = person, await request.body()  # the log tells who asked for what, if it is refused
    async with service.control.turn(person, parse_command_token(stamp)):
        yield person


HoldsControl = Annotated[User, Depends(_holds_control, scope="function")]
"""An operator who holds control, of whatever is driven or played."""


async def _in_control(service: ServiceInUse, person: HoldsControl) -> User:
    service.actuator.player.require_no_recording()
    return person


InControl = Annotated[User, Depends(_in_control, scope="function")]
"""An operator who holds control: only their commands move the actuator. Refused while a recording is played."""


# Angles --------------------------------------------------------------------------------------------
#
# In which unit somebody who asks for something reads angles.


ANGLES_PATIENCE_S = 1.0
"""No refusal waits longer for a preference: a database that does not answer must not keep anybody from reading it."""


async def angles_of(connection: HTTPConnection) -> AngleUnit:
    """Return what the signed-in person prefers; degrees for who is not signed in, or is not known just now."""
    person = find_authentication(connection).authenticate(read_credentials(connection))
    if person is None:
        return AngleUnit.DEGREES
    try:
        async with asyncio.timeout(ANGLES_PATIENCE_S):
            preferences = await asyncio.to_thread(service_of(connection).preferences.load, person)
            return preferences.angles
    except (StorageError, TimeoutError):
        return AngleUnit.DEGREES


async def _angles_read(
    request: Request,
    angles: Annotated[
        AngleUnit | None, Query(description="unit in which angles are printed; what the person prefers if left out")
    ] = None,
) -> AngleUnit:
    return await angles_of(request) if angles is None else angles


AnglesRead = Annotated[AngleUnit, Depends(_angles_read)]
