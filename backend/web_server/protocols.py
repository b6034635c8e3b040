"""uvicorn's two protocols with a place for each connection and an end to every wait.

A request's head, its body, the pause until the next request, and an answer that nobody reads: each has its time.
"""

import asyncio
import logging
from collections.abc import Generator
from enum import Enum, auto
from typing import Any

import h11
from uvicorn.config import Config
from uvicorn.protocols.http.h11_impl import H11Protocol
from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from uvicorn.server import ServerState
from websockets.http11 import Response
from websockets.protocol import Event
from websockets.server import ServerProtocol
from websockets.streams import StreamReader

from backend.web_server.guard import (
    HEADERS,
    LONGEST_HEAD,
    MAX_BODY_BYTES,
    MOST_HEADERS,
    SHEETS,
    most_bytes,
    too_large_a_head,
)
from backend.web_server.places import Place, Places
from backend.web_server.reading import (
    BYTES_PER_S,
    FRAMES_PER_S,
    MOST_UNREAD,
    PATIENCE_S,
    PIECE,
    Budget,
    Reading,
)

HEAD_S = 10.0
"""So long the head of a request may take, from its first byte or the connection's beginning."""

BODY_S = 10.0
"""So long a body of ``MAX_BODY_BYTES`` may take; where larger ones are taken, as much longer as they may be larger."""

REST_S = 10.0
"""So long the rest of a body is taken that the answer did not wait for, so that the answer is read."""

GUEST_PAUSE_S, KNOWN_PAUSE_S = 5.0, 60.0
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

LOOK_S = 0.005
"""Time [s] after which a connection is looked at again whose application has not taken yet what was parsed."""

_log = logging.getLogger(__name__)


def body_s(path: str) -> float:
    """Return how long the body of a request to an address may take [s]: all have to come equally fast."""
    asked = SHEETS if path.endswith(SHEETS) else path  # a proxy may have left its prefix before it
    return BODY_S * most_bytes(asked) / MAX_BODY_BYTES


class _Placed(asyncio.Protocol):
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
    def place(self) -> Place:
        """Where this connection stands."""
        place: Place = self.app_state[PLACE]
        return place

    @property
    def places(self) -> Places:
        """The account of all places."""
        places: Places = self.app_state[ALL_PLACES]
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
        reading: Reading = self.app_state[READING]
        reading.add(self)

    def parse_piece(self) -> float | None:
        """Parse the next piece; return after how long [s] the next one is parsed, None when there is none."""
        if self.transport.is_closing():
            self._unread.clear()
            return None
        if self._waits_for_app():
            return LOOK_S
        piece = bytes(self._unread[: self.PIECE])
        del self._unread[: len(piece)]
        pause_s = self.parse(piece) if piece else 0.0
        if self._is_full and len(self._unread) <= MOST_UNREAD:
            self._is_full = False
            if not self.transport.is_closing() and not self._waits_for_app():
                self.transport.resume_reading()
        # A pause is kept where nothing more has come yet, too: what comes next is parsed after it.
        return pause_s if self._unread or pause_s > 0.0 else None

    def parse(self, piece: bytes) -> float:
        """Hand a piece to uvicorn; return after how long [s] the next one may be parsed."""
        raise NotImplementedError

    def _waits_for_app(self) -> bool:
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
        self._stalled = self.loop.call_later(STALL_S, self._look_at_writing, waiting)

    def _look_at_writing(self, waiting: int) -> None:
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


class HttpProtocol(_Placed, H11Protocol):
    """HTTP/1.1 on a connection that has a place."""

    def __init__(
        self, places: Places, place: Place, reading: Reading, config: Config, server_state: ServerState
    ) -> None:
        super().__init__(config, server_state, {ALL_PLACES: places, PLACE: place, READING: reading})
        self._unread = bytearray()
        self._waits_for = _Wait.NOTHING
        self._patience: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override] # as in uvicorn
        """Take over the place, and what was said already."""
        super().connection_made(transport)
        self.place.end = self.end
        self.place.is_answered = lambda: bool(self.place.first_words) or self._waiting() is _Wait.NOTHING
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

    def _waits_for_app(self) -> bool:
        return self.flow is not None and self.flow.read_paused

    def on_response_complete(self) -> None:
        """Keep the connection for the next request."""
        self.timeout_keep_alive = int(KNOWN_PAUSE_S if self.place.costs else GUEST_PAUSE_S)
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
        if self._waiting() is _Wait.HEAD and len(self.conn.trailing_data[0]) > LONGEST_HEAD:
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

    def _waiting(self) -> _Wait:
        cycle: Any = self.cycle  # None before the first request, which uvicorn does not declare
        if cycle is None:
            return _Wait.HEAD
        if not cycle.response_complete:
            return _Wait.BODY if cycle.more_body else _Wait.NOTHING
        return _Wait.REST if self.conn.their_state is h11.SEND_BODY else _Wait.HEAD

    def _body_s(self) -> float:
        return body_s(self.cycle.scope["path"]) if self.cycle else BODY_S

    def _watch(self) -> None:
        waits_for = self._waiting()
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


class SocketProtocol(_Placed, WebSocketsSansIOProtocol):
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
            "a websocket of %s (%s) was closed: for %g s it sent more than %g frames or %g bytes in a second",
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

    def _waits_for_app(self) -> bool:
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
