"""The queue is stored in order, per station, under numbers that are never reused."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.storage import queue
from backend.storage.database import Database, open_database
from backend.storage.orm import UnfitError
from backend.storage.stations import assign_unowned_rows


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


def add(database: Database, *names: str) -> list[int]:
    with database.session() as session:
        return [queue.add(session, name, {"lam_q": 0.5, "segments": "[]"}, "Ana").id for name in names]


def waiting(database: Database) -> list[str]:
    with database.reading() as session:
        return [item.name for item in queue.load_waiting(session)]


def test_queued_runs_are_read_in_order(database: Database) -> None:
    first, second, third = add(database, "a", "b", "c")
    with database.session() as session:
        queue.arrange(session, [third, first, second])
    assert waiting(database) == ["c", "a", "b"]
    with database.session() as session:
        queue.remove(session, first)
        queue.remove(session, first)
    (fourth,) = add(database, "d")
    assert waiting(database) == ["c", "b", "d"]
    with database.reading() as session:
        item = queue.load_waiting(session)[-1]
    assert (item.id, item.settings, item.who) == (fourth, {"lam_q": 0.5, "segments": "[]"}, "Ana")


def test_a_queue_number_is_never_reused(database: Database) -> None:
    (last,) = add(database, "a")
    with database.session() as session:
        queue.remove(session, last)
    assert add(database, "b") > [last]


def test_each_station_has_its_own_queue(tmp_path: Path) -> None:
    here, there = open_database(tmp_path, station="rig1"), open_database(tmp_path, station="rig2")
    (ours,) = add(here, "ours")
    (theirs,) = add(there, "theirs")
    with here.session() as session:
        queue.remove(session, theirs)
        queue.arrange(session, [theirs, ours])
    assert (waiting(here), waiting(there)) == (["ours"], ["theirs"])
    for database in (here, there):
        database.close()


def test_queued_runs_follow_a_renamed_station(tmp_path: Path) -> None:
    nameless = open_database(tmp_path)
    add(nameless, "a")
    with nameless.session() as session:
        assign_unowned_rows(session, "rig1")
    named = open_database(tmp_path, station="rig1")
    assert (waiting(nameless), waiting(named)) == ([], ["a"])
    for database in (nameless, named):
        database.close()


def test_a_name_that_is_too_long_is_refused(database: Database) -> None:
    with pytest.raises(UnfitError):
        add(database, "n" * 101)
    assert waiting(database) == []
