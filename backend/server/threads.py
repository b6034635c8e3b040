"""Threads of plain routes: those that only wait for the database.

Routes that command, publish, hold a lock or end with their connection are coroutines.
"""

from collections.abc import Callable
from functools import partial, wraps
from inspect import iscoroutinefunction
from typing import Any, ParamSpec, TypeVar

from anyio import CapacityLimiter, to_thread
from fastapi.routing import APIRoute

THREADS = 6
"""Most plain routes that run at a time; the files of the page are read in FastAPI's own threads. Each computing thread
may keep the GIL, and so delay STOP, for a moment."""

_P = ParamSpec("_P")
_T = TypeVar("_T")
_threads = CapacityLimiter(THREADS)


async def in_thread(work: Callable[_P, _T], *asked: _P.args, **named: _P.kwargs) -> _T:
    """Return ``work(*asked, **named)``, executed in a thread of plain routes."""
    return await to_thread.run_sync(partial(work, *asked, **named), limiter=_threads)


class ThreadRoute(APIRoute):
    """A route of the interface; a plain function runs in a thread."""

    def __init__(self, path: str, endpoint: Callable[..., Any], **settings: Any) -> None:
        super().__init__(path, endpoint if iscoroutinefunction(endpoint) else _in_threads(endpoint), **settings)


def _in_threads(endpoint: Callable[..., _T]) -> Callable[..., Any]:
    @wraps(endpoint)
    async def run(**asked: Any) -> _T:
        return await in_thread(endpoint, **asked)

    return run
