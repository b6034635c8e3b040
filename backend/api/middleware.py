"""Authentication before a body is read, and the log of rejected commands."""

import asyncio
import json
import math
from contextlib import ExitStack

from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from backend.api import messages
from backend.api.dependencies import Service, get_service, require_signed_in
from backend.api.errors import build_response
from backend.auth import User
from backend.errors import RequestRejectedError
from backend.schemas import UNITS
from backend.server import (
    CONNECTION_LIMITER,
    CONNECTION_SLOT,
    LONGEST_WAIT_S,
    STOP_PATH,
    ConnectionLimiter,
    ConnectionSlot,
    WebsocketThrottle,
    body_limit,
    find_authentication,
    has_body,
    read_body,
    read_credentials,
    replay_body,
    require_valid_body,
)
from plant import ErrorCode, Quantity, escape_quantities

# Authentication ------------------------------------------------------------------------------------
# The user of a request is known before its body is read, within a time limit.


PUBLIC_PATHS = {"/api/session", "/api/health", "/api/page-address"}
"""Paths whose requests may have a body without a session."""

PROTECTED_PREFIXES = ("/api/", "/scene", "/replay")


class AuthenticationMiddleware:
    """ASGI middleware that rejects bodies and websockets of anonymous clients.

    Signed-in users get a connection slot; costly work also needs a slot in its limiter before its body is read. The
    middleware reads and checks the body: size, number of JSON parts, and characters that cannot be stored (lone
    surrogates, NUL).
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._validation_lock = asyncio.Lock()
        self._websocket_throttle = WebsocketThrottle()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Forward an accepted request, or send the error response."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        with ExitStack() as stack:
            try:
                person = _authenticate(connection)
                if scope["type"] == "websocket" and person is not None:
                    await self._throttle_websockets(person)
                _reserve_work(connection, person, stack)
                if has_body(connection):
                    body = await read_body(receive, body_limit(scope["path"]))
                    await self._validate_body(body, scope["path"])
                    receive = replay_body(body, receive)
            except RequestRejectedError as error:
                await build_response(error)(scope, receive, send)
            except ClientDisconnect:
                return
            else:
                await self._app(scope, receive, send)

    async def _throttle_websockets(self, person: User) -> None:
        """Wait until a session may open another websocket.

        Raises RequestRejectedError if that takes too long.
        """
        pause_s = self._websocket_throttle.wait_s(f"{person.role} {person.session}", asyncio.get_running_loop().time())
        if pause_s is None:
            message = messages.websockets_opened_too_fast()
            raise RequestRejectedError(ErrorCode.TOO_MANY, message, retry_after_s=math.ceil(LONGEST_WAIT_S))
        if pause_s > 0.0:
            await asyncio.sleep(pause_s)

    async def _validate_body(self, body: bytes, path: str) -> None:
        """Validate one body per iteration of the event loop.

        A dozen bodies in one iteration would delay STOP.
        """
        if path == STOP_PATH:
            require_valid_body(body)
            return
        async with self._validation_lock:
            try:
                require_valid_body(body)
            finally:
                await asyncio.sleep(0)


def _reserve_work(connection: HTTPConnection, person: User | None, stack: ExitStack) -> None:
    """Reserve a slot in the limiter of a costly work until ``stack`` ends.

    Raises RequestRejectedError, before the body is read.
    """
    scope = connection.scope
    if person is None or scope["type"] != "http":
        return
    service: Service | None = getattr(connection.app.state, "service", None)
    limiter = None if service is None else service.get_work_limiter(scope["method"], scope["path"])
    if limiter is not None:
        stack.enter_context(limiter.reserve(person))


def _authenticate(connection: HTTPConnection) -> User | None:
    """Assign the connection slot of a signed-in user and return the user.

    Raises RequestRejectedError for users who must sign in, and for too many websockets.
    """
    scope = connection.scope
    is_socket = scope["type"] == "websocket"
    if not is_socket and (scope["path"] in PUBLIC_PATHS or not scope["path"].startswith(PROTECTED_PREFIXES)):
        return None
    person = find_authentication(connection).authenticate(read_credentials(connection))
    if person is None:
        if is_socket or has_body(connection):
            require_signed_in(connection)  # raises, with the remedy
        return None  # a route may still accept an expired session for STOP
    state = scope.get("state", {})
    slot: ConnectionSlot | None = state.get(CONNECTION_SLOT)
    limiter: ConnectionLimiter | None = state.get(CONNECTION_LIMITER)
    if limiter is None or slot is None or limiter.authenticate(slot, person, is_socket=is_socket) or not is_socket:
        return person
    message = messages.too_many_connections(name=person.name)
    raise RequestRejectedError(ErrorCode.UNAVAILABLE, message, code="too_many_connections")


# Rejected commands ---------------------------------------------------------------------------------
# The event log lists rejected requests that need control, with their user and values.


_MAX_VALUES = 6
_MAX_VALUE_LENGTH = 40


def log_rejected_command(request: HTTPConnection, reason: str) -> None:
    """Add a rejected command of an operator to the event log.

    ``reason`` has angles in SI.
    """
    commanding = getattr(request.state, "commanding", None)
    if commanding is None:
        return
    person, body = commanding
    name = str(getattr(request.scope.get("route"), "name", "command")).replace("_", " ")
    values = describe_values(body)
    get_service(request).refusals.add(f"{name} ({values})" if values else name, reason, person.name)


def describe_values(body: bytes) -> str:
    """Return the values of a command with units: "q_ref 0.5 rad, S_ref 9 N·m/rad".

    Long texts and nested values are omitted.
    """
    try:
        document = json.loads(body) if body else None
    except (ValueError, RecursionError):
        return ""
    if not isinstance(document, dict):
        return ""
    descriptions = [_describe_value(name, value) for name, value in document.items()]
    return ", ".join([description for description in descriptions if description][:_MAX_VALUES])


def _describe_value(name: str, value: object) -> str:
    """Return a value with its name and unit; "" for nested values and long texts."""
    if not (name.isascii() and name.isidentifier() and len(name) <= _MAX_VALUE_LENGTH):
        return ""
    if isinstance(value, bool):
        return f"{name} {'yes' if value else 'no'}"
    if isinstance(value, int | float):
        return f"{name} {Quantity(value, UNITS.get(name, '1'))}"
    if isinstance(value, str) and value.isprintable() and 0 < len(value) <= _MAX_VALUE_LENGTH:
        return f"{name} {escape_quantities(value)}"
    return ""
