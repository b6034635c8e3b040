"""What connections send is parsed in small pieces, in turn, and within a budget for each websocket.

asyncio hands over up to 256 kB at once: 40,000 empty frames, which take a second to parse, and STOP of somebody else
waits behind them. Here a piece of one connection is followed by one of the next, each round of the event loop spends a
few milliseconds on all of them, and a websocket that sends more than a page does is read more slowly, then closed.
"""

import asyncio
import logging
from collections import deque
from typing import Protocol

PIECE = 512
"""Bytes of a websocket that are parsed at once: at most 256 frames, in 2 ms."""

TURN_S = 0.002
"""So long [s] all connections together are parsed in a round of the event loop."""

MOST_UNREAD = 64 * 1024
"""Bytes that wait to be parsed; a connection with more is not read until some are."""

FRAMES_PER_S, FRAMES_AT_ONCE = 100.0, 400.0
"""Frames of a websocket, in the long run and at once: a page sends one in a second, the 3D view some in a drag."""

BYTES_PER_S, BYTES_AT_ONCE = 64.0 * 1024, 2.0 * 1024 * 1024
"""Bytes of a websocket, in the long run and at once."""

PATIENCE_S = 5.0
"""A websocket that wants more than its budget for so long [s] is closed."""


_log = logging.getLogger(__name__)


class Connection(Protocol):
    """What sends."""

    def parse_piece(self) -> float | None:
        """Parse the next piece; return after how long [s] the next one is parsed, None when there is none."""

    def end(self) -> None:
        """Close at once."""


class Reading:
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
        until = self._loop.time() + TURN_S
        while self._waiting:
            connection = self._waiting.popleft()
            pause_s = _parsed(connection)
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


def _parsed(connection: Connection) -> float | None:
    try:
        return connection.parse_piece()
    except Exception:
        _log.exception("a connection is closed, as what it sent could not be parsed")
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
