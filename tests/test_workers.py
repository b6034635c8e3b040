"""Worker processes: pieces, long work, kills and closed terminals."""

import asyncio
import os
import pickle
import signal
import time
from collections.abc import Awaitable, Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import aclosing, suppress
from pathlib import Path

import pytest

from backend.workers import WorkerDiedError, WorkerProcess, WorkLimitError, WorkLimits, stream_from_process

# Chunks arrive from a worker process as they are computed, and so do its errors.

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


# The worker process, killed for real: idle, at work, repeatedly, and by a caller that cancels.

TIMEOUT_S = 60.0


def run(session: Callable[[WorkerProcess, list[str]], Awaitable[None]]) -> None:
    async def whole() -> None:
        deaths: list[str] = []
        worker = WorkerProcess(deaths.append)
        try:
            await asyncio.wait_for(session(worker, deaths), TIMEOUT_S)
        finally:
            worker.close()

    asyncio.run(whole())


def die_once(marker: Path) -> str:
    if not marker.exists():
        marker.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return "done"


def die_always(marker: Path) -> None:
    marker.write_text(str(int(marker.read_text() or 0) + 1))
    os.kill(os.getpid(), signal.SIGKILL)


def sleep_long(marker: Path) -> None:
    marker.write_text(str(os.getpid()))
    time.sleep(3600.0)


def is_there(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


async def until(reached: Callable[[], bool]) -> None:
    while not reached():
        await asyncio.sleep(0.01)


def test_a_process_killed_idle_is_told_at_once_and_replaced() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        first = await worker.run(os.getpid)
        os.kill(first, signal.SIGKILL)
        await until(lambda: len(deaths) == 1)
        second = await worker.run(os.getpid)
        assert second != first
        assert len(deaths) == 1

    run(session)


def test_work_that_its_process_dies_over_is_done_again(tmp_path: Path) -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        waiting = [worker.run(die_once, tmp_path / "killed"), worker.run(os.getpid), worker.run(os.getpid)]
        said, *pids = await asyncio.gather(*waiting)
        assert said == "done"
        assert pids[0] == pids[1]
        assert len(deaths) == 1

    run(session)


def test_work_that_kills_each_process_is_given_up_and_harms_no_other(tmp_path: Path) -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        tried = tmp_path / "tried"
        tried.touch()
        bad, good = worker.run(die_always, tried), worker.run(os.getpid)
        failed, pid = await asyncio.gather(bad, good, return_exceptions=True)
        assert isinstance(failed, WorkerDiedError)
        assert "memory" in str(failed)
        assert isinstance(pid, int)
        assert (tried.read_text(), len(deaths)) == ("2", 2)

    run(session)


def test_a_process_killed_while_it_loads_is_replaced() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        others = _children()  # of the test before, killed and not yet gone
        worker.preload(WorkerProcess)
        await until(lambda: bool(_children() - others))
        (first,) = _children() - others
        os.kill(first, signal.SIGKILL)
        await until(lambda: len(deaths) == 1)
        assert await worker.run(os.getpid) != first

    run(session)


class SlowToLoad:
    """Takes a while to be unpickled."""

    def __reduce__(self) -> tuple[object, ...]:
        return time.sleep, (0.2,)

    def __call__(self) -> None:
        """Do nothing."""


def test_work_behind_others_is_done_although_the_process_is_killed_before_its_turn() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        pid = await worker.run(os.getpid)  # so that it is watched
        for killed in range(1, 11):
            for _ in range(4):
                worker.preload(SlowToLoad())
            waiting = asyncio.create_task(worker.run(os.getpid))
            await asyncio.sleep(0.1)
            os.kill(pid, signal.SIGKILL)
            assert await waiting != pid
            assert len(deaths) == killed
            pid = await worker.run(os.getpid)

    run(session)


def _children() -> set[int]:
    """Numbers of the processes for work that this process has."""
    found = set()
    for child in Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split():
        with suppress(OSError):  # it has ended meanwhile
            if b"multiprocessing.spawn" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.add(int(child))
    return found


def test_a_caller_that_leaves_ends_the_work_and_nothing_is_told(tmp_path: Path) -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        marker = tmp_path / "started"
        leaving = asyncio.create_task(worker.run(sleep_long, marker))
        await until(lambda: marker.exists() and marker.read_text() != "")
        pid = int(marker.read_text())
        leaving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await leaving
        await until(lambda: not is_there(pid))
        assert await worker.run(os.getpid) != pid
        assert deaths == []

    run(session)


def test_closing_ends_whatever_is_under_way(tmp_path: Path) -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        marker = tmp_path / "started"
        under_way = asyncio.create_task(worker.run(sleep_long, marker))
        await until(lambda: marker.exists() and marker.read_text() != "")
        pid = int(marker.read_text())
        worker.close()
        await until(lambda: not is_there(pid))
        under_way.cancel()
        assert deaths == []

    run(session)


def write_down(said: Path) -> None:
    said.write_text(f"{said.read_text() if said.exists() else ''}{os.getpid()}\n")


def fail() -> None:
    raise RuntimeError("nobody is to hear of this")


def test_what_a_process_begins_with_is_done_once_before_all_else(tmp_path: Path) -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        for _ in range(3):
            worker.warm_up(write_down, tmp_path / "said")
        process = await worker.run(os.getpid)
        worker.warm_up(write_down, tmp_path / "said")
        assert await worker.run(os.getpid) == process
        assert (tmp_path / "said").read_text() == f"{process}\n"
        assert deaths == []

    run(session)


def test_what_a_process_begins_with_may_fail() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        worker.warm_up(fail)
        assert await worker.run(os.getpid) > 0
        assert deaths == []

    run(session)


def hold_the_interpreter() -> int:
    """Compute for minutes in C, where no signal handler of Python runs."""
    return len(str(10**100_000_000))


def take(megabytes: int) -> int:
    return len(bytearray(megabytes * 1_000_000))


def abort() -> None:
    """End as a library does that is refused memory."""
    os.abort()


def limited(session: Callable[[WorkerProcess], Awaitable[None]], limits: WorkLimits) -> list[str]:
    deaths: list[str] = []

    async def whole() -> None:
        worker = WorkerProcess(deaths.append, limits=limits)
        try:
            await asyncio.wait_for(session(worker), TIMEOUT_S)
        finally:
            worker.close()

    asyncio.run(whole())
    return deaths


def test_work_beyond_its_time_is_ended_with_its_process_and_not_done_again() -> None:
    async def session(worker: WorkerProcess) -> None:
        first = await worker.run(os.getpid)
        with pytest.raises(WorkLimitError) as refused:
            await worker.run(hold_the_interpreter)
        assert (refused.value.quantity, refused.value.bound, refused.value.unit) == ("computing time", 0.5, "s")
        assert "write less" in str(refused.value)
        await until(lambda: not is_there(first))
        assert await worker.run(os.getpid) != first

    assert limited(session, WorkLimits(limit_s=0.5, remedy="write less")) == []


def test_loading_and_waiting_for_a_turn_do_not_count_as_time_of_the_work() -> None:
    async def session(worker: WorkerProcess) -> None:
        worker.preload(SlowToLoad(), "time")  # 0.2 s before the first work
        assert await asyncio.gather(*(worker.run(time.sleep, 0.2) for _ in range(8))) == [None] * 8

    assert limited(session, WorkLimits(limit_s=1.0)) == []


def test_memory_beyond_the_limit_is_refused_and_the_process_replaced() -> None:
    async def session(worker: WorkerProcess) -> None:
        assert await worker.run(take, 50) == 50_000_000
        first = await worker.run(os.getpid)
        with pytest.raises(WorkLimitError) as refused:
            await worker.run(take, 400)
        assert (refused.value.quantity, refused.value.bound, refused.value.unit) == ("memory", 200.0, "MB")
        assert await worker.run(os.getpid) != first

    assert limited(session, WorkLimits(memory_bytes=200_000_000)) == []


def test_a_library_that_aborts_for_lack_of_memory_is_told_as_the_limit() -> None:
    async def session(worker: WorkerProcess) -> None:
        with pytest.raises(WorkLimitError):
            await worker.run(abort)
        assert await worker.run(os.getpid) > 0

    assert len(limited(session, WorkLimits(memory_bytes=200_000_000))) == 1


def test_a_refusal_by_a_limit_comes_from_one_process_to_another_as_it_is() -> None:
    error = WorkLimitError("memory", 200.0, "MB", "send less")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), vars(again)) == (str(error), vars(error))


class NamedError(ValueError):
    """An error whose class takes more than its message, as many of the product do."""

    def __init__(self, quantity: str, value: float) -> None:
        super().__init__(f"{quantity} is {value:g}")
        self.quantity = quantity
        self.value = value


def refuse() -> None:
    raise NamedError("period", 0.5)


def test_an_error_of_the_work_arrives_with_its_fields() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        with pytest.raises(NamedError) as raised:
            await worker.run(refuse)
        assert (raised.value.quantity, raised.value.value, str(raised.value)) == ("period", 0.5, "period is 0.5")
        assert any("refuse" in note for note in raised.value.__notes__)
        assert not deaths

    run(session)


# A terminal that is closed, or Ctrl+C in it, reaches every process of the service: only the service heeds it.


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGINT])
def test_a_computing_process_leaves_the_terminal_to_the_service(number: signal.Signals) -> None:
    deaths: list[str] = []

    async def compute() -> tuple[int, int]:
        worker = WorkerProcess(deaths.append)
        try:
            before = await worker.run(os.getpid)
            os.kill(before, number)
            return before, await worker.run(os.getpid)
        finally:
            worker.close()

    before, after = asyncio.run(compute())
    assert before == after
    assert deaths == []
