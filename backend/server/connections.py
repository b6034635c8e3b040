"""Connections of the web server: acceptance, places, turns of requests, budgets of reading."""

import asyncio
import errno
import ipaddress
import logging
import socket
from collections import deque
from collections.abc import Callable, Generator, Iterable
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
from backend.server.security import (
    HEADERS,
    LONGEST_HEAD,
    MAX_BODY_BYTES,
    MOST_HEADERS,
    SHEETS,
    body_limit,
    too_large_a_head,
)

# Places --------------------------------------------------------------------------------------------
#
# Who is let in when there are more connections than places.
#
# Each connection takes a place. Whoever has not shown yet who they are is a guest: guests have few
# places, and when those are taken the oldest guest gives way to the newest. Whoever is signed in
# has a place of their own and is not sent away; viewers together, and one person alone, get a part
# of these places only, so that some are always left for an operator.


RESERVE = 40
"""Descriptors kept for the database, the loop process, the pools, and connections on their way in or out."""

MOST_PLACES = 2048
MAX_ANONYMOUS = 64
SOCKET_COSTS = 3
"""Places that a websocket takes: the 3D view needs three descriptors for each page."""

BROWSER_PLACES = 96
"""Most places of one browser session: a session is meant to be a person with a handful of tabs."""

_log = logging.getLogger(__name__)


class ConnectionSlot:
    """One connection. ``end`` closes it at once; ``is_answered`` tells whether it waits for its answer, not for words.

    Both change hands as the connection goes from the accepted socket to its protocol, which takes ``first_words`` over.
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
    """How many places there are for guests and for those who are signed in."""

    anonymous: int
    known: int

    @classmethod
    def within(cls, limit: int, in_use: int) -> "ConnectionBudget":
        """Divide what a limit of descriptors leaves beside those in use and the reserve."""
        free = max(12, min(MOST_PLACES, limit - in_use - RESERVE))
        anonymous = min(MAX_ANONYMOUS, free // 3)
        return cls(anonymous, free - anonymous)


class ConnectionLimiter:
    """Keeps account of all places. Belongs to the event loop."""

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
        """How many places those who are signed in take."""
        return sum(place.costs for place in self._known)

    def enter(self, place: ConnectionSlot) -> None:
        """Let a guest in; another one gives way when all places for guests are taken."""
        if self.anonymous >= self.budget.anonymous:
            self.evict_anonymous()
        self._anonymous.setdefault(place.network, {})[place] = None

    def evict_anonymous(self) -> bool:
        """Close an anonymous connection: the oldest of the largest network, idle ones first. False when there is none.

        A network with more than half of the places gives way first. Else somebody who has not asked for anything does,
        of the network with the most of these: many who ask from one address are not pushed out by an idle crowd.
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
        crowds: Iterable[dict[ConnectionSlot, None]] = (
            [largest] if 2 * len(largest) > self.budget.anonymous else self._anonymous.values()
        )
        silent = max(([place for place in crowd if not place.is_answered()] for crowd in crowds), key=len)
        return silent[0] if silent else next(iter(largest))

    def leave(self, place: ConnectionSlot) -> None:
        """Take back a place, whoever held it."""
        self._known.discard(place)
        crowd = self._anonymous.get(place.network, {})
        if place in crowd:
            del crowd[place]
            if not crowd:
                del self._anonymous[place.network]

    def authenticate(self, place: ConnectionSlot, person: User, *, is_socket: bool = False) -> bool:
        """Give a slot to an authenticated connection. False when the user's share is full.

        They stay a guest then: their requests are answered all the same. A websocket, which stays, is to be refused.
        """
        costs = SOCKET_COSTS if is_socket else 1
        if place not in self._known and place not in self._anonymous.get(place.network, {}):
            return False  # gone meanwhile: whoever left does not come back to give a place back
        if place.costs >= costs:
            return True
        if self._sum_costs() + costs > self.budget.known or not self._has_part(person, costs):
            return False
        self.leave(place)
        place.holder, place.costs = person, costs
        self._known.add(place)
        return True

    def _has_part(self, person: User, costs: int) -> bool:
        part = self.budget.known // 2
        if person.role is Role.VIEWER and self._sum_costs(role=Role.VIEWER) + costs > part:
            return False
        own = part if person.session in (BEARER, OPEN) else min(part, BROWSER_PLACES)
        return self._sum_costs(session=person.session, role=person.role) + costs <= own

    def _sum_costs(self, role: Role | None = None, session: str | None = None) -> int:
        return sum(
            place.costs
            for place in self._known
            if place.holder is not None
            and (role is None or place.holder.role is role)
            and (session is None or place.holder.session == session)
        )


def _network(address: str) -> str:
    """Return what is counted as one address: of IPv6 the first 64 bits, which one machine has all to itself."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if parsed.version == 4 or parsed.ipv4_mapped:
        return address
    return str(ipaddress.ip_network((int(parsed) >> 64 << 64, 64)))


# Listener ------------------------------------------------------------------------------------------
#
# Takes connections off the listening socket, and hands over those that say something.
#
# A connection that says nothing costs a descriptor and nothing else. asyncio's own way of accepting
# takes a whole backlog at a time and, without descriptors left, tries again a thousand times a
# second, with a traceback in the log for each.


BACKLOG = 512
"""Connections that the kernel keeps until they are taken: a flood of them is through in some tens of milliseconds."""

SILENCE_S = 10.0
"""So long a connection may say nothing."""

ACCEPT_TURN_S = 0.005
"""So long [s] connections are taken before others have their turn."""

FIRST_BYTES = 16 * 1024

PAUSE_S = 0.05
"""Pause [s] after the kernel has refused to give a connection."""

_OUT_OF_RESOURCES = {errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM}


class ConnectionAcceptor:
    """Accepts on one listening socket until closed. ``protocol`` makes the protocol of a connection.

    ``highest`` is the largest descriptor for a new connection: those above are for the rest of the service.
    """

    def __init__(
        self,
        listening: socket.socket,
        places: ConnectionLimiter,
        protocol: Callable[[ConnectionSlot], asyncio.Protocol],
        highest: int,
    ) -> None:
        self.places = places
        self.protocol = protocol
        self._loop = asyncio.get_running_loop()
        self._listening = listening
        self._highest = highest
        self._retry: asyncio.TimerHandle | None = None
        listening.setblocking(False)
        listening.listen(BACKLOG)
        self._accept_from_now_on()

    def close(self) -> None:
        """Accept nothing more. The listening socket stays open."""
        self._loop.remove_reader(self._listening)
        if self._retry is not None:
            self._retry.cancel()

    def _accept_from_now_on(self) -> None:
        self._retry = None
        self._loop.add_reader(self._listening, self._accept)

    def _accept(self) -> None:
        until = self._loop.time() + ACCEPT_TURN_S
        for _ in range(self.places.budget.anonymous // 2):
            if self._loop.time() > until:
                return
            try:
                connection, address = self._listening.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:
                self._accept_later(error)
                return
            if connection.fileno() > self._highest and not self.places.evict_anonymous():
                _log.warning("The service refused a connection: no file descriptor is free.")
                connection.close()
                continue
            _Newcomer(self, connection, str(address[0]))

    def _accept_later(self, error: OSError) -> None:
        """Leave the connections in the kernel for a moment."""
        _log.error("The service cannot accept connections at present: %s", error)
        if error.errno in _OUT_OF_RESOURCES:
            self.places.evict_anonymous()
        self._loop.remove_reader(self._listening)
        self._retry = self._loop.call_later(PAUSE_S, self._accept_from_now_on)


class _Newcomer:
    """A connection until its first words are handed over, or its end."""

    def __init__(self, listener: ConnectionAcceptor, connection: socket.socket, address: str) -> None:
        self._listener = listener
        self._connection = connection
        self._loop = asyncio.get_running_loop()
        self._handover: asyncio.Task[None] | None = None
        self._sent_away = False
        connection.setblocking(False)
        with suppress(
            OSError
        ):  # gone already; an answer in two parts would else wait 40 ms for the first one's receipt
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._place = ConnectionSlot(address, self._end)
        listener.places.enter(self._place)
        self._patience = self._loop.call_later(SILENCE_S, self._end)
        # Under a crowd it has waited in the kernel, and its words with it: each turn of the event loop counts then.
        self._listen()
        if self._handover is None and not self._sent_away:
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
        self._place.first_words = words
        self._place.is_answered = lambda: True  # gives way last: its words are not read yet
        self._handover = self._loop.create_task(self._hand_over())

    async def _hand_over(self) -> None:
        """Give the connection to a protocol, which takes over ``place.end``."""
        try:
            factory = partial(self._listener.protocol, self._place)
            transport, _ = await self._loop.connect_accepted_socket(factory, self._connection)
        except OSError:
            self._listener.places.leave(self._place)
            return
        except Exception:
            _log.exception("The listener could not pass a connection to its protocol.")
            self._listener.places.leave(self._place)
            self._connection.close()
            return
        if self._sent_away:
            transport.abort()

    def _end(self) -> None:
        self._listener.places.leave(self._place)
        self._sent_away = True
        if self._handover is None:
            self._patience.cancel()
            self._loop.remove_reader(self._connection)
            self._connection.close()


# Reading -------------------------------------------------------------------------------------------
#
# What connections send is parsed in small pieces, in turn, and within a budget for each websocket.
#
# asyncio hands over up to 256 kB at once: 40,000 empty frames, which take a second to parse, and
# STOP of somebody else waits behind them. Here a piece of one connection is followed by one of the
# next, each round of the event loop spends a few milliseconds on all of them, and a websocket that
# sends more than a page does is read more slowly, then closed.


PIECE = 512
"""Bytes of a websocket that are parsed at once: at most 256 frames, in 2 ms."""

READ_TURN_S = 0.002
"""So long [s] all connections together are parsed in a round of the event loop."""

MOST_UNREAD = 64 * 1024
"""Bytes that wait to be parsed; a connection with more is not read until some are."""

FRAMES_PER_S, FRAMES_AT_ONCE = 100.0, 400.0
"""Frames of a websocket, in the long run and at once: a page sends one in a second, the 3D view some in a drag."""

BYTES_PER_S, BYTES_AT_ONCE = 64.0 * 1024, 2.0 * 1024 * 1024
"""Bytes of a websocket, in the long run and at once."""

PATIENCE_S = 5.0
"""A websocket that wants more than its budget for so long [s] is closed."""


class Connection(Protocol):
    """What sends."""

    def parse_piece(self) -> float | None:
        """Parse the next piece; return after how long [s] the next one is parsed, None when there is none."""

    def end(self) -> None:
        """Close at once."""


class ReadScheduler:
    """Lets connections have their pieces parsed in turn. Belongs to the event loop."""

    def __init__(self) -> None:
        self._loop = asyncio.get_running_loop()
        self._waiting: deque[Connection] = deque()
        self._lined_up: set[int] = set()
        self._is_due = False

    def add(self, connection: Connection) -> None:
        """Have a connection's bytes parsed when it is its turn: at once where nobody waits."""
        if id(connection) in self._lined_up:
            return
        self._lined_up.add(id(connection))
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
                self._lined_up.discard(id(connection))
            elif pause_s > 0.0:
                self._loop.call_later(pause_s, self._line_up_again, connection)
            else:
                self._waiting.append(connection)
            if self._loop.time() > until:
                break
        # Also where nobody waits: what comes in this round waits for the next, or each of a crowd would be the first.
        self._loop.call_soon(self._turn_or_rest)

    def _turn_or_rest(self) -> None:
        if self._waiting:
            self._turn()
        else:
            self._is_due = False

    def _line_up_again(self, connection: Connection) -> None:
        self._waiting.append(connection)
        if not self._is_due:
            self._is_due = True
            self._turn()


def _parse_head(connection: Connection) -> float | None:
    try:
        return connection.parse_piece()
    except Exception:
        _log.exception("The service closes a connection whose bytes it cannot parse.")
        connection.end()
        return None


class Budget:
    """What a websocket may send: filled by time, emptied by frames and bytes."""

    def __init__(self, now: float) -> None:
        self._at, self._frames, self._bytes = now, FRAMES_AT_ONCE, BYTES_AT_ONCE
        self._short_since: float | None = None

    def spend(self, now: float, frames: int, size: int) -> float:
        """Take off what was parsed; return for how long nothing more is to be parsed [s], 0 within the budget."""
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
        """Tell whether the connection has wanted more than its budget for too long."""
        return self._short_since is not None and now - self._short_since > PATIENCE_S


SOCKETS_PER_S, SOCKETS_AT_ONCE = 4.0, 24
"""Websockets that a session may open in the long run, and at once: a dozen pages with a 3D view each, loaded again."""

LONGEST_WAIT_S = 10.0
MOST_SESSIONS = 1000


class Arrivals:
    """Lets each session open websockets at a rate: one more waits for its turn, many more are refused."""

    def __init__(self) -> None:
        self._due: dict[str, float] = {}

    def wait_s(self, session: str, now: float) -> float | None:
        """Count one more and return how long it has to wait [s]; None, and not counted, where that is too long."""
        if len(self._due) > MOST_SESSIONS:
            self._due = {known: due for known, due in self._due.items() if due > now}
        due = max(self._due.get(session, 0.0), now) + 1.0 / SOCKETS_PER_S
        pause_s = max(0.0, due - now - SOCKETS_AT_ONCE / SOCKETS_PER_S)
        if pause_s > LONGEST_WAIT_S:
            return None
        self._due[session] = due
        return pause_s


# Protocols -----------------------------------------------------------------------------------------
#
# uvicorn's two protocols with a place for each connection and an end to every wait.
#
# A request's head, its body, the pause until the next request, and an answer that nobody reads:
# each has its time.


HEAD_S = 10.0
"""So long the head of a request may take, from its first byte or the connection's beginning."""

BODY_S = 10.0
"""So long a body of ``MAX_BODY_BYTES`` may take; where larger ones are taken, as much longer as they may be larger."""

REST_S = 10.0
"""So long the rest of a body is taken that the answer did not wait for, so that the answer is read."""

ANONYMOUS_PAUSE_S, AUTHENTICATED_PAUSE_S = 5.0, 60.0
"""So long a connection is kept between two requests: of a guest, of somebody who is signed in."""

STALL_S = 30.0
"""So long an answer may wait without a single byte being taken."""

PLACE = "place"
"""Key of the connection's place in the ``state`` of a request's scope."""

ALL_PLACES = "places"
"""Key of the account of all places, there too."""

READING = "reading"
"""Key of what has the bytes of all connections parsed in turn, there too."""

TOO_MUCH = 1008
"""Code with which a websocket is closed that sends more than its budget: a policy was violated."""

POLL_S = 0.005
"""Time [s] after which a connection is looked at again whose application has not taken yet what was parsed."""


def body_s(path: str) -> float:
    """Return how long the body of a request to an address may take [s]: all have to come equally fast."""
    asked = SHEETS if path.endswith(SHEETS) else path  # a proxy may have left its prefix before it
    return BODY_S * body_limit(asked) / MAX_BODY_BYTES


class _LimitedProtocol(asyncio.Protocol):
    """Gives the place back at the end, and ends a connection that takes nothing of what it asked for.

    What it receives waits in ``_unread`` until it is its turn to be parsed, ``PIECE`` bytes at a time. Comes before
    uvicorn's protocol in the order of classes.
    """

    PIECE = LONGEST_HEAD
    _unread: bytearray
    _is_full = False

    transport: asyncio.Transport
    loop: asyncio.AbstractEventLoop
    app_state: dict[str, Any]
    _stalled: asyncio.TimerHandle | None = None

    @property
    def place(self) -> ConnectionSlot:
        """Where this connection stands."""
        place: ConnectionSlot = self.app_state[PLACE]
        return place

    @property
    def places(self) -> ConnectionLimiter:
        """The account of all places."""
        places: ConnectionLimiter = self.app_state[ALL_PLACES]
        return places

    def end(self) -> None:
        """Close at once; what was not sent is lost."""
        self.transport.abort()

    def connection_lost(self, exc: Exception | None) -> None:
        """Give the place back."""
        self.places.leave(self.place)
        self._unset_stall()
        super().connection_lost(exc)

    def data_received(self, data: bytes) -> None:
        """Keep what has come, until it is this connection's turn to have it parsed."""
        self._unread += data
        if len(self._unread) > MOST_UNREAD and not self.transport.is_closing():
            self._is_full = True
            self.transport.pause_reading()
        reading: ReadScheduler = self.app_state[READING]
        reading.add(self)

    def parse_piece(self) -> float | None:
        """Parse the next piece; return after how long [s] the next one is parsed, None when there is none."""
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
        # A pause is kept where nothing more has come yet, too: what comes next is parsed after it.
        return pause_s if self._unread or pause_s > 0.0 else None

    def parse(self, piece: bytes) -> float:
        """Hand a piece to uvicorn; return after how long [s] the next one may be parsed."""
        raise NotImplementedError

    def _is_waiting_for_app(self) -> bool:
        """Tell whether the application has not taken yet what was parsed: uvicorn reads no further then."""
        raise NotImplementedError

    def pause_writing(self) -> None:
        """Begin to watch whether anything is taken."""
        super().pause_writing()
        self._watch_writing()

    def resume_writing(self) -> None:
        """All but a little was taken."""
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
    """What a connection is waited for."""

    HEAD = auto()
    BODY = auto()
    REST = auto()
    NOTHING = auto()


class HttpProtocol(_LimitedProtocol, H11Protocol):
    """HTTP/1.1 on a connection that has a place."""

    def __init__(
        self,
        places: ConnectionLimiter,
        place: ConnectionSlot,
        reading: ReadScheduler,
        config: Config,
        server_state: ServerState,
    ) -> None:
        super().__init__(config, server_state, {ALL_PLACES: places, PLACE: place, READING: reading})
        self._unread = bytearray()
        self._waits_for = _Wait.NOTHING
        self._patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as in uvicorn
        """Take over the place, and what was said already."""
        super().connection_made(transport)
        self.place.end = self.end
        self.place.is_answered = lambda: bool(self.place.first_words) or self._find_wait() is _Wait.NOTHING
        self._watch()
        # Not at once: until this returns the transport cannot be told to pause.
        self.loop.call_soon(self._take_first_words)

    def connection_lost(self, exc: Exception | None) -> None:
        """Wait for nothing more."""
        self._unset_patience()
        super().connection_lost(exc)

    def parse(self, piece: bytes) -> float:
        """Take the next bytes; the time that is left goes on, unless they end what was waited for.

        They come in pieces, so that a head that is too long is refused by its length, before its lines are looked at.
        """
        H11Protocol.data_received(self, piece)
        self._watch()
        return 0.0

    def _is_waiting_for_app(self) -> bool:
        return self.flow is not None and self.flow.read_paused

    def on_response_complete(self) -> None:
        """Keep the connection for the next request."""
        self.timeout_keep_alive = int(AUTHENTICATED_PAUSE_S if self.place.costs else ANONYMOUS_PAUSE_S)
        super().on_response_complete()
        self._watch()

    def handle_websocket_upgrade(self, event: h11.Request) -> None:
        """Hand over to the other protocol, which has its own times."""
        if len(event.headers) > MOST_HEADERS:  # the other protocol would close without an answer
            self._refuse_head()
            return
        self._unset_patience()
        self._unset_stall()
        super().handle_websocket_upgrade(event)

    def send_400_response(self, msg: str) -> None:
        """Answer what is no HTTP, and a head that is too long, with the headers that every answer has."""
        if self._find_wait() is _Wait.HEAD and len(self.conn.trailing_data[0]) > LONGEST_HEAD:
            self._refuse_head()
        else:
            self._refuse(400, "Bad Request", msg)

    def _refuse_head(self) -> None:
        self._refuse(431, "Request Header Fields Too Large", too_large_a_head())

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
            self.cycle.disconnected = True  # a request whose body went wrong: its route's own answer goes nowhere
            self.cycle.message_event.set()
        self.transport.close()

    def _take_first_words(self) -> None:
        words, self.place.first_words = self.place.first_words, b""
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
    """A websocket on a connection that has a place."""

    PIECE = PIECE

    def __init__(self, config: Config, server_state: ServerState, app_state: dict[str, Any]) -> None:
        super().__init__(config, server_state, app_state)
        self.conn = self._counted = _Handshake(max_size=config.ws_max_size, logger=self.logger)
        self._unread = bytearray()
        self._budget = Budget(self.loop.time())
        self.place.end = self.end
        self.place.is_answered = lambda: True

    def parse(self, piece: bytes) -> float:
        """Parse frames within the budget; a connection that wants more for too long is closed, and the log says so."""
        before = self._counted.frames
        if not self.handshake_initiated:  # the head of the request, which was counted as one
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
        holder = self.place.holder
        _log.warning(
            "The service closed a websocket of %s (%s): for %g s it sent more than %g frames or %g bytes in a second.",
            "somebody not signed in" if holder is None else holder.name,
            self.client[0] if self.client else "unknown address",
            PATIENCE_S,
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
        """Send; a handshake that was refused with an answer of its own is complete, which uvicorn does not note."""
        await super().send(message)
        if self.initial_response is not None and self.close_sent:
            self.handshake_complete = True


class _WholeLines(StreamReader):
    """Takes lines of any length: the head was bounded when it was read as that of a request."""

    def read_line(self, m: int) -> Generator[None, None, bytearray]:
        """Return the next line."""
        return (yield from super().read_line(2 * LONGEST_HEAD))


class _Handshake(ServerProtocol):
    """Takes the heads that other requests may have, and refuses with the headers that every answer has."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.frames = 0
        self.reader = _WholeLines()
        self.parser = self.parse()
        next(self.parser)  # begins to read, as the first one did

    def events_received(self) -> list[Event]:
        """Return what was parsed, and count it."""
        events = super().events_received()
        self.frames += len(events)
        return events

    def reject(self, status: int, text: str) -> Response:
        response = super().reject(status, text)
        response.headers.update(HEADERS)
        return response


# Request turns -------------------------------------------------------------------------------------
#
# One request after the other, so that STOP waits for the one under way and not for all of a
# crowd's.
#
# The event loop goes through all that is ready before it looks at what has come. Two dozen busy
# pages at once make such a round a tenth of a second long, and an answer takes several rounds.


PASSES_BY = "/api/stop"


class RequestSchedulingMiddleware:
    """ASGI middleware that lets one request of operators and one of all others begin in each round.

    STOP begins at once. Among operators, as among the others, who came first begins first.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._operators: deque[asyncio.Future[None]] = deque()
        self._others: deque[asyncio.Future[None]] = deque()
        self._has_begun = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on in turn."""
        if scope["type"] in ("http", "websocket") and scope["path"] != PASSES_BY:
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
        if turn.done():  # cancelled: whoever waited is gone
            return False
        turn.set_result(None)
        self._has_begun = True
        return True


def _is_operator(scope: Scope) -> bool:
    place = scope.get("state", {}).get(PLACE)
    return place is not None and place.holder is not None and place.holder.role is Role.OPERATOR
