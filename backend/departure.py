"""Work that ends when whoever asked for it leaves, so that nobody keeps a process busy whom nobody waits for."""

import asyncio
from collections.abc import Awaitable, Callable, Coroutine
from typing import Any, TypeVar

from backend.errors import Because, RefusalError

T = TypeVar("T")

HasLeft = Callable[[], Awaitable[bool]]
"""Tells whether the connection of whoever asked is closed."""

LOOK_S = 0.5


async def unless_left(work: Coroutine[Any, Any, T], has_left: HasLeft) -> T:
    """Return what ``work`` returns; cancel it when whoever waits for it has left.

    Work in a process beside the service ends with that process. Raises RefusalError after whoever asked has left.
    """
    working = asyncio.ensure_future(work)
    try:
        while not (await asyncio.wait({working}, timeout=LOOK_S))[0]:
            if await has_left():
                raise RefusalError(Because.UNAVAILABLE, "whoever asked for this has left: its computation was ended")
        return working.result()
    finally:
        working.cancel()
        await asyncio.gather(working, return_exceptions=True)
