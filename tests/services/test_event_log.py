"""The event log while the database fails: order, times, bound and messages."""

import asyncio
from collections.abc import Callable, Iterator
from contextlib import closing
from datetime import UTC, datetime
from pathlib import Path

import pytest

from backend.event_bus import EventBus
from backend.schemas.state import MarkKind
from backend.services import messages
from backend.services.event_log import EventLog
from backend.storage import events
from backend.storage.database import Database, open_database
from tests.recording.test_crash import fill, make_read_only, repair


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    with closing(open_database(tmp_path)) as opened:
        yield opened


async def until(reached: Callable[[], bool]) -> None:
    """Write the log until the condition holds; 20 s suffice on a busy machine."""
    for _ in range(2000):
        if reached():
            return
        await asyncio.sleep(0.01)
    raise AssertionError("the journal did not get there")


async def ended(task: asyncio.Task[None]) -> None:
    task.cancel()
    await asyncio.gather(task, return_exceptions=True)


def stored(database: Database) -> list[events.Event]:
    with database.reading() as session:
        return list(reversed(events.find(session)))


def texts(database: Database) -> list[str]:
    return [event.text for event in stored(database)]


@pytest.mark.parametrize(("breaks", "words"), [(fill, "disk is full"), (make_read_only, "readonly database")])
def test_events_wait_in_order_while_the_database_fails(
    database: Database, breaks: Callable[[Database], None], words: str
) -> None:
    async def happen() -> datetime:
        event_log = EventLog(database, EventBus())
        writing = asyncio.create_task(event_log.run())
        event_log.add_mark(MarkKind.NOTE, "before", tick=1)
        await until(lambda: texts(database) == ["before"])
        breaks(database)
        for tick in range(2, 30):
            event_log.add_mark(MarkKind.NOTE, f"{tick} " * 400, tick)
        await until(lambda: words in event_log.problem)
        assert "waiting in memory" in event_log.problem
        last = datetime.now(UTC)
        repair(database)
        await until(lambda: len(texts(database)) == 29 and event_log.problem == "")
        await ended(writing)
        return last

    last = asyncio.run(happen())
    stored_events = stored(database)
    assert [event.tick for event in stored_events] == list(range(1, 30))
    assert all(event.at <= last for event in stored_events)  # the time of the event, not of its storage


def test_events_above_the_bound_are_counted(database: Database) -> None:
    async def happen() -> None:
        event_log = EventLog(database, EventBus(), bound=5)
        make_read_only(database)
        writing = asyncio.create_task(event_log.run())
        for tick in range(9):
            event_log.add_mark(MarkKind.NOTE, f"event {tick}", tick)
        await until(lambda: event_log.problem != "")
        assert event_log.problem == messages.events_not_stored(reason=event_log._error, waiting=5, lost=4)
        repair(database)
        await until(lambda: len(texts(database)) == 6)
        event_log.add_mark(MarkKind.NOTE, "afterwards", 10)
        await until(lambda: len(texts(database)) == 7)
        await ended(writing)

    asyncio.run(happen())
    first = [f"event {tick}" for tick in range(5)]
    assert texts(database) == [*first, messages.later_events_lost(count=4), "afterwards"]


def test_invalid_event_does_not_block_others(database: Database) -> None:
    async def happen() -> None:
        event_log = EventLog(database, EventBus())
        event_log.add_mark(MarkKind.NOTE, "first", 1)
        event_log.add_mark(MarkKind.NOTE, "of a run that is not there", 2, run=77)
        event_log.add_mark(MarkKind.NOTE, "half a letter \ud800", 3)
        event_log.add_mark(MarkKind.NOTE, "last", 4)
        writing = asyncio.create_task(event_log.run())
        await until(lambda: texts(database)[-1:] == ["last"] and event_log.problem == "")
        await ended(writing)

    asyncio.run(happen())
    assert texts(database) == ["first", "last"]


def test_close_stores_waiting_events_once(database: Database) -> None:
    async def happen() -> None:
        event_log = EventLog(database, EventBus())
        writing = asyncio.create_task(event_log.run())
        for tick in range(1200):
            event_log.add_mark(MarkKind.NOTE, "event", tick)
        await asyncio.sleep(0)  # the first batch is being written
        await asyncio.sleep(0)
        await ended(writing)
        event_log.close()

    asyncio.run(happen())
    with database.reading() as session:
        ticks = [event.tick for event in events.find(session, limit=5000)]
    assert ticks == list(reversed(range(1200)))
