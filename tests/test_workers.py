"""Worker processes: streams, long work, kills, limits and closed terminals."""

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


def chunks(count: int) -> Iterator[bytes]:
    yield b""
    for number in range(count):
        yield bytes([number]) * 3
    yield LARGE


def raise_immediately() -> Iterator[bytes]:
    raise LookupError("there is nothing")


def raise_after_first_chunk() -> Iterator[bytes]:
    yield b"begun"
    raise ValueError("it broke")


def die_after_first_chunk() -> Iterator[bytes]:
    yield b"begun"
    os.kill(os.getpid(), signal.SIGKILL)


def stream_endlessly() -> Iterator[bytes]:
    yield str(os.getpid()).encode()
    while True:
        yield LARGE


def waiting(gate: Path) -> Iterator[bytes]:
    yield b"begun"
    while not gate.exists():
        time.sleep(0.01)
    yield b"end"


async def collect(work: object, *arguments: object) -> list[bytes]:
    return [chunk async for chunk in stream_from_process(work, *arguments)]  # type: ignore[arg-type]


def test_chunks_arrive_in_order() -> None:
    assert b"".join(asyncio.run(collect(chunks, 3))) == b"\0\0\0\1\1\1\2\2\2" + LARGE


def test_an_error_of_the_generator_is_raised_before_the_first_chunk() -> None:
    with pytest.raises(LookupError, match="there is nothing"):
        asyncio.run(collect(raise_immediately))


@pytest.mark.parametrize(
    ("work", "error"), [(raise_after_first_chunk, ValueError), (die_after_first_chunk, WorkerDiedError)]
)
def test_a_failing_stream_raises_instead_of_ending(work: object, error: type[Exception]) -> None:
    async def take() -> list[bytes]:
        async with aclosing(stream_from_process(work)) as stream:  # type: ignore[arg-type]
            taken = [await anext(stream)]
            with pytest.raises(error):
                await anext(stream)
        return taken

    assert asyncio.run(take()) == [b"begun"]


def test_waiting_for_a_chunk_does_not_occupy_a_thread_of_the_event_loop(tmp_path: Path) -> None:
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


def test_closing_the_stream_ends_its_process() -> None:
    async def take() -> int:
        async with aclosing(stream_from_process(stream_endlessly)) as stream:
            number = int(await anext(stream))
            await anext(stream)
        return number

    with pytest.raises(ProcessLookupError):
        os.kill(asyncio.run(take()), 0)


# Worker processes that are killed: idle, at work, repeatedly, and after a cancellation.

TIMEOUT_S = 60.0


def run(session: Callable[[WorkerProcess, list[str]], Awaitable[None]]) -> None:
    async def session_with_worker() -> None:
        deaths: list[str] = []
        worker = WorkerProcess(deaths.append)
        try:
            await asyncio.wait_for(session(worker, deaths), TIMEOUT_S)
        finally:
            worker.close()

    asyncio.run(session_with_worker())


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


def is_running(pid: int) -> bool:
    return Path(f"/proc/{pid}").exists()


async def until(reached: Callable[[], bool]) -> None:
    while not reached():
        await asyncio.sleep(0.01)


def test_a_worker_process_killed_while_idle_is_reported_and_replaced() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        first = await worker.run(os.getpid)
        os.kill(first, signal.SIGKILL)
        await until(lambda: len(deaths) == 1)
        second = await worker.run(os.getpid)
        assert second != first
        assert len(deaths) == 1

    run(session)


def test_work_is_repeated_after_its_process_dies(tmp_path: Path) -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        waiting = [worker.run(die_once, tmp_path / "killed"), worker.run(os.getpid), worker.run(os.getpid)]
        answer, *pids = await asyncio.gather(*waiting)
        assert answer == "done"
        assert pids[0] == pids[1]
        assert len(deaths) == 1

    run(session)


def test_work_that_kills_every_process_fails_without_affecting_other_work(tmp_path: Path) -> None:
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


def test_a_worker_process_killed_while_loading_is_replaced() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        others = _children()  # of the previous test, killed but not yet removed
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


def test_queued_work_is_executed_after_its_process_is_killed() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        pid = await worker.run(os.getpid)  # the worker supervises a process after its first work
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
    """Return the process ids of the worker processes of this process."""
    found = set()
    for child in Path(f"/proc/self/task/{os.getpid()}/children").read_text(encoding="ascii").split():
        with suppress(OSError):  # it has ended in the meantime
            if b"multiprocessing.spawn" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.add(int(child))
    return found


def test_cancelling_the_caller_ends_the_work_without_a_report(tmp_path: Path) -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        marker = tmp_path / "started"
        leaving = asyncio.create_task(worker.run(sleep_long, marker))
        await until(lambda: marker.exists() and marker.read_text() != "")
        pid = int(marker.read_text())
        leaving.cancel()
        with pytest.raises(asyncio.CancelledError):
            await leaving
        await until(lambda: not is_running(pid))
        assert await worker.run(os.getpid) != pid
        assert deaths == []

    run(session)


def test_closing_the_worker_ends_its_current_work(tmp_path: Path) -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        marker = tmp_path / "started"
        current = asyncio.create_task(worker.run(sleep_long, marker))
        await until(lambda: marker.exists() and marker.read_text() != "")
        pid = int(marker.read_text())
        worker.close()
        await until(lambda: not is_running(pid))
        current.cancel()
        assert deaths == []

    run(session)


def append_pid(file: Path) -> None:
    file.write_text(f"{file.read_text() if file.exists() else ''}{os.getpid()}\n")


def fail() -> None:
    raise RuntimeError("nobody is to hear of this")


def test_warm_up_runs_once_before_other_work(tmp_path: Path) -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        for _ in range(3):
            worker.warm_up(append_pid, tmp_path / "said")
        process = await worker.run(os.getpid)
        worker.warm_up(append_pid, tmp_path / "said")
        assert await worker.run(os.getpid) == process
        assert (tmp_path / "said").read_text() == f"{process}\n"
        assert deaths == []

    run(session)


def test_a_failing_warm_up_does_not_affect_other_work() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        worker.warm_up(fail)
        assert await worker.run(os.getpid) > 0
        assert deaths == []

    run(session)


def block_interpreter() -> int:
    """Compute for minutes in C, where Python runs no signal handler."""
    return len(str(10**100_000_000))


def take(megabytes: int) -> int:
    return len(bytearray(megabytes * 1_000_000))


def abort() -> None:
    """Abort as a library does when an allocation fails."""
    os.abort()


def run_limited(session: Callable[[WorkerProcess], Awaitable[None]], limits: WorkLimits) -> list[str]:
    deaths: list[str] = []

    async def session_with_worker() -> None:
        worker = WorkerProcess(deaths.append, limits=limits)
        try:
            await asyncio.wait_for(session(worker), TIMEOUT_S)
        finally:
            worker.close()

    asyncio.run(session_with_worker())
    return deaths


def test_work_beyond_the_time_limit_is_ended_and_not_repeated() -> None:
    async def session(worker: WorkerProcess) -> None:
        first = await worker.run(os.getpid)
        with pytest.raises(WorkLimitError) as refused:
            await worker.run(block_interpreter)
        assert (refused.value.quantity, refused.value.bound, refused.value.unit) == ("computing time", 0.5, "s")
        assert "write less" in str(refused.value)
        await until(lambda: not is_running(first))
        assert await worker.run(os.getpid) != first

    assert run_limited(session, WorkLimits(limit_s=0.5, remedy="write less")) == []


def test_loading_and_queueing_do_not_count_towards_the_time_limit() -> None:
    async def session(worker: WorkerProcess) -> None:
        worker.preload(SlowToLoad(), "time")  # 0.2 s before the first work
        assert await asyncio.gather(*(worker.run(time.sleep, 0.2) for _ in range(8))) == [None] * 8

    assert run_limited(session, WorkLimits(limit_s=1.0)) == []


def test_work_beyond_the_memory_limit_fails_and_its_process_is_replaced() -> None:
    async def session(worker: WorkerProcess) -> None:
        assert await worker.run(take, 50) == 50_000_000
        first = await worker.run(os.getpid)
        with pytest.raises(WorkLimitError) as refused:
            await worker.run(take, 400)
        assert (refused.value.quantity, refused.value.bound, refused.value.unit) == ("memory", 200.0, "MB")
        assert await worker.run(os.getpid) != first

    assert run_limited(session, WorkLimits(memory_bytes=200_000_000)) == []


def test_an_abort_for_lack_of_memory_is_reported_as_the_memory_limit() -> None:
    async def session(worker: WorkerProcess) -> None:
        with pytest.raises(WorkLimitError):
            await worker.run(abort)
        assert await worker.run(os.getpid) > 0

    assert len(run_limited(session, WorkLimits(memory_bytes=200_000_000))) == 1


def test_a_limit_error_is_pickled_without_loss() -> None:
    error = WorkLimitError("memory", 200.0, "MB", "send less")
    again = pickle.loads(pickle.dumps(error))
    assert (str(again), vars(again)) == (str(error), vars(error))


class NamedError(ValueError):
    """An error whose constructor takes more than a message."""

    def __init__(self, quantity: str, value: float) -> None:
        super().__init__(f"{quantity} is {value:g}")
        self.quantity = quantity
        self.value = value


def refuse() -> None:
    raise NamedError("period", 0.5)


def test_an_error_of_the_work_keeps_its_fields() -> None:
    async def session(worker: WorkerProcess, deaths: list[str]) -> None:
        with pytest.raises(NamedError) as raised:
            await worker.run(refuse)
        assert (raised.value.quantity, raised.value.value, str(raised.value)) == ("period", 0.5, "period is 0.5")
        assert any("refuse" in note for note in raised.value.__notes__)
        assert not deaths

    run(session)


# A closed terminal or Ctrl+C sends a signal to every process of the service; only the service reacts.


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGINT])
def test_worker_processes_ignore_signals_of_the_terminal(number: signal.Signals) -> None:
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
