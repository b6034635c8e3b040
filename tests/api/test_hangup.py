"""A terminal that is closed, or Ctrl+C in it, reaches every process of the service: only the service heeds it."""

import asyncio
import os
import signal

import pytest

from backend.workers import WorkerProcess


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
