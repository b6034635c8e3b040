"""A process beside the service for what takes long: the live stream does not stutter while it computes.

Imports nothing of the project, so that the process loads only what its work needs.
"""

import asyncio
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

POLITE = 10
"""Niceness of work that nobody at the bench waits for: the loop, the recorder and the stream come first."""


class Offload:
    """One process of a ``niceness``, started by the first work; works one after the other."""

    def __init__(self, niceness: int = POLITE) -> None:
        self._pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), _begin, (niceness,))

    async def run(self, work: Callable[P, T], *arguments: P.args, **_none: P.kwargs) -> T:
        """Return ``work(*arguments)``, computed in the process; both must be picklable."""
        return await asyncio.get_running_loop().run_in_executor(self._pool, work, *arguments)

    def prepare(self, work: Callable[..., object]) -> None:
        """Start the process and let it load what ``work`` needs, without waiting for it."""
        self._pool.submit(_load, work)

    def close(self) -> None:
        """End this and all other such processes of the service, whatever they work on: they store whole or nothing."""
        for process in multiprocessing.active_children():
            process.terminate()
        self._pool.shutdown(cancel_futures=True)


def _load(_work: Callable[..., object]) -> None:
    """Do nothing: unpickling the argument has loaded its module."""


def _begin(niceness: int) -> None:
    """Give way to others; leave Ctrl+C and the end of the terminal, which reach all processes, to the service.

    End when it dies without telling, as nobody else would.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    os.setpriority(os.PRIO_PROCESS, 0, niceness)
    parent = multiprocessing.parent_process()

    def wait() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=wait, daemon=True).start()
