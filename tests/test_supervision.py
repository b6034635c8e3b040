"""Failed tasks and threads are reported and restarted, with growing delays."""

import asyncio
import ctypes
import threading
import time
from collections.abc import Awaitable, Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from sqlalchemy import text

from backend.storage.database import open_database
from backend.supervision import FIRST_RESTART_DELAY_S, MAX_RESTART_DELAY_S, STABLE_AFTER_S, Part, Supervision

PART = Part("The clerk", "Letters wait.")
TIMEOUT_S = 20.0


def run(session: Callable[[Supervision], Awaitable[None]]) -> None:
    async def session_with_supervision() -> None:
        supervision = Supervision()
        await asyncio.wait_for(session(supervision), TIMEOUT_S)
        await supervision.close()

    asyncio.run(session_with_supervision())


async def until(reached: Callable[[], bool]) -> None:
    while not reached():
        await asyncio.sleep(0.005)


async def _raise() -> None:
    raise ValueError("ink is out")


async def _be_cancelled() -> None:
    current = asyncio.current_task()
    assert current is not None
    current.cancel()
    await asyncio.sleep(0)


@pytest.mark.parametrize(("die", "cause"), [(_raise, "ValueError: ink is out"), (_be_cancelled, "it was cancelled")])
def test_a_failed_task_is_reported_and_restarted(die: Callable[[], Awaitable[None]], cause: str) -> None:
    async def session(supervision: Supervision) -> None:
        reports: list[str] = []
        supervision.add_listener(reports.append)
        starts = 0

        async def work() -> None:
            nonlocal starts
            starts += 1
            if starts == 1:
                await die()
            await asyncio.Event().wait()

        deaths: list[int] = []
        supervised = supervision.start_task(PART, work, on_death=lambda: deaths.append(starts))
        assert supervision.problems == []
        await until(lambda: starts == 2)
        assert deaths == [1]
        assert reports == [f"The clerk failed ({cause}) and is being restarted."]
        (shown,) = supervision.problems
        assert shown == f"The clerk failed ({cause}) and was restarted. Letters wait."
        await supervised.end()
        assert starts == 2
        assert not [task for task in asyncio.all_tasks() if task.get_name() == PART.name]

    run(session)


def test_a_task_that_ends_or_returns_is_not_restarted() -> None:
    async def session(supervision: Supervision) -> None:
        starts = 0

        async def work() -> None:
            nonlocal starts
            starts += 1

        await supervision.start_task(PART, work).wait()
        waiting = supervision.start_task(PART, asyncio.Event().wait)  # type: ignore[arg-type] # returns True, never seen
        await waiting.end()
        dead = supervision.start_task(PART, _raise, on_death=lambda: dead.cancel())  # before it can be restarted
        await dead.wait()
        await asyncio.sleep(2 * FIRST_RESTART_DELAY_S)
        assert starts == 1
        assert "in a row" not in supervision.problems[0]

    run(session)


def test_a_killed_thread_is_reported_and_restarted() -> None:
    async def session(supervision: Supervision) -> None:
        ending, starts = threading.Event(), []

        def work() -> None:
            starts.append(threading.get_ident())
            while not ending.is_set():
                time.sleep(0.01)

        supervised = supervision.start_thread(PART, work, ending.set)
        await until(lambda: len(starts) == 1)
        kill = ctypes.pythonapi.PyThreadState_SetAsyncExc
        kill(ctypes.c_ulong(starts[0]), ctypes.py_object(SystemExit))
        await until(lambda: len(starts) == 2)
        # The problem says "being restarted" until the death is logged, after the delay has started.
        await until(lambda: supervision.problems == ["The clerk failed (SystemExit) and was restarted. Letters wait."])
        supervised.end()
        assert PART.name not in {thread.name for thread in threading.enumerate()}
        await asyncio.sleep(3 * FIRST_RESTART_DELAY_S)
        assert len(starts) == 2

    run(session)


def test_a_thread_that_dies_in_a_transaction_releases_the_database(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A log that kept the frames of the error would keep the cursor and its lock."""
    database = open_database(tmp_path)
    execute, starts = database.engine.dialect.do_execute, []

    def die_after(cursor: Any, statement: str, parameters: Any, context: Any = None) -> None:
        execute(cursor, statement, parameters, context)
        if statement.startswith("SELECT 1"):
            raise SystemExit

    async def session(supervision: Supervision) -> None:
        ending = threading.Event()

        def work() -> None:
            starts.append(threading.get_ident())
            if len(starts) == 1:
                with database.session() as opened:
                    opened.execute(text("CREATE TABLE letters (number INTEGER)"))
                    opened.execute(text("SELECT 1 UNION SELECT 2"))
            ending.wait()

        supervised = supervision.start_thread(PART, work, ending.set)
        await until(lambda: len(starts) == 2)
        supervised.end()

    with pytest.MonkeyPatch.context() as patch, closing(database):
        patch.setattr(database.engine.dialect, "do_execute", die_after)
        run(session)
        assert any(record.exc_info for record in caplog.records)
        with database.session() as opened:
            opened.execute(text("CREATE TABLE letters (number INTEGER)"))


def test_restart_delays_grow_and_reset_after_stable_operation() -> None:
    now = 0.0
    supervision = Supervision(clock=lambda: now)
    reports: list[str] = []
    supervision.add_listener(reports.append)
    delays = [supervision.record_failure(PART, "no paper") for _ in range(12)]
    assert delays[:3] == [FIRST_RESTART_DELAY_S, 2 * FIRST_RESTART_DELAY_S, 4 * FIRST_RESTART_DELAY_S]
    assert delays[-1] == MAX_RESTART_DELAY_S
    assert supervision.problems == [
        "The clerk failed (no paper) and is being restarted, 12 times in a row. Letters wait."
    ]
    assert len(reports) == 1
    now = MAX_RESTART_DELAY_S + STABLE_AFTER_S
    assert supervision.problems == []
    assert supervision.record_failure(PART, "no paper") == FIRST_RESTART_DELAY_S
    assert len(reports) == 2
