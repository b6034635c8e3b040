"""Worker processes of the service, with limits of time and memory."""

import asyncio
import multiprocessing
import os
import resource
import signal
import sys
import threading
from collections.abc import AsyncGenerator, Callable, Iterable
from concurrent.futures import CancelledError, Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnContext
from multiprocessing.process import BaseProcess
from pathlib import Path
from traceback import format_exc
from typing import Any, NamedTuple, ParamSpec, TypeVar

from backend import messages
from backend.supervision import Part, Supervision
from plant import ErrorCode, SinewError

# Start of processes --------------------------------------------------------------------------------
# The service never forks: the copy would keep its lock, its database and its sockets open after the
# service has ended. Spawned processes do not import from the working directory, where a file may
# have the name of a module.


SAFE_PATH = "PYTHONSAFEPATH"
"""Variable that excludes the working directory from imports, as option -P does."""


class ForkForbiddenError(SinewError):
    """Code of this process called fork."""


def exclude_working_directory() -> None:
    """Keep all later child processes from importing from the working directory.

    Uses the environment, which children inherit: multiprocessing has no option for its processes and its resource
    tracker.
    """
    os.environ[SAFE_PATH] = "1"


def get_spawn_context() -> SpawnContext:
    """Return the context that spawns processes, without the working directory."""
    exclude_working_directory()
    return multiprocessing.get_context("spawn")


def forbid_forks() -> None:
    """Make every fork of this process raise ForkForbiddenError, permanently.

    New programs can still be started, as all descriptors close on exec: subprocesses, and processes of
    ``multiprocessing``, which are spawned unless a fork is requested by name.
    """
    exclude_working_directory()
    multiprocessing.set_start_method("spawn", force=True)
    sys.addaudithook(_reject_fork)


def _reject_fork(event: str, _arguments: object) -> None:
    if event in ("os.fork", "os.forkpty"):
        raise ForkForbiddenError(
            "the service does not fork: the child process would keep its lock, database and sockets open"
        )


# Libraries -----------------------------------------------------------------------------------------
# Libraries that take seconds to load and that the start does not need. Code that computes with them
# imports them where it does. The service loads them after its start (``backend.main``), so that the
# first request does not wait; a worker process loads those of its work.


NUMERIC_LIBRARIES = ("scipy.fft", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.stats", "control")
DRAWING_LIBRARIES = ("scipy.signal", "matplotlib.figure", "typst")
TABLE_LIBRARIES = ("scipy.io", "pyarrow.csv", "pyarrow.parquet")


def import_modules(*names: str) -> None:
    """Import modules in this order."""
    for name in names:
        import_module(name)


# Worker process ------------------------------------------------------------------------------------
# Long computations run in a process of their own, so that the live stream is not delayed. When the
# process dies, this is reported at once, the interrupted work is repeated once, and the next work
# starts a new process. Work beyond its limit of time or memory is killed and not repeated.
#
# This module imports few modules of the project, because each worker process imports it.


P = ParamSpec("P")
T = TypeVar("T")

BACKGROUND_NICENESS = 10
"""Niceness of work that nobody at the rig waits for.

Control loop, recorder and live stream come first.
"""


_OUT_OF_MEMORY_EXIT_CODES = (-signal.SIGABRT, -signal.SIGSEGV)
"""Exit codes of processes whose libraries abort when an allocation fails."""

_EXIT_TIMEOUT_S = 5.0
"""Longest time from the closed pipes of a dying process to its exit code [s]."""

_EXIT_POLL_S = 0.01


class WorkerDiedError(SinewError):
    """The worker process died twice during the same work."""

    category = ErrorCode.UNAVAILABLE


@dataclass(frozen=True)
class WorkLimits:
    """Limits of one work; the start of the process and imports do not count."""

    limit_s: float | None = None
    """Time [s]; None: no limit."""

    memory_bytes: int | None = None
    """Memory beyond the loaded modules [bytes]; None: no limit."""

    remedy: str = "request less"
    """What the user can change to stay within the limits."""

    libraries: tuple[str, ...] = ()
    """Modules that the work imports only when it runs; they are imported before the limits apply."""


class WorkLimitError(SinewError):
    """A work exceeded its limit of ``quantity`` [``unit``] and was killed.

    ``bound`` is None where the memory of the machine was the limit.
    """

    category = ErrorCode.BAD_VALUE

    def __init__(self, quantity: str, bound: float | None, unit: str, remedy: str) -> None:
        self.quantity, self.bound, self.unit, self.remedy = quantity, bound, unit, remedy
        super().__init__(messages.work_limit_exceeded(quantity=quantity, maximum=bound, unit=unit, remedy=remedy))

    @property
    def fields(self) -> dict[str, Any]:
        """Fields of the error response: code, and the limit with its unit."""
        return {"code": "work_limit", "quantity": self.quantity, "maximum": self.bound, "unit": self.unit}

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle the error by the arguments of its constructor."""
        return type(self), (self.quantity, self.bound, self.unit, self.remedy)


class WorkerProcess:
    """One worker process that runs works one after the other within limits.

    The first work starts the process. ``on_death`` is called with a cause when the process dies unexpectedly. Belongs
    to one event loop.
    """

    def __init__(
        self, on_death: Callable[[str], object], niceness: int = BACKGROUND_NICENESS, limits: WorkLimits | None = None
    ) -> None:
        self._on_death = on_death
        self._niceness = niceness
        self._limits = limits or WorkLimits()
        self._pool: _SingleProcessPool | None = None
        self._lock = asyncio.Lock()
        self._closed = False

    async def run(self, work: Callable[P, T], *arguments: P.args, **_none: P.kwargs) -> T:
        """Return ``work(*arguments)``, computed in the process; both must be picklable.

        Cancelling this coroutine kills the process. Work during which the process dies is repeated once, so it may run
        twice, but never incompletely. Raises WorkerDiedError if the process dies again, and WorkLimitError for work
        beyond the limits.
        """
        async with self._lock:
            for _ in range(2):
                pool = self._get_pool()
                try:
                    return await self._run_limited(pool, work, *arguments, **_none)
                except BrokenProcessPool:
                    if self._closed:
                        raise
                    self._on_exit(pool)
                    if self._limits.memory_bytes is not None and await pool.exit_code() in _OUT_OF_MEMORY_EXIT_CODES:
                        raise self._memory_error() from None
                except MemoryError:  # the state of the process is unknown
                    self._end(pool)
                    raise self._memory_error() from None
                except asyncio.CancelledError:
                    self._end(pool)
                    raise
        raise WorkerDiedError(messages.worker_died_twice())

    async def _run_limited(
        self, pool: "_SingleProcessPool", work: Callable[P, T], *arguments: P.args, **_none: P.kwargs
    ) -> T:
        limits = self._limits
        await asyncio.wrap_future(pool.executor.submit(_import_libraries, work, limits.libraries))
        if limits.memory_bytes is not None and not pool.is_limited:
            await asyncio.wrap_future(pool.executor.submit(_limit_memory, limits.memory_bytes))
            pool.is_limited = True
        working = asyncio.wrap_future(pool.executor.submit(partial(_run_work, work, *arguments)))
        try:
            done, _ = await asyncio.wait({working}, timeout=limits.limit_s)
        finally:
            if not working.done():  # nobody awaits its result
                working.cancel()
        if not done:
            self._end(pool)
            raise WorkLimitError("computing time", limits.limit_s, "s", limits.remedy)
        result = working.result()
        if isinstance(result, _RaisedError):
            raise result.rebuild()
        return result

    def _memory_error(self) -> WorkLimitError:
        most = self._limits.memory_bytes
        return WorkLimitError("memory", None if most is None else most / 1e6, "MB", self._limits.remedy)

    def preload(self, work: Callable[..., object], *libraries: str) -> None:
        """Start the process and let it import what ``work`` needs, without waiting.

        ``libraries`` are modules that ``work`` imports only when it runs. Errors are ignored.
        """
        with suppress(BrokenProcessPool):
            self._get_pool().executor.submit(_import_libraries, work, libraries)

    def warm_up(self, work: Callable[P, object], *arguments: P.args, **_none: P.kwargs) -> None:
        """Start the process, unless it runs, with ``work`` as its first work.

        Does not wait; errors are ignored.
        """
        if self._pool is None and not self._closed:
            with suppress(BrokenProcessPool):
                self._get_pool().executor.submit(partial(work, *arguments))

    def close(self) -> None:
        """Kill the process, whatever it computes: works store their result atomically."""
        self._closed = True
        if self._pool is not None:
            self._end(self._pool)

    def _get_pool(self) -> "_SingleProcessPool":
        if self._pool is None:
            self._pool = _SingleProcessPool(self._niceness, self._on_exit)
        return self._pool

    def _on_exit(self, pool: "_SingleProcessPool") -> None:
        """Release a process that has died; the next work starts another one."""
        if self._pool is pool:
            self._pool = None
            pool.release()
            self._on_death("its process was killed or exited")

    def _end(self, pool: "_SingleProcessPool") -> None:
        if self._pool is pool:
            self._pool = None
        pool.end()


class _SingleProcessPool:
    """A pool of one process; ``on_exit`` is called when the process dies.

    The first task of the process returns its PID, by which the event loop watches it.
    """

    def __init__(self, niceness: int, on_exit: Callable[["_SingleProcessPool"], None]) -> None:
        self.executor = ProcessPoolExecutor(1, get_spawn_context(), initialize_worker, (niceness,))
        self._loop = asyncio.get_running_loop()
        self._on_exit = on_exit
        self._pidfd: int | None = None
        self._child: BaseProcess | None = None
        self._ended = False
        self.is_limited = False
        self.executor.submit(os.getpid).add_done_callback(self._on_pid)

    async def exit_code(self) -> int | None:
        """Return the exit code of the dead process, None if unknown.

        Negative values are signal numbers.
        """
        if self._child is None:
            return None
        await asyncio.to_thread(self._child.join, _EXIT_TIMEOUT_S)  # its pipes are closed a little before it has ended
        # The pool's thread waits for the same process: it may have the status and not have noted it yet.
        end = self._loop.time() + _EXIT_TIMEOUT_S
        while (code := self._child.exitcode) is None and self._loop.time() < end:
            await asyncio.sleep(_EXIT_POLL_S)
        return code

    def end(self) -> None:
        """Kill the process, once it runs, and stop watching it."""
        self._release(cancel=True)

    def release(self) -> None:
        """Release a dead process; its pending works raise BrokenProcessPool."""
        self._release(cancel=False)

    def _release(self, *, cancel: bool) -> None:
        self._ended = True  # first, so that _on_pid kills a process that starts now
        self.executor.shutdown(wait=False, cancel_futures=cancel)
        if self._pidfd is not None:
            self._loop.remove_reader(self._pidfd)
            with suppress(ProcessLookupError):
                signal.pidfd_send_signal(self._pidfd, signal.SIGKILL)
            os.close(self._pidfd)
            self._pidfd = None

    def _on_pid(self, pid: Future[int]) -> None:
        """Receive the PID of the process, in a thread of the pool."""
        if self._ended:
            with suppress(BrokenProcessPool, CancelledError, ProcessLookupError):
                os.kill(pid.result(), signal.SIGKILL)
        else:
            with suppress(RuntimeError):  # the event loop may be closed by now
                self._loop.call_soon_threadsafe(self._watch, pid)

    def _watch(self, pid: Future[int]) -> None:
        try:
            self._pidfd = os.pidfd_open(pid.result())
        except (BrokenProcessPool, CancelledError, ProcessLookupError):
            self._on_exit(self)
            return
        number = pid.result()
        self._child = next((child for child in multiprocessing.active_children() if child.pid == number), None)
        self._loop.add_reader(self._pidfd, self._on_exit, self)
        if self._ended:  # since the PID was received
            self.end()


class _RaisedError(NamedTuple):
    """An exception of the work in parts.

    Unpickling an exception calls its class with the message alone, which fails for classes with further arguments.
    """

    kind: type[Exception]
    arguments: tuple[Any, ...]
    fields: dict[str, Any]

    def rebuild(self) -> Exception:
        """Return the exception with its message, attributes and notes."""
        error = self.kind.__new__(self.kind)
        error.args = self.arguments
        error.__dict__.update(self.fields)
        return error


def _run_work(work: Callable[P, T], *arguments: P.args, **_none: P.kwargs) -> T | _RaisedError:
    """Return the result of ``work``, or the exception that it raises, in parts."""
    try:
        return work(*arguments, **_none)
    except MemoryError:
        raise
    except Exception as error:
        error.add_note(format_exc())
        return _RaisedError(type(error), error.args, dict(error.__dict__))


def _import_libraries(_work: Callable[..., object], libraries: tuple[str, ...]) -> None:
    """Import the libraries; unpickling ``_work`` has imported its module."""
    for library in libraries:
        import_module(library)


def _limit_memory(memory_bytes: int) -> None:
    """Limit the memory of this process to its present size plus ``memory_bytes``.

    The limit counts writable memory (RLIMIT_DATA): address space (RLIMIT_AS) would include what each thread's heap
    only reserves, 64 MB a core and more.
    """
    data_pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
    most = data_pages * resource.getpagesize() + memory_bytes
    resource.setrlimit(resource.RLIMIT_DATA, (most, resource.getrlimit(resource.RLIMIT_DATA)[1]))


def initialize_worker(niceness: int) -> None:
    """Set priority and signals of this worker process, and end it with its parent.

    Ctrl+C and the end of the terminal reach all processes; the parent alone reacts to them.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    os.setpriority(os.PRIO_PROCESS, 0, niceness)
    parent = multiprocessing.parent_process()

    def exit_with_parent() -> None:
        if parent is not None:
            parent.join()
            os._exit(1)

    threading.Thread(target=exit_with_parent, daemon=True).start()


# Streams -------------------------------------------------------------------------------------------
# Results that are too large for memory are passed on in chunks. Each stream has a process of its
# own, which waits for a slow reader and is killed when the reader stops.


_CHUNK_BYTES = 1 << 20


async def stream_from_process(
    work: Callable[P, Iterable[bytes]], *arguments: P.args, **_none: P.kwargs
) -> AsyncGenerator[bytes]:
    """Yield the chunks of ``work(*arguments)``; both must be picklable.

    Raises the exception of the work, and WorkerDiedError when its process dies.
    """
    receiver, sender = multiprocessing.Pipe(duplex=False)
    process = get_spawn_context().Process(target=_send_chunks, args=(sender, work, arguments), daemon=True)
    loop, thread = (
        asyncio.get_running_loop(),
        ThreadPoolExecutor(1, "stream_from_process"),
    )  # the event loop's own threads are for short work
    try:
        await loop.run_in_executor(thread, process.start)
        sender.close()  # otherwise the receiver would not notice the end of the process
        while (chunk := await loop.run_in_executor(thread, _receive_chunk, receiver)) is not None:
            yield chunk
    finally:
        _kill_process(process)  # also ends a pending _receive_chunk in the thread
        await asyncio.shield(loop.run_in_executor(thread, _stop_process, process))
        thread.shutdown(wait=False)
        sender.close()
        receiver.close()


def _receive_chunk(connection: Connection) -> bytes | None:
    """Wait for the next chunk; None at the end.

    Raises the exception of the work, and WorkerDiedError.
    """
    try:
        received: bytes | Exception | None = connection.recv()
    except (EOFError, OSError):
        raise WorkerDiedError(messages.writer_of_file_died()) from None
    if isinstance(received, Exception):
        raise received
    return received


def _kill_process(process: BaseProcess) -> None:
    if process.pid is not None:
        process.kill()


def _stop_process(process: BaseProcess) -> None:
    """Kill a process and wait for its end, if it was started."""
    _kill_process(process)
    if process.pid is not None:
        process.join()


def _send_chunks(connection: Connection, work: Callable[..., Iterable[bytes]], arguments: tuple[object, ...]) -> None:
    initialize_worker(BACKGROUND_NICENESS)
    try:
        for chunk in work(*arguments):
            for begin in range(0, len(chunk), _CHUNK_BYTES):
                connection.send(chunk[begin : begin + _CHUNK_BYTES])
        connection.send(None)
    except BrokenPipeError:  # the reader has stopped
        pass
    except Exception as error:
        connection.send(error)


# Worker processes of the service -------------------------------------------------------------------
# One process for each kind of work that must not wait for the others. In the service their
# computations would hold the interpreter lock for longer than the loop waits for a heartbeat. Work
# whose cost depends on a person's input has limits of time and memory.


_RETRY_NOTE = "The service repeats the interrupted computation once."

DRY_RUN_LIMITS = WorkLimits(600.0, 4_000_000_000, "run a shorter experiment, or run it with `sinew experiment`")
"""Limits of a dry run; ten minutes of motion take about one minute."""

TEXT_LIMITS = WorkLimits(30.0, 1_000_000_000, "shorten the text, or split it", NUMERIC_LIBRARIES)
"""Limits of the check of a text; an accepted one takes about a second."""

SHEET_LIMITS = WorkLimits(60.0, 1_000_000_000, "show fewer curves, or shorten the texts", ("typst",))
"""Limits of the PDF of a chart sheet; the largest takes about a second."""

REPORT_LIMITS = WorkLimits(1800.0, None, "report fewer runs, or shorter ones")
"""Limits of a report, or of the envelope of a long recording.

An hour at 1 kHz takes minutes.
"""

EVALUATION_LIMITS = WorkLimits(1800.0, None, "evaluate a shorter run")
"""Limits of the new evaluation of a stored run."""


class WorkerProcesses:
    """The worker processes of the service.

    ``computing`` serves what a person at the rig waits for; the others have lower priority, except ``texts``.
    ``texts`` and ``viewers_texts`` check texts of operators and viewers, ``evaluations`` evaluates stored runs again.
    ``studies`` starts further processes, one for each core but one.
    """

    def __init__(self, supervision: Supervision) -> None:
        def create_worker(
            works: str, niceness: int = BACKGROUND_NICENESS, limits: WorkLimits | None = None
        ) -> WorkerProcess:
            part = Part(f"The worker process for {works}", _RETRY_NOTE)
            return WorkerProcess(partial(supervision.record_failure, part), niceness, limits)

        self.computing = create_worker("results and banks", niceness=0)
        self.evaluations = create_worker("evaluations of stored runs", limits=EVALUATION_LIMITS)
        self.reports = create_worker("reports and exports", limits=REPORT_LIMITS)
        self.sheets = create_worker("chart sheets", limits=SHEET_LIMITS)
        self.dry_runs = create_worker("dry runs", limits=DRY_RUN_LIMITS)
        self.texts = create_worker("texts of operators", niceness=0, limits=TEXT_LIMITS)
        self.viewers_texts = create_worker("texts of viewers", limits=TEXT_LIMITS)
        self.studies = create_worker("studies")

    def close(self) -> None:
        """End all processes, whatever they compute."""
        for process in vars(self).values():
            process.close()
