"""Worker processes beside the service: what they may load and take, and the results they hand back."""

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

from backend.supervision import Part, Supervision
from plant import ErrorCode, SinewError

# Forks ---------------------------------------------------------------------------------------------
#
# No process of ours is ever copied: a fork would hold the lock, the database and every socket, and
# outlive us.
#
# Processes that are started anew import nothing from the working directory, where a file may be
# called as a module is.


SAFE_PATH = "PYTHONSAFEPATH"
"""Variable that keeps Python from searching the working directory for modules, as -P does."""


class ForkRefusedError(SinewError):
    """Something tried to fork the process."""


def exclude_working_directory() -> None:
    """Let no Python process that this one starts import from the working directory; for good, and for theirs too.

    multiprocessing has no option for its processes and its tracker of resources: they take it from the environment.
    """
    os.environ[SAFE_PATH] = "1"


def spawning() -> SpawnContext:
    """Return the context whose processes are programs started anew, which import nothing from here."""
    exclude_working_directory()
    return multiprocessing.get_context("spawn")


def refuse_forks() -> None:
    """Let every fork of this process fail with ForkRefusedError, for good.

    New programs can still be started, as all descriptors of ours close on exec: subprocesses, and processes of
    ``multiprocessing``, which are spawned unless they ask for a fork by name.
    """
    exclude_working_directory()
    multiprocessing.set_start_method("spawn", force=True)
    sys.addaudithook(_refuse)


def _refuse(event: str, _arguments: object) -> None:
    if event in ("os.fork", "os.forkpty"):
        raise ForkRefusedError("the service does not fork: its lock, database and sockets would live on in the copy")


# Libraries -----------------------------------------------------------------------------------------
#
# The libraries that no start needs and that take seconds to load: whoever computes with one imports
# it where it does.
#
# The first curve waits for none of them. The service loads them behind it (``backend.main``), so
# that whoever asks first does not wait for that either; a process beside the service loads what its
# work will need.


SCIENCE = ("scipy.fft", "scipy.linalg", "scipy.optimize", "scipy.signal", "scipy.stats", "control")
DRAWING = ("scipy.signal", "matplotlib.figure", "typst")
TABLES = ("scipy.io", "pyarrow.csv", "pyarrow.parquet")


def load(*names: str) -> None:
    """Import these modules, in this order."""
    for name in names:
        import_module(name)


# Offload -------------------------------------------------------------------------------------------
#
# A process beside the service for what takes long: the live stream does not stutter while it
# computes.
#
# The process may die (killed for memory, by a person, by what it computes): that is told at once,
# the next work starts another one, and the work that it died over is done once more. Work that
# takes longer or more memory than its limit allows is ended with its process, and not done again.
#
# Imports nothing of the project but ``forks``, so that the process loads only what its work needs.


P = ParamSpec("P")
T = TypeVar("T")

POLITE = 10
"""Niceness of work that nobody at the bench waits for: the loop, the recorder and the stream come first."""


_MEMORY_ENDS = (-signal.SIGABRT, -signal.SIGSEGV)
"""Exit codes of libraries that end their process when they are refused memory."""

_END_S = 5.0
"""Longest time between the last sign of a process that dies and its end [s]."""

_LOOK_S = 0.01


class WorkerDiedError(SinewError):
    """The process died over a work, and the one after it too."""

    category = ErrorCode.UNAVAILABLE


@dataclass(frozen=True)
class WorkLimits:
    """What one work may take: ``limit_s`` of time [s] and ``memory_bytes`` beyond its loaded modules; None: no limit.

    The start of the process and the import of the work's module and of ``libraries``, which it imports only when it
    runs, do not count. ``remedy`` says what to change.
    """

    limit_s: float | None = None
    memory_bytes: int | None = None
    remedy: str = "ask for less"
    libraries: tuple[str, ...] = ()


class WorkLimitError(SinewError):
    """A work took more than its limit of ``quantity`` [``unit``] and was ended.

    ``bound`` is None where the memory of the machine itself was the limit.
    """

    category = ErrorCode.BAD_VALUE

    def __init__(self, quantity: str, bound: float | None, unit: str, remedy: str) -> None:
        self.quantity, self.bound, self.unit, self.remedy = quantity, bound, unit, remedy
        allowed = "than there is" if bound is None else f"than the {bound:g} {unit} that are allowed"
        super().__init__(f"{quantity}: this takes more {allowed}, and was ended: {remedy}")

    @property
    def fields(self) -> dict[str, Any]:
        """Code, and the limit with its unit."""
        return {"code": "work_limit", "quantity": self.quantity, "maximum": self.bound, "unit": self.unit}

    def __reduce__(self) -> tuple[Any, ...]:
        """Come from one process to another as it is."""
        return type(self), (self.quantity, self.bound, self.unit, self.remedy)


class Offload:
    """One process of a ``niceness``, started by the first work; works one after the other, each within ``limits``.

    ``died`` is called with a cause when the process dies without having been ended. Belongs to one event loop.
    """

    def __init__(self, died: Callable[[str], object], niceness: int = POLITE, limits: WorkLimits | None = None) -> None:
        self._died = died
        self._niceness = niceness
        self._limits = limits or WorkLimits()
        self._worker: _Worker | None = None
        self._turn = asyncio.Lock()
        self._closed = False

    async def run(self, work: Callable[P, T], *arguments: P.args, **_none: P.kwargs) -> T:
        """Return ``work(*arguments)``, computed in the process; both must be picklable.

        One that is cancelled meanwhile ends the process: nobody waits for the result. Work that its process dies over
        is done again, so that it may be done twice, never halfway. Raises WorkerDiedError the second time, and
        WorkLimitError for work beyond the limits.
        """
        async with self._turn:
            for _ in range(2):
                worker = self._present()
                try:
                    return await self._limited(worker, work, *arguments, **_none)
                except BrokenProcessPool:
                    if self._closed:
                        raise
                    self._gone(worker)
                    if self._limits.memory_bytes is not None and await worker.exit_code() in _MEMORY_ENDS:
                        raise self._beyond_memory() from None
                except MemoryError:  # what the process holds by now is not known
                    self._end(worker)
                    raise self._beyond_memory() from None
                except asyncio.CancelledError:
                    self._end(worker)
                    raise
        raise WorkerDiedError(
            "the process that computes this died over it twice: look whether the machine is short of memory"
        )

    async def _limited(self, worker: "_Worker", work: Callable[P, T], *arguments: P.args, **_none: P.kwargs) -> T:
        limits = self._limits
        await asyncio.wrap_future(worker.pool.submit(_load, work, limits.libraries))
        if limits.memory_bytes is not None and not worker.is_limited:
            await asyncio.wrap_future(worker.pool.submit(_limit_memory, limits.memory_bytes))
            worker.is_limited = True
        working = asyncio.wrap_future(worker.pool.submit(partial(_carried, work, *arguments)))
        try:
            done, _ = await asyncio.wait({working}, timeout=limits.limit_s)
        finally:
            if not working.done():  # nobody hears what becomes of it
                working.cancel()
        if not done:
            self._end(worker)
            raise WorkLimitError("computing time", limits.limit_s, "s", limits.remedy)
        result = working.result()
        if isinstance(result, _Raised):
            raise result.restored()
        return result

    def _beyond_memory(self) -> WorkLimitError:
        most = self._limits.memory_bytes
        return WorkLimitError("memory", None if most is None else most / 1e6, "MB", self._limits.remedy)

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
        self.pool = ProcessPoolExecutor(1, spawning(), begin_beside, (niceness,))
        self._loop = asyncio.get_running_loop()
        self._gone = gone
        self._process: int | None = None
        self._child: BaseProcess | None = None
        self._ended = False
        self.is_limited = False
        self.pool.submit(os.getpid).add_done_callback(self._there)

    async def exit_code(self) -> int | None:
        """Return how the dead process ended, minus the number of the signal; None where that is not known."""
        if self._child is None:
            return None
        await asyncio.to_thread(self._child.join, _END_S)  # its pipes are closed a little before it has ended
        # The pool's thread waits for the same process: it may have the status and not have noted it yet.
        end = self._loop.time() + _END_S
        while (code := self._child.exitcode) is None and self._loop.time() < end:
            await asyncio.sleep(_LOOK_S)
        return code

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
        number = pid.result()
        self._child = next((child for child in multiprocessing.active_children() if child.pid == number), None)
        self._loop.add_reader(self._process, self._gone, self)
        if self._ended:  # meanwhile
            self.end()


class _Raised(NamedTuple):
    """An exception of the work in parts, as pickling one calls its class with the message alone."""

    kind: type[Exception]
    arguments: tuple[Any, ...]
    fields: dict[str, Any]

    def restored(self) -> Exception:
        """Return the exception with its message, its fields and where it was raised."""
        error = self.kind.__new__(self.kind)
        error.args = self.arguments
        error.__dict__.update(self.fields)
        return error


def _carried(work: Callable[P, T], *arguments: P.args, **_none: P.kwargs) -> T | _Raised:
    """Return what ``work`` returns, or the exception that it raises, in parts."""
    try:
        return work(*arguments, **_none)
    except MemoryError:
        raise
    except Exception as error:
        error.add_note(format_exc())
        return _Raised(type(error), error.args, dict(error.__dict__))


def _load(_work: Callable[..., object], libraries: tuple[str, ...]) -> None:
    """Import the libraries; unpickling ``_work`` has loaded its module."""
    for library in libraries:
        import_module(library)


def _limit_memory(memory_bytes: int) -> None:
    """Refuse this process more memory than it has now and ``memory_bytes`` beyond.

    Of writable memory (RLIMIT_DATA): address space (RLIMIT_AS) would also count what each thread's heap only reserves,
    64 MB a core and more.
    """
    data_pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[5])
    most = data_pages * resource.getpagesize() + memory_bytes
    resource.setrlimit(resource.RLIMIT_DATA, (most, resource.getrlimit(resource.RLIMIT_DATA)[1]))


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


# Piping --------------------------------------------------------------------------------------------
#
# What a process of its own yields, handed on piece by piece: for what is too long to be held at
# once.
#
# The process is started for one piece of work and killed when nobody takes its pieces any more; it
# waits for whoever is slow. Imports nothing of the project but ``forks`` and ``offload``, so that
# the process loads only what its work needs.


_PIECE = 1 << 20


async def piped(work: Callable[P, Iterable[bytes]], *arguments: P.args, **_none: P.kwargs) -> AsyncGenerator[bytes]:
    """Yield the pieces of ``work(*arguments)``; both must be picklable.

    Raises what the work raises, and WorkerDiedError when its process dies over it.
    """
    mine, its = multiprocessing.Pipe(duplex=False)
    process = spawning().Process(target=_send, args=(its, work, arguments), daemon=True)
    loop, thread = asyncio.get_running_loop(), ThreadPoolExecutor(1, "piped")  # those of the loop are for short work
    try:
        await loop.run_in_executor(thread, process.start)
        its.close()  # or nobody would hear of the end of the process
        while (piece := await loop.run_in_executor(thread, _received, mine)) is not None:
            yield piece
    finally:
        _kill(process)  # who waits for it in the thread hears of that
        await asyncio.shield(loop.run_in_executor(thread, _end, process))
        thread.shutdown(wait=False)
        its.close()
        mine.close()


def _received(connection: Connection) -> bytes | None:
    """Wait for the next piece; None when there are no more. Raises what the work has raised, WorkerDiedError."""
    try:
        told: bytes | Exception | None = connection.recv()
    except (EOFError, OSError):
        lost = "the process that writes this died: look whether the machine is short of memory"
        raise WorkerDiedError(lost) from None
    if isinstance(told, Exception):
        raise told
    return told


def _kill(process: BaseProcess) -> None:
    if process.pid is not None:
        process.kill()


def _end(process: BaseProcess) -> None:
    """End a process that has been started by now, if ever."""
    _kill(process)
    if process.pid is not None:
        process.join()


def _send(connection: Connection, work: Callable[..., Iterable[bytes]], arguments: tuple[object, ...]) -> None:
    begin_beside(POLITE)
    try:
        for piece in work(*arguments):
            for begin in range(0, len(piece), _PIECE):
                connection.send(piece[begin : begin + _PIECE])
        connection.send(None)
    except BrokenPipeError:  # nobody wants it any more
        pass
    except Exception as error:
        connection.send(error)


# Processes -----------------------------------------------------------------------------------------
#
# The processes beside the service, one for each kind of work that must not wait for the others.
#
# What they compute would keep Python's lock for longer than the loop waits for a heartbeat. Each is
# started by its first work. What a person can make arbitrarily costly has limits of time and
# memory.


_AGAIN = "What it worked on is done once more."

DRY_RUNS = WorkLimits(600.0, 4_000_000_000, "play a shorter experiment, or play it with `sinew experiment`")
"""What a dry run may take; of ten minutes of motion it is about one minute."""

TEXTS = WorkLimits(30.0, 1_000_000_000, "shorten the text, or split it", SCIENCE)
"""What looking over a text that a person wrote or brought in may take; what is accepted takes about a second."""

SHEETS = WorkLimits(60.0, 1_000_000_000, "draw fewer curves, or shorter texts", ("typst",))
"""What a sheet of charts may take to become a PDF; the largest that is accepted takes about a second."""

REPORTS = WorkLimits(1800.0, None, "report fewer runs, or shorter ones")
"""What a report, or the envelope of a long recording, may take: an hour at 1 kHz takes minutes."""

EVALUATIONS = WorkLimits(1800.0, None, "evaluate a shorter run")
"""What it may take to evaluate a stored run once more."""


class Processes:
    """``computing`` is what somebody at the bench waits for; all others give way to it.

    ``texts`` and ``viewers_texts`` look over what operators and viewers have written, ``evaluations`` stored runs once
    more. ``studies`` has processes of its own, one for each core but one.
    """

    def __init__(self, supervision: Supervision) -> None:
        def process(works: str, niceness: int = POLITE, limits: WorkLimits | None = None) -> Offload:
            return Offload(partial(supervision.died, Part(f"The process for {works}", _AGAIN)), niceness, limits)

        self.computing = process("results and banks", niceness=0)
        self.evaluations = process("evaluations of stored runs", limits=EVALUATIONS)
        self.reports = process("reports and exports", limits=REPORTS)
        self.sheets = process("sheets of charts", limits=SHEETS)
        self.dry_runs = process("dry runs", limits=DRY_RUNS)
        self.texts = process("texts of operators", niceness=0, limits=TEXTS)
        self.viewers_texts = process("texts of viewers", limits=TEXTS)
        self.studies = process("studies")

    def close(self) -> None:
        """End them, whatever they work on."""
        for process in vars(self).values():
            process.close()
