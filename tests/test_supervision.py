"""Tasks and threads that die in all possible ways are reported and restarted, with growing delays."""

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
    async def whole() -> None:
        supervision = Supervision()
        await asyncio.wait_for(session(supervision), TIMEOUT_S)
        await supervision.close()

    asyncio.run(whole())


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
def test_a_task_that_dies_is_told_and_works_again(die: Callable[[], Awaitable[None]], cause: str) -> None:
    async def session(supervision: Supervision) -> None:
        told: list[str] = []
        supervision.add_listener(told.append)
        lives = 0

        async def work() -> None:
            nonlocal lives
            lives += 1
            if lives == 1:
                await die()
            await asyncio.Event().wait()

        deaths: list[int] = []
        kept = supervision.start_task(PART, work, on_death=lambda: deaths.append(lives))
        assert supervision.problems == []
        await until(lambda: lives == 2)
        assert deaths == [1]
        assert told == [f"The clerk failed ({cause}) and is being restarted."]
        (shown,) = supervision.problems
        assert shown == f"The clerk failed ({cause}) and was restarted. Letters wait."
        await kept.end()
        assert lives == 2
        assert not [task for task in asyncio.all_tasks() if task.get_name() == PART.name]

    run(session)


def test_a_task_that_is_ended_or_returns_is_not_started_anew() -> None:
    async def session(supervision: Supervision) -> None:
        lives = 0

        async def work() -> None:
            nonlocal lives
            lives += 1

        await supervision.start_task(PART, work).wait()
        waiting = supervision.start_task(PART, asyncio.Event().wait)  # type: ignore[arg-type] # returns True, never seen
        await waiting.end()
        dead = supervision.start_task(PART, _raise, on_death=lambda: dead.cancel())  # before it can be started anew
        await dead.wait()
        await asyncio.sleep(2 * FIRST_RESTART_DELAY_S)
        assert lives == 1
        assert "in a row" not in supervision.problems[0]

    run(session)


def test_a_thread_that_is_killed_is_told_and_works_again() -> None:
    async def session(supervision: Supervision) -> None:
        ending, lives = threading.Event(), []

        def work() -> None:
            lives.append(threading.get_ident())
            while not ending.is_set():
                time.sleep(0.01)

        kept = supervision.start_thread(PART, work, ending.set)
        await until(lambda: len(lives) == 1)
        kill = ctypes.pythonapi.PyThreadState_SetAsyncExc
        kill(ctypes.c_ulong(lives[0]), ctypes.py_object(SystemExit))
        await until(lambda: len(lives) == 2)
        # it is told as being started for as long as its death took to be written down, after the pause has begun
        await until(lambda: supervision.problems == ["The clerk failed (SystemExit) and was restarted. Letters wait."])
        kept.end()
        assert PART.name not in {thread.name for thread in threading.enumerate()}
        await asyncio.sleep(3 * FIRST_RESTART_DELAY_S)
        assert len(lives) == 2

    run(session)


def test_a_thread_that_dies_in_a_transaction_leaves_the_database_writable(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The log keeps the error; with the frames that raised it, it would keep the cursor and its lock."""
    database = open_database(tmp_path)
    execute, lives = database.engine.dialect.do_execute, []

    def die_after(cursor: Any, statement: str, parameters: Any, context: Any = None) -> None:
        execute(cursor, statement, parameters, context)
        if statement.startswith("SELECT 1"):
            raise SystemExit

    async def session(supervision: Supervision) -> None:
        ending = threading.Event()

        def work() -> None:
            lives.append(threading.get_ident())
            if len(lives) == 1:
                with database.session() as opened:
                    opened.execute(text("CREATE TABLE letters (number INTEGER)"))
                    opened.execute(text("SELECT 1 UNION SELECT 2"))
            ending.wait()

        kept = supervision.start_thread(PART, work, ending.set)
        await until(lambda: len(lives) == 2)
        kept.end()

    with pytest.MonkeyPatch.context() as patch, closing(database):
        patch.setattr(database.engine.dialect, "do_execute", die_after)
        run(session)
        assert any(record.exc_info for record in caplog.records)
        with database.session() as opened:
            opened.execute(text("CREATE TABLE letters (number INTEGER)"))


def test_the_pauses_grow_and_a_part_that_lives_long_is_well_again() -> None:
    now = 0.0
    supervision = Supervision(clock=lambda: now)
    told: list[str] = []
    supervision.add_listener(told.append)
    pauses = [supervision.record_failure(PART, "no paper") for _ in range(12)]
    assert pauses[:3] == [FIRST_RESTART_DELAY_S, 2 * FIRST_RESTART_DELAY_S, 4 * FIRST_RESTART_DELAY_S]
    assert pauses[-1] == MAX_RESTART_DELAY_S
    assert supervision.problems == [
        "The clerk failed (no paper) and is being restarted, 12 times in a row. Letters wait."
    ]
    assert len(told) == 1
    now = MAX_RESTART_DELAY_S + STABLE_AFTER_S
    assert supervision.problems == []
    assert supervision.record_failure(PART, "no paper") == FIRST_RESTART_DELAY_S
    assert len(told) == 2
