"""Connections of the web server: acceptance, slots, scheduling, read budgets."""

import asyncio
import errno
import ipaddress
import logging
import re
import socket
from collections import deque
from collections.abc import Callable, Generator
from contextlib import suppress
from dataclasses import dataclass
from enum import Enum, auto
from functools import partial
from typing import Any, Protocol

import h11
from starlette.types import ASGIApp, Receive, Scope, Send
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import ServerState
from websockets.http11 import Response
from websockets.protocol import Event
from websockets.server import ServerProtocol
from websockets.streams import StreamReader

from backend.auth import BEARER, OPEN, User
from backend.schemas import Role
from backend.server import messages
from backend.server.security import (
    HEADERS,
    LONGEST_HEAD,
    MAX_BODY_BYTES,
    MOST_HEADERS,
    SHEETS,
    body_limit,
)

# Connection limits ---------------------------------------------------------------------------------
# Limits of concurrent connections.
#
# Each connection takes a slot. Anonymous connections share a small pool; when it is full, the oldest is closed in
# favour of the newest. Authenticated connections have their own slots and are never evicted; viewers as a group, and
# any single user, may use only a part of these slots, so that an operator can always connect.


RESERVE = 40
"""File descriptors reserved for the database, the loop process, pools, and connections being opened or closed."""

MOST_SLOTS = 2048
MAX_ANONYMOUS = 512
"""Most slots of anonymous connections.

The pool's size determines how long a new connection may wait for its first data while a flood replaces all others. An
idle connection costs a descriptor and some kilobytes.
"""

SOCKET_COSTS = 3
"""Slots of a websocket: the 3D view needs three descriptors per page."""

BROWSER_SLOTS = 96
"""Most slots of one browser session: a session is one person with a few tabs."""

_log = logging.getLogger(__name__)


class ConnectionSlot:
    """One connection. ``end`` closes it at once.

    ``is_answered``: it waits for its response rather than for data. Both are replaced as the connection moves from the
    accepted socket to its protocol, which also takes ``first_words``, the data received so far.
    """

    def __init__(self, address: str, end: Callable[[], None]) -> None:
        self.network = _network(address)
        self.end = end
        self.is_answered: Callable[[], bool] = lambda: False
        self.first_words = b""
        self.holder: User | None = None
        self.costs = 0


@dataclass(frozen=True)
class ConnectionBudget:
    """Number of slots for anonymous and for authenticated connections."""

    anonymous: int
    known: int

    @classmethod
    def within(cls, limit: int, in_use: int) -> "ConnectionBudget":
        """Divide the descriptors left by those in use and the reserve."""
        free = max(12, min(MOST_SLOTS, limit - in_use - RESERVE))
        anonymous = min(MAX_ANONYMOUS, free // 3)
        return cls(anonymous, free - anonymous)


class ConnectionLimiter:
    """Accounts for all slots. Belongs to the event loop."""

    def __init__(self, budget: ConnectionBudget) -> None:
        self.budget = budget
        self._anonymous: dict[str, dict[ConnectionSlot, None]] = {}
        self._known: set[ConnectionSlot] = set()

    @property
    def anonymous(self) -> int:
        """Number of anonymous connections."""
        return sum(len(crowd) for crowd in self._anonymous.values())

    @property
    def known(self) -> int:
        """Number of slots of authenticated connections."""
        return sum(slot.costs for slot in self._known)

    def enter(self, slot: ConnectionSlot) -> None:
        """Add an anonymous connection; if the pool is full, another one is closed."""
        if self.anonymous >= self.budget.anonymous:
            self.evict_anonymous()
        self._anonymous.setdefault(slot.network, {})[slot] = None

    def evict_anonymous(self) -> bool:
        """Close an anonymous connection, idle ones first. Return False if there is none.

        It is the oldest of a network with more than half of the slots. Without such a network an idle connection is
        closed, of the network with most of these: many active clients behind one address are not evicted by idle ones.
        """
        going = self._select_evicted()
        if going is None:
            return False
        self.leave(going)
        going.end()
        return True

    def _select_evicted(self) -> ConnectionSlot | None:
        largest = max(self._anonymous.values(), key=len, default=None)
        if largest is None:
            return None
        if 2 * len(largest) > self.budget.anonymous:
            return next((slot for slot in largest if not slot.is_answered()), next(iter(largest)))
        silent: list[ConnectionSlot] = []
        for crowd in self._anonymous.values():
            if len(crowd) > len(silent):  # otherwise it cannot have more idle connections
                silent = max(silent, [slot for slot in crowd if not slot.is_answered()], key=len)
        return silent[0] if silent else next(iter(largest))

    def leave(self, slot: ConnectionSlot) -> None:
        """Free a slot, whoever held it."""
        self._known.discard(slot)
        crowd = self._anonymous.get(slot.network, {})
        if slot in crowd:
            del crowd[slot]
            if not crowd:
                del self._anonymous[slot.network]

    def authenticate(self, slot: ConnectionSlot, person: User, *, is_socket: bool = False) -> bool:
        """Give slots to an authenticated connection. Return False if the share is full.

        It then stays anonymous: its requests are answered nevertheless. A websocket, which is long-lived, must be
        rejected.
        """
        costs = SOCKET_COSTS if is_socket else 1
        if slot not in self._known and slot not in self._anonymous.get(slot.network, {}):
            return False  # closed meanwhile: it must not take a slot again
        if slot.costs >= costs:
            return True
        if self._sum_costs() + costs > self.budget.known or not self._has_part(person, costs):
            return False
        self.leave(slot)
        slot.holder, slot.costs = person, costs
        self._known.add(slot)
        return True

    def _has_part(self, person: User, costs: int) -> bool:
        part = self.budget.known // 2
        if person.role is Role.VIEWER and self._sum_costs(role=Role.VIEWER) + costs > part:
            return False
        own = part if person.session in (BEARER, OPEN) else min(part, BROWSER_SLOTS)
        return self._sum_costs(session=person.session, role=person.role) + costs <= own

    def _sum_costs(self, role: Role | None = None, session: str | None = None) -> int:
        return sum(
            slot.costs
            for slot in self._known
            if slot.holder is not None
            and (role is None or slot.holder.role is role)
            and (session is None or slot.holder.session == session)
        )


def _network(address: str) -> str:
    """Return the unit that counts as one address.

    Of IPv6 that is the first 64 bits, all of which one machine may own.
    """
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if parsed.version == 4 or parsed.ipv4_mapped:
        return address
    return str(ipaddress.ip_network((int(parsed) >> 64 << 64, 64)))


# Listener ------------------------------------------------------------------------------------------
# Accepts connections from the listening socket, and passes on those that send data.
#
# A connection that sends nothing costs a descriptor only. asyncio's own accept takes a whole backlog at a time and,
# without free descriptors, retries a thousand times a second with a traceback in the log each time.


BACKLOG = 2048
"""Connections that the kernel queues; a client that finds the queue full tries again after a second."""

SILENCE_S = 10.0
"""Time in which a connection must send data [s]."""

ACCEPT_TURN_S = 0.005
"""Time for accepting connections before other work gets its turn [s]."""

FIRST_BYTES = 16 * 1024

HANDOVERS_PER_ROUND = 8
"""Connections that are passed to a protocol in a round of the event loop; requests of STOP do not wait for a turn.

A protocol and the parsing of a request cost more than ten times as much as the acceptance of its connection.
"""

STOP_PATH = "/api/stop"
"""Path of STOP, whose requests precede all others."""

_STOP_REQUEST = re.compile(rb"POST [^ ?]*" + STOP_PATH.encode() + rb"[ ?]")
"""First line of a request of STOP; a proxy may have left its prefix."""

PAUSE_S = 0.05
"""Pause after the kernel failed to accept a connection [s]."""

_OUT_OF_RESOURCES = {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM}


class ConnectionAcceptor:
    """Accepts on one listening socket until closed. ``protocol`` makes protocols.

    ``highest`` is the largest descriptor of a new connection: those above are for the rest of the service.
    """

    def __init__(
        self,
        listening: socket.socket,
        limiter: ConnectionLimiter,
        protocol: Callable[[ConnectionSlot], asyncio.Protocol],
        highest: int,
    ) -> None:
        self.limiter = limiter
        self.protocol = protocol
        self._loop = asyncio.get_running_loop()
        self._listening = listening
        self._highest = highest
        self._retry: asyncio.TimerHandle | None = None
        self._waiting: deque[_PendingConnection] = deque()
        self._is_passing = False
        listening.setblocking(False)
        listening.listen(BACKLOG)
        self._accept_from_now_on()

    def close(self) -> None:
        """Stop accepting. The listening socket stays open."""
        self._loop.remove_reader(self._listening)
        if self._retry is not None:
            self._retry.cancel()

    def _accept_from_now_on(self) -> None:
        self._retry = None
        self._loop.add_reader(self._listening, self._accept)

    def _accept(self) -> None:
        until = self._loop.time() + ACCEPT_TURN_S
        for _ in range(self.limiter.budget.anonymous // 2):
            if self._loop.time() > until:
                return
            try:
                connection, address = self._listening.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:
                self._accept_later(error)
                return
            if connection.fileno() > self._highest and not self.limiter.evict_anonymous():
                _log.warning("The service refused a connection: no file descriptor is free.")
                connection.close()
                continue
            _PendingConnection(self, connection, str(address[0]))

    def pass_on(self, pending: "_PendingConnection", *, is_stop: bool) -> None:
        """Pass a connection with data to a protocol, STOP at once and others in order of arrival."""
        if is_stop:
            pending.pass_on()
            return
        self._waiting.append(pending)
        if not self._is_passing:
            self._is_passing = True
            self._loop.call_soon(self._pass_on_some)

    def _pass_on_some(self) -> None:
        passed = 0
        while self._waiting and passed < HANDOVERS_PER_ROUND:
            pending = self._waiting.popleft()
            if not pending.is_closed:  # closed ones take no turn, or a flood would fill the queue with them
                pending.pass_on()
                passed += 1
        self._is_passing = bool(self._waiting)
        if self._is_passing:
            self._loop.call_soon(self._pass_on_some)

    def _accept_later(self, error: OSError) -> None:
        """Leave the connections in the kernel's queue for a moment."""
        _log.error("The service currently cannot accept connections: %s", error)
        if error.errno in _OUT_OF_RESOURCES:
            self.limiter.evict_anonymous()
        self._loop.remove_reader(self._listening)
        self._retry = self._loop.call_later(PAUSE_S, self._accept_from_now_on)


class _PendingConnection:
    """A connection until its first data are passed on, or until its end."""

    def __init__(self, listener: ConnectionAcceptor, connection: socket.socket, address: str) -> None:
        self._listener = listener
        self._connection = connection
        self._loop = asyncio.get_running_loop()
        self._handover: asyncio.Task[None] | None = None
        self.is_closed = False
        self._has_data = False
        connection.setblocking(False)
        # Without this option a response in two parts would wait 40 ms for an acknowledgement.
        with suppress(OSError):  # closed already
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._slot = ConnectionSlot(address, self._end)
        listener.limiter.enter(self._slot)
        self._patience = self._loop.call_later(SILENCE_S, self._end)
        # Under load its data have waited in the kernel with it, so each turn of the event loop counts.
        self._listen()
        if not self._has_data and not self.is_closed:
            self._loop.add_reader(connection, self._listen)

    def _listen(self) -> None:
        try:
            words = self._connection.recv(FIRST_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            words = b""
        if not words:
            self._end()
            return
        self._patience.cancel()
        self._loop.remove_reader(self._connection)
        self._slot.first_words = words
        self._slot.is_answered = lambda: True  # evicted last: its data have not been read yet
        self._has_data = True
        self._listener.pass_on(self, is_stop=_STOP_REQUEST.match(words) is not None)

    def pass_on(self) -> None:
        """Pass the connection to a protocol."""
        self._handover = self._loop.create_task(self._hand_over())

    async def _hand_over(self) -> None:
        """Pass the connection to a protocol, which takes over ``slot.end``."""
        try:
            factory = partial(self._listener.protocol, self._slot)
            transport, _ = await self._loop.connect_accepted_socket(factory, self._connection)
        except OSError:
            self._listener.limiter.leave(self._slot)
            return
        except Exception:
            _log.exception("The listener could not pass a connection to its protocol.")
            self._listener.limiter.leave(self._slot)
            self._connection.close()
            return
        if self.is_closed:
            transport.abort()

    def _end(self) -> None:
        self._listener.limiter.leave(self._slot)
        self.is_closed = True
        if self._handover is None:
            self._patience.cancel()
            self._loop.remove_reader(self._connection)
            self._connection.close()


# Reading -------------------------------------------------------------------------------------------
# Received data are parsed in small pieces, in turn, and within a budget for each websocket.
#
# asyncio delivers up to 256 kB at once: 40,000 empty frames, which take a second to parse while another client's STOP
# waits. Here pieces of all connections alternate, each round of the event loop spends a few milliseconds on all of
# them, and a websocket that sends more than a page does is read more slowly, then closed.


PIECE = 512
"""Bytes of a websocket that are parsed at once: at most 256 frames, in 2 ms."""

READ_TURN_S = 0.002
"""Time for parsing all connections in a round of the event loop [s]."""

MOST_UNREAD = 64 * 1024
"""Bytes waiting to be parsed beyond which a connection is not read."""

FRAMES_PER_S, FRAMES_AT_ONCE = 100.0, 400.0
"""Sustained rate and burst of a websocket's frames: a page sends one a second, the 3D view some in a drag."""

BYTES_PER_S, BYTES_AT_ONCE = 64.0 * 1024, 2.0 * 1024 * 1024
"""Sustained rate and burst of a websocket's bytes."""

READ_TIMEOUT_S = 5.0
"""Time beyond its budget after which a websocket is closed [s]."""


class Connection(Protocol):
    """A connection with data to parse."""

    def parse_piece(self) -> float | None:
        """Parse the next piece; return the delay before the next one [s], None for none."""

    def end(self) -> None:
        """Close at once."""


class ReadScheduler:
    """Parses the pieces of connections in turn. Belongs to the event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[Connection] = deque()
        self._scheduled: set[int] = set()
        self._is_due = False

    def add(self, connection: Connection) -> None:
        """Schedule a connection for parsing, at once if none waits."""
        if id(connection) in self._scheduled:
            return
        self._scheduled.add(id(connection))
        self._waiting.append(connection)
        if not self._is_due:
            self._is_due = True
            self._turn()

    def _turn(self) -> None:
        until = self._loop.time() + READ_TURN_S
        while self._waiting:
            connection = self._waiting.popleft()
            pause_s = _parse_head(connection)
            if pause_s is None:
                self._scheduled.discard(id(connection))
            elif pause_s > 0.0:
                self._loop.call_later(pause_s, self._resume, connection)
            else:
                self._waiting.append(connection)
            if self._loop.time() > until:
                break
        # Also if none waits: data of this round wait for the next, or each connection of a crowd would be the first.
        self._loop.call_soon(self._turn_or_rest)

    def _turn_or_rest(self) -> None:
        if self._waiting:
            self._turn()
        else:
            self._is_due = False

    def _resume(self, connection: Connection) -> None:
        self._waiting.append(connection)
        if not self._is_due:
            self._is_due = True
            self._turn()


def _parse_head(connection: Connection) -> float | None:
    try:
        return connection.parse_piece()
    except Exception:
        _log.exception("The service closed a connection with unparsable data.")
        connection.end()
        return None


class Budget:
    """Budget of a websocket: filled by time, emptied by frames and bytes."""

    def __init__(self, now: float) -> None:
        self._at, self._frames, self._bytes = now, FRAMES_AT_ONCE, BYTES_AT_ONCE
        self._short_since: float | None = None

    def spend(self, now: float, frames: int, size: int) -> float:
        """Subtract what was parsed; return the pause before more is parsed [s].

        0 within the budget.
        """
        passed, self._at = now - self._at, now
        self._frames = min(FRAMES_AT_ONCE, self._frames + FRAMES_PER_S * passed) - frames
        self._bytes = min(BYTES_AT_ONCE, self._bytes + BYTES_PER_S * passed) - size
        pause_s = max(0.0, -self._frames / FRAMES_PER_S, -self._bytes / BYTES_PER_S)
        if pause_s == 0.0:
            self._short_since = None
        elif self._short_since is None:
            self._short_since = now
        return pause_s

    def is_overdrawn(self, now: float) -> bool:
        """Return whether the connection has exceeded its budget for too long."""
        return self._short_since is not None and now - self._short_since > READ_TIMEOUT_S


SOCKETS_PER_S, SOCKETS_AT_ONCE = 4.0, 24
"""Sustained rate and burst of websockets per session: a dozen pages with a 3D view each, reloaded."""

LONGEST_WAIT_S = 10.0
MOST_SESSIONS = 1000


class WebsocketThrottle:
    """Limits the rate of new websockets per session: some wait, many are rejected."""

    def __init__(self) -> None:
        self._due: dict[str, float] = {}

    def wait_s(self, session: str, now: float) -> float | None:
        """Count one more and return its delay [s].

        None, without counting it, if that would be too long.
        """
        if len(self._due) > MOST_SESSIONS:
            self._due = {known: due for known, due in self._due.items() if due > now}
        due = max(self._due.get(session, 0.0), now) + 1.0 / SOCKETS_PER_S
        pause_s = max(0.0, due - now - SOCKETS_AT_ONCE / SOCKETS_PER_S)
        if pause_s > LONGEST_WAIT_S:
            return None
        self._due[session] = due
        return pause_s


# Protocols -----------------------------------------------------------------------------------------
# uvicorn's two protocols with a slot for each connection and a timeout for every wait: a request's head, its body, the
# pause until the next request, and a response that is not read.


HEAD_S = 10.0
"""Time for the head of a request [s], from its first byte or the start of the connection."""

BODY_S = 10.0
"""Time for a body of ``MAX_BODY_BYTES`` [s]; proportionally more where larger ones are accepted."""

REST_S = 10.0
"""Time for reading the rest of a body after the response [s], so that the client reads the response."""

ANONYMOUS_PAUSE_S, AUTHENTICATED_PAUSE_S = 5.0, 60.0
"""Time that an anonymous or an authenticated connection is kept between two requests [s]."""

STALL_S = 30.0
"""Time without progress of a response after which its connection is closed [s]."""

CONNECTION_SLOT = "connection_slot"
"""Key of the connection's slot in the ``state`` of a request's scope."""

CONNECTION_LIMITER = "connection_limiter"
"""Key of the ``ConnectionLimiter`` in the same ``state``."""

READING = "reading"
"""Key of the ``ReadScheduler`` in the same ``state``."""

TOO_MUCH = 1008
"""Close code of a websocket that exceeds its budget: policy violation."""

POLL_S = 0.005
"""Polling interval of a connection whose application has not consumed the parsed data [s]."""


def body_s(path: str) -> float:
    """Return the time for the body of a request [s], proportional to its limit."""
    asked = SHEETS if path.endswith(SHEETS) else path  # a proxy may have left its prefix
    return BODY_S * body_limit(asked) / MAX_BODY_BYTES


class _LimitedProtocol(asyncio.Protocol):
    """Frees the slot at the end; closes a connection that does not read its response.

    Received data wait in ``_unread`` to be parsed, ``PIECE`` bytes at a time. Must precede uvicorn's protocol in the
    order of base classes.
    """

    PIECE = LONGEST_HEAD
    _unread: bytearray
    _is_full = False

    transport: asyncio.Transport
    loop: asyncio.AbstractEventLoop
    app_state: dict[str, Any]
    _stalled: asyncio.TimerHandle | None = None

    @property
    def slot(self) -> ConnectionSlot:
        """Slot of this connection."""
        slot: ConnectionSlot = self.app_state[CONNECTION_SLOT]
        return slot

    @property
    def limiter(self) -> ConnectionLimiter:
        """Limiter of all slots."""
        limiter: ConnectionLimiter = self.app_state[CONNECTION_LIMITER]
        return limiter

    def end(self) -> None:
        """Close at once; unsent data are lost."""
        self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Free the slot."""
        self.limiter.leave(self.slot)
        self._unset_stall()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Store received data until it is this connection's turn to be parsed."""
        self._unread += data
        if len(self._unread) > MOST_UNREAD and not self.transport.is_closing():
            self._is_full = True
            self.transport.pause_reading()
        reading: ReadScheduler = self.app_state[READING]
        reading.add(self)

    def parse_piece(self) -> float | None:
        """Parse the next piece; return the delay before the next one [s], None for none."""
        if self.transport.is_closing():
            self._unread.clear()
            return None
        if self._is_waiting_for_app():
            return POLL_S
        piece = bytes(self._unread[: self.PIECE])
        del self._unread[: len(piece)]
        pause_s = self.parse(piece) if piece else 0.0
        if self._is_full and len(self._unread) <= MOST_UNREAD:
            self._is_full = False
            if not self.transport.is_closing() and not self._is_waiting_for_app():
                self.transport.resume_reading()
        # A pause also applies if no more data have arrived yet: what comes next is parsed after it.
        return pause_s if self._unread or pause_s > 0.0 else None

    def parse(self, piece: bytes) -> float:
        """Pass a piece to uvicorn; return the delay before the next one [s]."""
        raise NotImplementedError

    def _is_waiting_for_app(self) -> bool:
        """Return whether the application has not consumed the parsed data yet.

        uvicorn does not read then.
        """
        raise NotImplementedError

    def pause_writing(self) -> None:
        """Start to monitor the progress of the response."""
        super().pause_writing()
        self._watch_writing()

    def resume_writing(self) -> None:
        """Stop monitoring: almost all data were sent."""
        super().resume_writing()
        self._unset_stall()

    def _watch_writing(self) -> None:
        waiting = self.transport.get_write_buffer_size()
        self._stalled = self.loop.call_later(STALL_S, self._check_writing, waiting)

    def _check_writing(self, waiting: int) -> None:
        if self.transport.get_write_buffer_size() < waiting:
            self._watch_writing()
        else:
            self.end()

    def _unset_stall(self) -> None:
        if self._stalled is not None:
            self._stalled.cancel()
            self._stalled = None


class _Wait(Enum):
    """What a connection waits for."""

    HEAD = auto()
    BODY = auto()
    REST = auto()
    NOTHING = auto()


class HttpProtocol(_LimitedProtocol, H11Protocol):
    """HTTP/1.1 on a connection with a slot."""

    def __init__(
        self,
        limiter: ConnectionLimiter,
        slot: ConnectionSlot,
        reading: ReadScheduler,
        config: Config,
        server_state: ServerState,
    ) -> None:
        super().__init__(config, server_state, {CONNECTION_LIMITER: limiter, CONNECTION_SLOT: slot, READING: reading})
        self._unread = bytearray()
        self._waits_for = _Wait.NOTHING
        self._patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as in uvicorn
        """Take over the slot and the data received before."""
        super().connection_made(transport)
        self.slot.end = self.end
        self.slot.is_answered = self._is_answered
        self._watch()
        # Deferred: until this returns, the transport cannot be paused.
        self.loop.call_soon(self._take_first_words)

    def connection_lost(self, exc: Exception | None) -> None:
        """Cancel all timeouts."""
        self._unset_patience()
        super().connection_lost(exc)

    def parse(self, piece: bytes) -> float:
        """Parse the next bytes; the timeout continues unless they complete the wait.

        Pieces are small, so a head that is too long is rejected by its length, before its lines are parsed.
        """
        H11Protocol.data_received(self, piece)
        self._watch()
        return 0.0

    def _is_waiting_for_app(self) -> bool:
        return self.flow is not None and self.flow.read_paused

    def on_response_complete(self) -> None:
        """Keep the connection for the next request."""
        self.timeout_keep_alive = int(AUTHENTICATED_PAUSE_S if self.slot.costs else ANONYMOUS_PAUSE_S)
        super().on_response_complete()
        self._watch()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Switch to the websocket protocol, which has its own timeouts."""
        if len(event.headers) > MOST_HEADERS:  # the websocket protocol would close without a response
            self._refuse_head()
            return
        self._unset_patience()
        self._unset_stall()
        super().handle_websocket_upgrade(event)

    def send_400_response(self, msg: str) -> None:
        """Respond to invalid HTTP or a head that is too long, with the standard headers."""
        if self._find_wait() is _Wait.HEAD and len(self.conn.trailing_data[0]) > LONGEST_HEAD:
            self._refuse_head()
        else:
            self._refuse(400, "Bad Request", msg)

    def _refuse_head(self) -> None:
        message = messages.head_too_large(maximum_bytes=LONGEST_HEAD, maximum_lines=MOST_HEADERS)
        self._refuse(431, "Request Header Fields Too Large", message)

    def _refuse(self, status: int, reason: str, msg: str) -> None:
        if self.conn.our_state not in (h11.IDLE, h11.SEND_RESPONSE):
            self.end()
            return
        content = msg.encode("ascii")
        headers = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
        headers += [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close")]
        headers += [(b"content-length", str(len(content)).encode())]
        for sent in (
            h11.Response(status_code=status, headers=headers, reason=reason.encode()),
            h11.Data(data=content),
            h11.EndOfMessage(),
        ):
            self.transport.write(self.conn.send(sent) or b"")
        if self.cycle is not None:
            self.cycle.disconnected = True  # a request with an invalid body: its route's own response is discarded
            self.cycle.message_event.set()
        self.transport.close()

    def _is_answered(self) -> bool:
        return bool(self.slot.first_words or self._unread) or self._find_wait() is _Wait.NOTHING

    def _take_first_words(self) -> None:
        words, self.slot.first_words = self.slot.first_words, b""
        if not self.transport.is_closing():
            self.data_received(words)

    def _find_wait(self) -> _Wait:
        cycle: Any = self.cycle  # None before the first request, which uvicorn does not declare
        if cycle is None:
            return _Wait.HEAD
        if not cycle.response_complete:
            return _Wait.BODY if cycle.more_body else _Wait.NOTHING
        return _Wait.REST if self.conn.their_state is h11.SEND_BODY else _Wait.HEAD

    def _body_s(self) -> float:
        return body_s(self.cycle.scope["path"]) if self.cycle else BODY_S

    def _watch(self) -> None:
        waits_for = self._find_wait()
        if waits_for is self._waits_for:
            return
        self._unset_patience()
        self._waits_for = waits_for
        pause_s = self.timeout_keep_alive if self.cycle else 0.0
        seconds = {_Wait.HEAD: pause_s + HEAD_S, _Wait.BODY: self._body_s(), _Wait.REST: REST_S}.get(waits_for)
        if seconds is not None and not self.transport.is_closing():
            self._patience = self.loop.call_later(seconds, self.end)

    def _unset_patience(self) -> None:
        if self._patience is not None:
            self._patience.cancel()
            self._patience = None


class SocketProtocol(_LimitedProtocol, WebSocketsSansIOProtocol):
    """A websocket on a connection with a slot."""

    PIECE = PIECE

    def __init__(self, config: Config, server_state: ServerState, app_state: dict[str, Any]) -> None:
        super().__init__(config, server_state, app_state)
        self.conn = self._counted = _Handshake(max_size=config.ws_max_size, logger=self.logger)
        self._unread = bytearray()
        self._budget = Budget(self.loop.time())
        self.slot.end = self.end
        self.slot.is_answered = lambda: True

    def parse(self, piece: bytes) -> float:
        """Parse frames within the budget; close the connection after a long excess.

        The excess is logged.
        """
        before = self._counted.frames
        if not self.handshake_initiated:  # the head of the request, which counts as one
            WebSocketsSansIOProtocol.data_received(self, piece + bytes(self._unread))
            self._unread.clear()
            return 0.0
        WebSocketsSansIOProtocol.data_received(self, piece)
        now = self.loop.time()
        pause_s = self._budget.spend(now, self._counted.frames - before, len(piece))
        if pause_s > 0.0 and self._budget.is_overdrawn(now):
            self._close_for_too_much()
        return pause_s

    def _close_for_too_much(self) -> None:
        holder = self.slot.holder
        _log.warning(
            "The service closed a websocket of %s (%s): for %g s it sent more than %g frames or %g bytes per second.",
            "an anonymous client" if holder is None else holder.name,
            self.client[0] if self.client else "unknown address",
            READ_TIMEOUT_S,
            FRAMES_PER_S,
            BYTES_PER_S,
        )
        self.queue.put_nowait({"type": "websocket.disconnect", "code": TOO_MUCH})
        if self.handshake_complete and not self.close_sent:
            self.conn.fail(TOO_MUCH, "too many frames or bytes")
            self.transport.write(b"".join(self.conn.data_to_send()))
            self.close_sent = True
        self.transport.close()

    def _is_waiting_for_app(self) -> bool:
        return self.read_paused

    async def send(self, message: Any) -> None:
        """Send a message and mark a rejected handshake as complete, unlike uvicorn."""
        await super().send(message)
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True


class _WholeLines(StreamReader):
    """Reads lines of any length: the head was limited when it was read as a request."""

    def read_line(self, m: int) -> Generator[None, None, bytearray]:
        """Return the next line."""
        return (yield from super().read_line(2 * LONGEST_HEAD))


class _Handshake(ServerProtocol):
    """Handshake with the limits of other requests; rejections have standard headers."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.frames = 0
        self.reader = _WholeLines()
        self.parser = self.parse()
        next(self.parser)  # starts the new parser

    def events_received(self) -> list[Event]:
        """Return the parsed events, and count them."""
        events = super().events_received()
        self.frames += len(events)
        return events

    def reject(self, status: int, text: str) -> Response:
        response = super().reject(status, text)
        response.headers.update(HEADERS)
        return response


# Request order -------------------------------------------------------------------------------------
# Requests start one after the other, so STOP waits for the current one and not for all of a crowd.
#
# The event loop runs everything that is ready before it polls for new data. Two dozen busy pages make such a round a
# tenth of a second long, and a response takes several rounds.


class RequestSchedulingMiddleware:
    """ASGI middleware that starts one operator's and one other request per round.

    STOP starts at once. Operators' requests, like the others, start in order of arrival.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._operators: deque[asyncio.Future[None]] = deque()
        self._others: deque[asyncio.Future[None]] = deque()
        self._has_begun = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on in its turn."""
        if scope["type"] in ("http", "websocket") and scope["path"] != STOP_PATH:
            await self._turn(self._operators if _is_operator(scope) else self._others)
        await self._app(scope, receive, send)

    async def _turn(self, line: deque[asyncio.Future[None]]) -> None:
        loop = asyncio.get_running_loop()
        if self._has_begun:
            turn = loop.create_future()
            line.append(turn)
            await turn
        else:
            self._has_begun = True
            loop.call_soon(self._next_round)

    def _next_round(self) -> None:
        self._has_begun = False
        for line in (self._operators, self._others):
            while line and not self._has_begun_with(line.popleft()):
                continue
        if self._has_begun:
            asyncio.get_running_loop().call_soon(self._next_round)

    def _has_begun_with(self, turn: asyncio.Future[None]) -> bool:
        if turn.done():  # cancelled: the client is gone
            return False
        turn.set_result(None)
        self._has_begun = True
        return True


def _is_operator(scope: Scope) -> bool:
    slot = scope.get("state", {}).get(CONNECTION_SLOT)
    return slot is not None and slot.holder is not None and slot.holder.role is Role.OPERATOR
