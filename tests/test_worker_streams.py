"""Chunks arrive from a worker process as they are computed, and so do its errors."""

import asyncio
import os
import signal
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import aclosing
from pathlib import Path

import pytest

from backend.workers import WorkerDiedError, stream_from_process

LARGE = bytes(range(256)) * 20_000


def pieces(count: int) -> Iterator[bytes]:
    yield b""
    for number in range(count):
        yield bytes([number]) * 3
    yield LARGE


def refusing() -> Iterator[bytes]:
    raise LookupError("there is nothing")


def breaking() -> Iterator[bytes]:
    yield b"begun"
    raise ValueError("it broke")


def dying() -> Iterator[bytes]:
    yield b"begun"
    os.kill(os.getpid(), signal.SIGKILL)


def endless() -> Iterator[bytes]:
    yield str(os.getpid()).encode()
    while True:
        yield LARGE


def waiting(gate: Path) -> Iterator[bytes]:
    yield b"begun"
    while not gate.exists():
        time.sleep(0.01)
    yield b"end"


async def collected(work: object, *arguments: object) -> list[bytes]:
    return [piece async for piece in stream_from_process(work, *arguments)]  # type: ignore[arg-type]


def test_all_pieces_come_in_order() -> None:
    assert b"".join(asyncio.run(collected(pieces, 3))) == b"\0\0\0\1\1\1\2\2\2" + LARGE


def test_what_the_work_refuses_is_raised_before_the_first_piece() -> None:
    with pytest.raises(LookupError, match="there is nothing"):
        asyncio.run(collected(refusing))


@pytest.mark.parametrize(("work", "error"), [(breaking, ValueError), (dying, WorkerDiedError)])
def test_what_breaks_off_is_no_end(work: object, error: type[Exception]) -> None:
    async def take() -> list[bytes]:
        async with aclosing(stream_from_process(work)) as stream:  # type: ignore[arg-type]
            taken = [await anext(stream)]
            with pytest.raises(error):
                await anext(stream)
        return taken

    assert asyncio.run(take()) == [b"begun"]


def test_who_waits_for_a_piece_leaves_the_threads_of_the_loop_to_others(tmp_path: Path) -> None:
    gate = tmp_path / "gate"

    async def take() -> bytes:
        asyncio.get_running_loop().set_default_executor(ThreadPoolExecutor(1))
        async with aclosing(stream_from_process(waiting, gate)) as stream:
            assert await anext(stream) == b"begun"
            awaited = asyncio.ensure_future(anext(stream))
            await asyncio.sleep(0)
            async with asyncio.timeout(20.0):
                await asyncio.to_thread(gate.touch)
            return await awaited

    assert asyncio.run(take()) == b"end"


def test_the_process_ends_when_nobody_takes_its_pieces_any_more() -> None:
    async def take() -> int:
        async with aclosing(stream_from_process(endless)) as stream:
            number = int(await anext(stream))
            await anext(stream)
        return number

    with pytest.raises(ProcessLookupError):
        os.kill(asyncio.run(take()), 0)
