"""What a process of its own yields, handed on piece by piece: for what is too long to be held at once.

The process is started for one piece of work and killed when nobody takes its pieces any more; it waits for whoever is
slow. Imports nothing of the project but ``forks`` and ``offload``, so that the process loads only what its work needs.
"""

import asyncio
import multiprocessing
from collections.abc import AsyncGenerator, Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import ParamSpec

from backend.forks import spawning
from backend.offload import POLITE, WorkerDiedError, begin_beside

P = ParamSpec("P")

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
