"""Foxglove bridge: relays the live stream of a service to Foxglove's server.

Clients need a token.
"""

import asyncio
import json
import logging
import secrets
import struct
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Sequence
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from http import HTTPStatus
from typing import Any, cast
from urllib.parse import parse_qs, urlsplit

import foxglove
import numpy as np
from foxglove import messages as foxglove_messages
from foxglove.websocket import StatusLevel
from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from backend import wire
from backend.exports import ORDER, TOPIC, describe_columns, writers
from backend.foxglove import messages
from backend.sample import STORED_NAMES
from backend.schemas import EventMessage, LayoutMessage, MarkKind, StateMessage
from backend.units import AngleUnit, format_text
from plant import ErrorCode, Message, SinewError, T_s

# Message substitutes -------------------------------------------------------------------------------
# Substitutes for messages: the vendor's server is given numbers that only this process can replace by the messages.
#
# That server listens on a port without authentication; an unauthorized client of it receives numbers only.


_TICKET = struct.Struct("<Q")
_HEAD = struct.Struct("<BIQ")
"""Header of a message frame: opcode, subscription, time [ns]."""

MESSAGE = 1
"""First byte of a frame with a message (Foxglove WebSocket protocol, Message Data)."""

SLOT_COUNT = 8192
"""Number of stored messages: more than any queue on the way holds."""


class MessageSlots:
    """Buffer of the newest messages by number."""

    def __init__(self, count: int = SLOT_COUNT) -> None:
        self._slots: list[tuple[int, bytes]] = [(-1, b"")] * count
        self._next = 0

    def ticket_for(self, message: bytes) -> bytes:
        """Store a message; return its substitute."""
        number, self._next = self._next, self._next + 1
        self._slots[number % len(self._slots)] = (number, message)
        return _TICKET.pack(number)

    def redeem(self, frame: bytes) -> bytes | None:
        """Return a frame of the vendor's server with its message inserted.

        None if the message was overwritten.
        """
        if frame[:1] != bytes([MESSAGE]):
            return frame
        if len(frame) != _HEAD.size + _TICKET.size:
            return None
        (number,) = _TICKET.unpack_from(frame, _HEAD.size)
        stored, message = self._slots[number % len(self._slots)]
        return frame[: _HEAD.size] + message if stored == number else None


# Client port ---------------------------------------------------------------------------------------
# Port for Foxglove clients: checks the token in the address, and accepts only subscriptions.
#
# ``ws://127.0.0.1:8765/?token=KEY``: viewers only accept an address, without headers.


VENDORS = Subprotocol("foxglove.sdk.v1")
SPOKEN = (VENDORS, Subprotocol("foxglove.websocket.v1"))
"""Names of the protocol; the second is the older one, which the vendor's server does not accept."""

HOST = "127.0.0.1"
FORWARDED_OPERATIONS = ("subscribe", "unsubscribe")
MOST_CLIENTS = 8
MOST_BYTES = 64 * 1024
POLICY_VIOLATION, FAILED = 1008, 1011
FAREWELL_S = 1.0


class Gateway:
    """Relays between authorized clients and the vendor's server on ``port``.

    Without a key no client is authorized.
    """

    def __init__(self, port: int, tickets: MessageSlots) -> None:
        self._port, self._tickets = port, tickets
        self._key: str | None = None
        self._clients: set[ServerConnection] = set()

    @asynccontextmanager
    async def open(self, port: int) -> AsyncIterator[int]:
        """Listen on a port of this machine for the block; yield its number.

        ``port`` 0 selects a free one. Raises OSError.
        """
        async with serve(
            self._relay,
            HOST,
            port,
            process_request=self._check_request,
            select_subprotocol=_select_subprotocol,
            compression=None,
            max_size=MOST_BYTES,
            server_header=None,
        ) as server:
            yield _get_port(server)

    async def accept_key(self, key: str) -> None:
        """Accept ``key`` from now on; clients with the previous key are disconnected."""
        if key != self._key:
            self._key = key
            why = messages.token_replaced()
            await asyncio.gather(*(_disconnect(client, POLICY_VIOLATION, why) for client in tuple(self._clients)))

    def _check_request(self, connection: ServerConnection, request: Request) -> Response | None:
        refused = self._find_rejection(request)
        return connection.respond(refused[0], f"{refused[1]}\n") if refused else None

    def _find_rejection(self, request: Request) -> tuple[HTTPStatus, Message] | None:
        token = parse_qs(urlsplit(request.path).query, errors="replace").get("token", [""])[-1]
        if self._key is None or not secrets.compare_digest(token.encode(errors="replace"), self._key.encode()):
            return HTTPStatus.UNAUTHORIZED, messages.token_missing()
        if len(self._clients) >= MOST_CLIENTS:
            return HTTPStatus.SERVICE_UNAVAILABLE, messages.too_many_clients(maximum=MOST_CLIENTS)
        return None

    async def _relay(self, client: ServerConnection) -> None:
        assert client.request is not None  # checked before
        if refused := self._find_rejection(client.request):  # meanwhile, by a new key or other clients
            await _disconnect(client, POLICY_VIOLATION, refused[1])
            return
        self._clients.add(client)
        try:
            async with connect(
                f"ws://{HOST}:{self._port}", subprotocols=[VENDORS], compression=None, max_size=None, proxy=None
            ) as server:
                await _run_until_first(self._show(server, client), _forward_requests(client, server))
        except (OSError, InvalidHandshake):
            await _disconnect(client, FAILED, messages.vendor_server_ended())
        finally:
            self._clients.discard(client)

    async def _show(self, server: ClientConnection, client: ServerConnection) -> None:
        async for message in server:
            if isinstance(message, str):
                await client.send(message)
            elif (frame := self._tickets.redeem(message)) is not None:
                await client.send(frame)


async def _forward_requests(client: ServerConnection, server: ClientConnection) -> None:
    """Forward subscriptions; other requests are for servers that accept commands."""
    async for message in client:
        try:
            asked = json.loads(message) if isinstance(message, str) else {}
        except (ValueError, RecursionError):
            await _disconnect(client, POLICY_VIOLATION, messages.request_is_not_json())
            return
        if isinstance(asked, dict) and asked.get("op") in FORWARDED_OPERATIONS:
            await server.send(message)


async def _disconnect(client: ServerConnection, code: int, why: str) -> None:
    """Close a connection, also if the client does not respond or read."""
    try:
        async with asyncio.timeout(FAREWELL_S):
            await client.close(code, why)
    except TimeoutError:
        client.transport.abort()


async def _run_until_first(*works: Coroutine[Any, Any, None]) -> None:
    """Run until the first coroutine ends; then cancel the others."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            with suppress(ConnectionClosed):
                task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _select_subprotocol(_connection: ServerConnection, offered: Sequence[Subprotocol]) -> Subprotocol | None:
    """Return the name of the protocol that a client supports.

    Without a common one the client ends the connection.
    """
    return next((word for word in SPOKEN if word in offered), None)


def _get_port(server: Server) -> int:
    return cast(int, next(iter(server.sockets)).getsockname()[1])


# Publisher -----------------------------------------------------------------------------------------
# Samples and events of the live stream as Foxglove's channels ``/sample`` and ``/log``, on the vendor's server.
#
# ``/sample`` has every sample in the form of an MCAP export, with ``t`` since the loop started; the time of a message
# is that of its sample, by the clock of this machine.


LOG_TOPIC = "/log"
NOTATION = (
    "SI units, angles in rad. t is relative to the start of the control loop. _ref: a reference, _gov: after "
    "reference governor or trajectory, "
    "_dot: a derivative, A and B: the two motors with their tendons, lam: lambda. "
    "Equations: docs/reference/notation.md."
)
BACKLOG = 4096
"""Messages queued per client before the oldest is dropped: four seconds."""

_PERIOD_NS = round(T_s * 1e9)
_ASTRAY_NS = 50_000_000
"""Deviation after which times are recomputed: the machine's clock was set, or the loop was paused."""

_SERVICE_STATUS = "service"
_LEVELS = {MarkKind.FAULT: foxglove_messages.LogLevel.Error, MarkKind.TRIP: foxglove_messages.LogLevel.Error}


class OtherVersionError(SinewError):
    """The service streams other signals than this version."""

    category = ErrorCode.UNAVAILABLE


class Publisher:
    """Publishes the messages of the live stream.

    ``clock_ns`` is the time of day; ``tickets`` buffer the messages.
    """

    def __init__(self, name: str, tickets: MessageSlots, clock_ns: Callable[[], int] = time.time_ns) -> None:
        logging.getLogger("foxglove").setLevel(logging.ERROR)
        self._tickets, self._clock_ns = tickets, clock_ns
        context = self._context = foxglove.Context()  # must stay referenced, or its channels are lost
        self._samples = foxglove.Channel(
            TOPIC,
            schema=foxglove.Schema(
                name=writers.NAME, encoding="jsonschema", data=writers.json_schema(describe_columns(ORDER), NOTATION)
            ),
            message_encoding="json",
            context=context,
        )
        self._log = foxglove.Channel(
            LOG_TOPIC, schema=foxglove_messages.Log.get_schema(), message_encoding="protobuf", context=context
        )
        # No capability: clients cannot send anything to the actuator.
        self._server = foxglove.start_server(
            name=name, host="127.0.0.1", port=0, context=context, message_backlog_size=BACKLOG
        )
        self.port = self._server.port
        self._began_ns: int | None = None
        self._version = 0
        self._problems: set[str] = set()

    def publish(self, message: str | bytes) -> None:
        """Publish a message of ``/api/live``. Raises OtherVersionError."""
        if isinstance(message, bytes):
            self._publish_samples(message)
            return
        content: dict[str, Any] = json.loads(message)
        match content.get("type"):
            case "layout":
                self._begin(LayoutMessage.model_validate(content))
            case "state":
                self._note(StateMessage.model_validate(content))
            case "event":
                mark = EventMessage.model_validate(content)
                self._log_message(
                    mark.text, _LEVELS.get(mark.kind, foxglove_messages.LogLevel.Info), mark.kind, mark.tick
                )
            case _:  # pongs, but no ping is sent
                pass

    def publish_disconnected(self, why: str) -> None:
        """Publish that the service is disconnected."""
        self._server.publish_status(why, StatusLevel.Error, _SERVICE_STATUS)

    def close(self) -> None:
        """Stop the server and close its connections."""
        self._server.stop()

    def _begin(self, layout: LayoutMessage) -> None:
        names = tuple(field.name for field in layout.fields)
        if names != STORED_NAMES or layout.period_s != T_s:
            raise OtherVersionError(messages.service_of_another_version())
        self._server.remove_status([_SERVICE_STATUS])
        self._began_ns = None

    def _note(self, state: StateMessage) -> None:
        began_ns = self._clock_ns() - state.tick * _PERIOD_NS
        if self._began_ns is None:
            self._version = state.tick  # older events are meant for newly opened pages
        if self._began_ns is None or abs(began_ns - self._began_ns) > _ASTRAY_NS:
            self._began_ns = began_ns
        now = set(state.problems)
        for problem in state.problems:
            if problem not in self._problems:
                self._log_message(problem, foxglove_messages.LogLevel.Warning, "problem", state.tick)
        self._problems = now

    def _publish_samples(self, packed: bytes) -> None:
        frame = wire.unpack_frame(packed)
        if self._began_ns is None or frame.first_tick < self._version or not self._samples.has_sinks():
            return
        if frame.missed:
            words = f"{frame.missed} samples before this one are missing here; the recording contains them"
            self._log_message(words, foxglove_messages.LogLevel.Warning, "stream", frame.first_tick)
        ticks = np.arange(frame.first_tick, frame.first_tick + frame.columns.shape[1])
        batch = {"t": ticks * T_s, **dict(zip(STORED_NAMES, frame.columns, strict=True))}
        for tick, line in zip(ticks.tolist(), writers.lines(ORDER, batch), strict=True):
            self._samples.log(self._tickets.ticket_for(line), log_time=self._began_ns + tick * _PERIOD_NS)

    def _log_message(self, words: str, level: foxglove_messages.LogLevel, name: str, tick: int) -> None:
        if self._began_ns is None or not self._log.has_sinks():
            return
        at_ns = self._began_ns + tick * _PERIOD_NS
        stamp = foxglove_messages.Timestamp(*divmod(at_ns, 10**9))
        entry = foxglove_messages.Log(
            timestamp=stamp, level=level, message=format_text(words, AngleUnit.RADIANS), name=name
        )
        self._log.log(self._tickets.ticket_for(entry.encode()), log_time=at_ns)


# Relay ---------------------------------------------------------------------------------------------
# Runs the server: receives the live stream of the service on a data folder, and reconnects after interruptions.


AGAIN_S = 1.0
LIVE = "/api/live"
SILENT_S = 10.0
"""Timeout of the stream [s]; the service sends its state twice a second."""


@dataclass(frozen=True)
class LiveSource:
    """Address of a service and the viewer's token, empty without authentication."""

    address: str
    token: str


async def serve_foxglove(
    find_source: Callable[[], LiveSource | None],
    key_of: Callable[[LiveSource], str],
    port: int,
    report: Callable[[str], None],
) -> None:
    """Serve until cancelled.

    ``find_source`` finds the service, ``key_of`` the key for its address, ``report`` prints to the user. Raises OSError
    if ``port`` is in use, OtherVersionError.
    """
    slots, reported, shown = MessageSlots(), "", ""
    publisher = Publisher("Sinew", slots)
    gateway = Gateway(publisher.port, slots)
    try:
        async with gateway.open(port) as open_on:
            while True:
                source = find_source()
                if source is None:
                    has_received, why = False, "no service uses the folder"
                else:
                    key = key_of(source)
                    await gateway.accept_key(key)
                    if key != shown:
                        report(f"Foxglove or Lichtblick, Open connection: ws://{HOST}:{open_on}/?token={key}")
                        shown = key
                    has_received, why = await _listen(source, publisher)
                if has_received or why != reported:  # only once per interruption
                    publisher.publish_disconnected(f"{why}: no new data is shown until the service responds")
                    report(f"{why}; the connection is retried every second")
                    reported = why
                await asyncio.sleep(AGAIN_S)
    finally:
        publisher.close()


async def _listen(source: LiveSource, publisher: Publisher) -> tuple[bool, str]:
    """Publish the stream of the service until it ends.

    Returns whether any message was received, and why it ended.
    """
    has_received = False
    where = urlsplit(source.address)
    headers = {"Authorization": f"Bearer {source.token}"} if source.token else {}
    try:
        async with connect(
            f"ws://{where.netloc}{where.path}{LIVE}",
            additional_headers=headers,
            compression=None,
            max_size=None,
            proxy=None,
        ) as live:
            while True:
                async with asyncio.timeout(SILENT_S):
                    message = await live.recv()
                publisher.publish(message)
                has_received = True
    except ConnectionClosed as closed:
        reason = closed.rcvd.reason if closed.rcvd is not None else ""
        why = f"the service at {source.address} has ended the stream{f': {reason}' if reason else ''}"
    except TimeoutError:
        why = f"the service at {source.address} no longer sends data"
    except (OSError, InvalidHandshake) as error:
        why = f"the service at {source.address} does not respond: {error}"
    return has_received, why
