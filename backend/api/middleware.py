"""Admission of requests before their body is read, and refused commands in the log."""

import asyncio
import json
import math
from contextlib import ExitStack

from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.types import ASGIApp, Receive, Scope, Send

from backend.api.dependencies import Service, require_signed_in, service_of
from backend.api.errors import answer_to
from backend.auth import User
from backend.errors import RequestRejectedError
from backend.schemas import UNITS
from backend.server import (
    ALL_PLACES,
    LONGEST_WAIT_S,
    PASSES_BY,
    PLACE,
    Arrivals,
    ConnectionLimiter,
    ConnectionSlot,
    body_limit,
    find_authentication,
    has_body,
    read_body,
    read_credentials,
    replay_body,
    require_valid_body,
)
from backend.units import format_number
from plant import ErrorCode

# Admission -----------------------------------------------------------------------------------------
#
# Who sends a request is known before anything of its body is taken; then the body is read, whole
# and in time.


OPEN = {"/api/session", "/api/health", "/api/page-address"}
"""What may be asked, and sent a body, by somebody who is not signed in."""

CLOSED = ("/api/", "/scene", "/replay")


class AuthenticationMiddleware:
    """ASGI middleware before the routes: nobody who is not signed in has a body or a websocket taken.

    Whoever is signed in gets a place; costly work has to find one of its own before its body is read. A body is read
    here: refused are more than ``body_limit`` whatever its head said, JSON of too many parts, and JSON that holds what
    cannot be written down again, half a character or the one of code 0.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._looking = asyncio.Lock()
        self._arrivals = Arrivals()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what may come in, answer the rest."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        with ExitStack() as stack:
            try:
                person = _show_in(connection)
                if scope["type"] == "websocket" and person is not None:
                    await self._wait_for_turn(person)
                _take_place(connection, person, stack)
                if has_body(connection):
                    body = await read_body(receive, body_limit(scope["path"]))
                    await self._look_over(body, scope["path"])
                    receive = replay_body(body, receive)
            except RequestRejectedError as error:
                await answer_to(error)(scope, receive, send)
            except ClientDisconnect:
                return
            else:
                await self._app(scope, receive, send)

    async def _wait_for_turn(self, person: User) -> None:
        """Wait until a session may open one more websocket. Raises RequestRejectedError where that takes too long."""
        pause_s = self._arrivals.wait_s(f"{person.role} {person.session}", asyncio.get_running_loop().time())
        if pause_s is None:
            message = "too many websockets were opened by this session: it may open a few in a second"
            raise RequestRejectedError(ErrorCode.TOO_MANY, message, retry_after_s=math.ceil(LONGEST_WAIT_S))
        if pause_s > 0.0:
            await asyncio.sleep(pause_s)

    async def _look_over(self, body: bytes, path: str) -> None:
        """Look over one body in each round of the event loop: a dozen of them would make STOP wait for all."""
        if path == PASSES_BY:
            require_valid_body(body)
            return
        async with self._looking:
            try:
                require_valid_body(body)
            finally:
                await asyncio.sleep(0)


def _take_place(connection: HTTPConnection, person: User | None, stack: ExitStack) -> None:
    """Take the place of a costly work until ``stack`` ends.

    Raises RequestRejectedError, before any of the body is read.
    """
    scope = connection.scope
    if person is None or scope["type"] != "http":
        return
    service: Service | None = getattr(connection.app.state, "service", None)
    places = None if service is None else service.places_for(scope["method"], scope["path"])
    if places is not None:
        stack.enter_context(places.reserve(person))


def _show_in(connection: HTTPConnection) -> User | None:
    """Give who is signed in a place, and return them.

    Raises RequestRejectedError for who has to be signed in, and for one websocket too many.
    """
    scope = connection.scope
    is_socket = scope["type"] == "websocket"
    if not is_socket and (scope["path"] in OPEN or not scope["path"].startswith(CLOSED)):
        return None
    person = find_authentication(connection).authenticate(read_credentials(connection))
    if person is None:
        if is_socket or has_body(connection):
            require_signed_in(connection)  # says what is to be done
        return None  # a route may still let in somebody whose session is over, to press STOP
    state = scope.get("state", {})
    place: ConnectionSlot | None = state.get(PLACE)
    places: ConnectionLimiter | None = state.get(ALL_PLACES)
    if places is None or place is None or places.authenticate(place, person, is_socket=is_socket) or not is_socket:
        return person
    raise RequestRejectedError(
        ErrorCode.UNAVAILABLE,
        f"{person.name} has too many connections open: close other pages first",
        code="too_many_connections",
    )


# Refused commands ----------------------------------------------------------------------------------
#
# Refused commands go into the log: those of requests that need control, with whoever made them and
# what for.


_MOST_VALUES = 6
_LONGEST_VALUE = 40


def tell_refused(request: HTTPConnection, reason: str) -> None:
    """Keep a refusal where the request was a command of an operator; ``reason`` has angles in SI."""
    commanding = getattr(request.state, "commanding", None)
    if commanding is None:
        return
    person, body = commanding
    name = str(getattr(request.scope.get("route"), "name", "command")).replace("_", " ")
    values = values_in(body)
    service_of(request).refusals.add(f"{name} ({values})" if values else name, reason, person.name)


def values_in(body: bytes) -> str:
    """Return the values of a command in words, with units: "q_ref 0.5 rad, S_ref 9 N·m/rad"; of a long text nothing."""
    try:
        asked = json.loads(body) if body else None
    except (ValueError, RecursionError):
        return ""
    if not isinstance(asked, dict):
        return ""
    told = [_told(name, value) for name, value in asked.items()]
    return ", ".join([one for one in told if one][:_MOST_VALUES])


def _told(name: str, value: object) -> str:
    """Return a value with its name and unit, "" for one that is none: nested, nothing, or a text."""
    if not (name.isascii() and name.isidentifier() and len(name) <= _LONGEST_VALUE):
        return ""
    if isinstance(value, bool):
        return f"{name} {'yes' if value else 'no'}"
    if isinstance(value, int | float):
        unit = UNITS.get(name, "1")
        return f"{name} {format_number(value)}" + ("" if unit == "1" else f" {unit}")
    if isinstance(value, str) and value.isprintable() and 0 < len(value) <= _LONGEST_VALUE:
        return f"{name} {value}"
    return ""
