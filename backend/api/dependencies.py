"""Dependencies of the routes: user, control lease, service, units; live websocket."""

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

from backend.api import messages
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

# Users ---------------------------------------------------------------------------------------------
# A route declares the user that it needs: a signed-in one, an operator, or one who may press STOP.


__all__ = [
    "BEARER",
    "OPEN",
    "Operator",
    "SignedInUser",
    "StopRequester",
    "User",
    "require_signed_in",
    "require_stop_permission",
]


def require_signed_in(connection: HTTPConnection) -> User:
    """Return the signed-in user. Raises RequestRejectedError for anyone else."""
    person = find_authentication(connection).authenticate(read_credentials(connection))
    if person is None:
        raise RequestRejectedError(ErrorCode.NOT_SIGNED_IN, messages.not_signed_in())
    return person


def require_stop_permission(connection: HTTPConnection) -> User:
    """Return the user who presses STOP, also if the session has expired.

    Raises RequestRejectedError.
    """
    person = find_authentication(connection).authenticate_for_stop(read_credentials(connection))
    if person is None:
        raise RequestRejectedError(ErrorCode.NOT_SIGNED_IN, messages.stop_without_session())
    return person


# Declared for the documentation only: the generated schema lists both ways of authentication.
_bearer = HTTPBearer(auto_error=False, description="token from the data folder")
_cookie = APIKeyCookie(
    name=f"{COOKIE}8000", auto_error=False, description="cookie of the sign-in; its name ends with the port"
)

# These are coroutines, because commands whose dependencies run in threads could change their order.


async def _get_signed_in_user(
    request: Request, _token: Annotated[object, Depends(_bearer)], _session: Annotated[object, Depends(_cookie)]
) -> User:
    return require_signed_in(request)


SignedInUser = Annotated[User, Depends(_get_signed_in_user)]


async def _get_stop_requester(
    request: Request, _token: Annotated[object, Depends(_bearer)], _session: Annotated[object, Depends(_cookie)]
) -> User:
    return require_stop_permission(request)


StopRequester = Annotated[User, Depends(_get_stop_requester)]


async def _get_operator(request: Request, person: SignedInUser) -> User:
    if person.role is not Role.OPERATOR:
        if request.method not in ("GET", "HEAD"):
            request.state.commanding = person, b""  # for the log; values of viewers are not logged
        message = messages.operator_needed(name=person.name, role=person.role)
        raise RequestRejectedError(ErrorCode.NOT_ALLOWED, message)
    return person


Operator = Annotated[User, Depends(_get_operator)]


# Live websocket ------------------------------------------------------------------------------------
# A client that does not read for SEND_TIMEOUT_S, or stops pinging, is disconnected.


SEND_TIMEOUT_S = 20.0
PING_TIMEOUT_S = 75.0
"""Time without a ping [s] after which a page counts as lost.

A page pings every second. Browsers let a hidden page send only once a minute.
"""

_log = logging.getLogger(__name__)


async def serve_live_stream(
    stream: LiveStream, websocket: WebSocket, on_ping: Callable[[Ping], None] = lambda _receive_ping: None
) -> None:
    """Serve one accepted websocket until either side ends it.

    ``on_ping`` is called with each ping.
    """
    with stream.connect() as (client, first):
        receiving = asyncio.create_task(_receive(websocket, client, on_ping))
        tasks = receiving, asyncio.create_task(_send(websocket, client, first))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            for ended in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(ended, Exception):
                    _log.error("A live stream to a page failed. The page reconnects.", exc_info=ended)
    if not receiving.cancelled() and receiving.exception() is None and receiving.result():
        await _close_with_reason(websocket)


async def _close_with_reason(websocket: WebSocket) -> None:
    """Close the websocket with a reason, after all other messages."""
    with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
        async with asyncio.timeout(SEND_TIMEOUT_S):
            await websocket.close(1008, messages.pings_missing())


async def _send(websocket: WebSocket, client: StreamClient, first: Iterable[str | bytes]) -> None:
    try:
        for message in first:
            await _send_one(websocket, message)
        while True:
            await _send_one(websocket, await client.next())
    except (TimeoutError, RuntimeError, WebSocketDisconnect):
        return


async def _send_one(websocket: WebSocket, message: str | bytes) -> None:
    async with asyncio.timeout(SEND_TIMEOUT_S):
        await (websocket.send_text(message) if isinstance(message, str) else websocket.send_bytes(message))


async def _receive(websocket: WebSocket, client: StreamClient, on_ping: Callable[[Ping], None]) -> bool:
    """Receive pings; return whether the client must be disconnected.

    False if the client has disconnected itself.
    """
    with suppress(RuntimeError, WebSocketDisconnect):
        timeout_s = None  # a client that never pings is a script; the server detects the end of its connection
        while (ping := await _receive_ping(websocket, timeout_s)) is not None:
            timeout_s = PING_TIMEOUT_S
            on_ping(ping)
            client.queue_text(Pong(id=ping.id).model_dump_json())
        return True
    return False


async def _receive_ping(websocket: WebSocket, timeout_s: float | None) -> Ping | None:
    """Return the next ping; None for any other message, and after the timeout."""
    try:
        async with asyncio.timeout(timeout_s):
            return Ping.model_validate_json(await websocket.receive_text())
    except (ValidationError, KeyError, TimeoutError):
        return None


# Service -------------------------------------------------------------------------------------------


RowId = Annotated[int, Path(ge=1, le=2**53, description="identifier in the database")]


@dataclass(frozen=True)
class Service:
    """Parts of the running service that the routes call."""

    actuator: ActuatorService
    state: ServiceState
    parameter_service: ParameterService
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

    def get_work_limiter(self, method: str, path: str) -> WorkLimiter | None:
        """Return the limiter that a costly request needs; None for other requests."""
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


def get_service(connection: HTTPConnection) -> Service:
    """Return the running service."""
    service: Service = connection.app.state.service
    return service


async def _get_current_service(request: Request) -> Service:
    return get_service(request)


CurrentService = Annotated[Service, Depends(_get_current_service)]


CommandTokenHeader = Annotated[
    str | None, Header(alias=CONTROL_HEADER, max_length=40, description="command token of the page in control")
]


async def _get_control_holder(
    request: Request, service: CurrentService, person: Operator, stamp: CommandTokenHeader = None
) -> AsyncIterator[User]:
    request.state.commanding = person, await request.body()  # for the log, if the command is rejected
    async with service.control.turn(person, parse_command_token(stamp)):
        yield person


ControlHolder = Annotated[User, Depends(_get_control_holder, scope="function")]
"""An operator who holds the control lease."""


async def _get_actuator_operator(service: CurrentService, person: ControlHolder) -> User:
    service.actuator.player.require_no_recording()
    return person


ActuatorOperator = Annotated[User, Depends(_get_actuator_operator, scope="function")]
"""An operator who holds the control lease, while a plant is controlled.

Rejected while a recording is replayed.
"""


# Units of angles -----------------------------------------------------------------------------------


PREFERENCE_TIMEOUT_S = 1.0
"""Longest time [s] that an error message waits for a preference from the database."""


async def load_angle_unit(connection: HTTPConnection) -> AngleUnit:
    """Return the user's preferred unit of angles.

    Degrees for users who are not signed in, and if the preference cannot be loaded.
    """
    person = find_authentication(connection).authenticate(read_credentials(connection))
    if person is None:
        return AngleUnit.DEGREES
    try:
        async with asyncio.timeout(PREFERENCE_TIMEOUT_S):
            preferences = await asyncio.to_thread(get_service(connection).preferences.load, person)
            return preferences.angles
    except (StorageError, TimeoutError):
        return AngleUnit.DEGREES


async def _get_angle_unit(
    request: Request,
    angles: Annotated[
        AngleUnit | None, Query(description="unit of printed angles; default: the preference of the user")
    ] = None,
) -> AngleUnit:
    return await load_angle_unit(request) if angles is None else angles


RequestedAngleUnit = Annotated[AngleUnit, Depends(_get_angle_unit)]
