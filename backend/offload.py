"""A process beside the service for what takes long: the live stream does not stutter while it computes.

The process may die (killed for memory, by a person, by what it computes): that is told at once, the next work starts
another one, and the work that it died over is done once more.

Imports nothing of the project, so that the process loads only what its work needs.
"""

import asyncio
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from functools import partial
from importlib import import_module
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

POLITE = 10
"""Niceness of work that nobody at the bench waits for: the loop, the recorder and the stream come first."""


class WorkerDiedError(Exception):
    """The process died over a work, and the one after it too."""


class Offload:
    """One process of a ``niceness``, started by the first work; works one after the other.

    ``died`` is called with a cause when the process dies without having been ended. Belongs to one event loop.
    """

    def __init__(self, died: Callable[[str], object], niceness: int = POLITE) -> None:
        self._died = died
        self._niceness = niceness
        self._worker: _Worker | None = None
        self._turn = asyncio.Lock()
        self._closed = False

    async def run(self, work: Callable[P, T], *arguments: P.args, **_none: P.kwargs) -> T:
        """Return ``work(*arguments)``, computed in the process; both must be picklable.

        One that is cancelled meanwhile ends the process: nobody waits for the result. Work that its process dies over
        is done again, so that it may be done twice, never halfway. Raises WorkerDiedError the second time.
        """
        async with self._turn:
            for _ in range(2):
                worker = self._present()
                try:
                    return await asyncio.wrap_future(worker.pool.submit(partial(work, *arguments)))
                except BrokenProcessPool:
                    if self._closed:
                        raise
                    self._gone(worker)
                except asyncio.CancelledError:
                    self._end(worker)
                    raise
        raise WorkerDiedError(
            "the process that computes this died over it twice: look whether the machine is short of memory"
        )

    def prepare(self, work: Callable[..., object], *libraries: str) -> None:
        """Start the process and let it load what ``work`` needs, without waiting for it or for what becomes of it.

        ``libraries`` are modules that ``work`` imports only when it runs.
        """
        with suppress(BrokenProcessPool):
            self._present().pool.submit(_load, work, libraries)

    def begin(self, work: Callable[P, object], *arguments: P.args, **_none: P.kwargs) -> None:
        """Start the process, unless there is one, and let it do ``work`` first; nobody hears what becomes of that."""
        if self._worker is None and not self._closed:
            with suppress(BrokenProcessPool):
                self._present().pool.submit(partial(work, *arguments))

    def close(self) -> None:
        """End the process, whatever it works on: it stores whole or nothing."""
        self._closed = True
        if self._worker is not None:
            self._end(self._worker)

    def _present(self) -> "_Worker":
        if self._worker is None:
            self._worker = _Worker(self._niceness, self._gone)
        return self._worker

    def _gone(self, worker: "_Worker") -> None:
        """Forget a worker whose process has died; what is asked next starts another one."""
        if self._worker is worker:
            self._worker = None
            worker.forget()
            self._died("its process was killed, or ended by itself")

    def _end(self, worker: "_Worker") -> None:
        if self._worker is worker:
            self._worker = None
        worker.end()


class _Worker:
    """A pool of one process, whose number is the first thing that it is asked for; ``gone`` is called when it dies."""

    def __init__(self, niceness: int, gone: Callable[["_Worker"], None]) -> None:
        self.pool = ProcessPoolExecutor(1, multiprocessing.get_context("spawn"), begin_beside, (niceness,))
        self._loop = asyncio.get_running_loop()
        self._gone = gone
        self._process: int | None = None
        self._ended = False
        self.pool.submit(os.getpid).add_done_callback(self._there)

    def end(self) -> None:
        """Kill the process, as soon as it is there, and watch it no longer."""
        self._let_go(cancel=True)

    def forget(self) -> None:
        """Let go of a process that has died: what waited for it is told so by the pool, and not cancelled."""
        self._let_go(cancel=False)

    def _let_go(self, *, cancel: bool) -> None:
        self._ended = True  # first: whoever hears of the process from now on kills it
        self.pool.shutdown(wait=False, cancel_futures=cancel)
        if self._process is not None:
            self._loop.remove_reader(self._process)
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._process, signal.SIGKILL)
            os.close(self._process)
            self._process = None

    def _there(self, pid: Future[int]) -> None:
        """Hear of the process, in a thread of the pool."""
        if self._ended:
            with suppress(BrokenProcessPool, CancelledError, ProcessLookupError):
                os.kill(pid.result(), signal.SIGKILL)
        else:
            with suppress(RuntimeError):  # the event loop may be closed by now
                self._loop.call_soon_threadsafe(self._watch, pid)

    def _watch(self, pid: Future[int]) -> None:
        try:
            self._process = os.pidfd_open(pid.result())
        except (BrokenProcessPool, CancelledError, ProcessLookupError):
            self._gone(self)
            return
        self._loop.add_reader(self._process, self._gone, self)
        if self._ended:  # meanwhile
            self.end()


def _load(_work: Callable[..., object], libraries: tuple[str, ...]) -> None:
    """Import the libraries; unpickling ``_work`` has loaded its module."""
    for library in libraries:
        import_module(library)


def begin_beside(niceness: int) -> None:
    """Begin a process that works for another one, and gives way to others.

    Ctrl+C and the end of the terminal, which reach all processes, are left to that one. End when it dies without
    telling, as nobody else would.
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
