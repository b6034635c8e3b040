"""Commands of one page, obeyed once each and in the order in which they were given.

A browser sends over several connections, so that a command may arrive before the one that was given before it. It
waits for that one: as long as a packet may be late, and until it has been answered. One that comes after its turn was
given away is refused, since what it asks for is older than what is in force.
"""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

from backend.errors import Because, RefusalError

GAP_S = 0.3
"""So long [s] a command waits for one before it that has not arrived."""

BUSY_S = 1.0
"""So long [s] a command waits for the answer to the one before it."""

WAITING = 32
"""So many commands of a page may wait."""

_LOOK_S = 0.05


class Turns:
    """The order of one page's commands, which it numbers 1, 2, 3 ..."""

    def __init__(self) -> None:
        self._obeyed = 0
        self._busy_since: float | None = None
        self._waiting: set[int] = set()
        self._changed = asyncio.Condition()

    @asynccontextmanager
    async def turn(self, number: int) -> AsyncIterator[None]:
        """Hold the turn of a command for the block. Raises RefusalError for an old one, 429 for too many."""
        if number <= self._obeyed or number in self._waiting:
            raise RefusalError(
                Because.NOT_NOW,
                "this command is older than one that was obeyed already: nothing done",
                code="stale_command",
            )
        if len(self._waiting) >= WAITING:
            raise RefusalError(
                Because.TOO_MANY,
                f"{WAITING} commands of this page wait already: nothing done",
                code="too_many_commands",
            )
        self._waiting.add(number)
        try:
            await self._wait(number)
        finally:
            self._waiting.discard(number)
        self._obeyed = number
        self._busy_since = begun = _now_s()
        try:
            yield
        finally:
            if self._busy_since == begun:
                self._busy_since = None
            async with self._changed:
                self._changed.notify_all()

    async def _wait(self, number: int) -> None:
        arrived_s = _now_s()
        async with self._changed:
            while not self._is_next(number, arrived_s):
                with suppress(TimeoutError):
                    async with asyncio.timeout(_LOOK_S):
                        await self._changed.wait()

    def _is_next(self, number: int, arrived_s: float) -> bool:
        now_s = _now_s()
        if number != min(self._waiting):
            return False
        if self._busy_since is not None and now_s - self._busy_since < BUSY_S:
            return False
        return number == self._obeyed + 1 or now_s - arrived_s >= GAP_S


def _now_s() -> float:
    return asyncio.get_running_loop().time()
