"""Several transactions of one PostgreSQL at the same time: none loses what it writes, and none waits for ever."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import pytest

from backend.exports.importer import import_bundle
from backend.services.downloads import stream_bundle
from backend.storage import banks, results, runs, search_index, tags
from backend.storage.database import Database, Session, open_database
from backend.storage.orm import RunIndexRow
from backend.storage.results import NewResult
from backend.storage.runs import EndState
from backend.storage.search_index import ValueSource
from tests.exports.stored import tracked
from tests.postgres import new_database
from tests.storage.test_lineage import METRICS, NEW_RUN

MEANWHILE_S = 0.5
"""What waits for a lock does so by then."""


@pytest.fixture
def server(postgres: str, tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path, new_database(postgres, "at_once"))
    yield opened
    opened.close()


CHANGES: tuple[Callable[[Session, int], object], ...] = (
    lambda session, run: runs.end(session, run, EndState.COMPLETED),
    lambda session, run: results.add(session, NewResult(run, METRICS, (), "1")),
    lambda session, run: tags.add(session, run, "worn"),
    lambda session, run: runs.set_note(session, run, "slack"),
)


@pytest.mark.parametrize("first", CHANGES)
def test_two_changes_of_a_run_at_once_are_both_kept(server: Database, first: Callable[[Session, int], object]) -> None:
    with server.session() as session:
        run = runs.create(session, NEW_RUN).id
    others = [change for change in CHANGES if change is not first]
    at_work, go_on = Event(), Event()

    def change(one: Callable[[Session, int], object]) -> None:
        with server.session() as session:
            one(session, run)

    def begun() -> None:
        with server.session() as session:
            first(session, run)
            search_index.update(session, [run])
            at_work.set()
            assert go_on.wait(30)

    with ThreadPoolExecutor(4) as threads:
        held = threads.submit(begun)
        assert at_work.wait(30)
        waiting = [threads.submit(change, one) for one in others]
        time.sleep(MEANWHILE_S)
        go_on.set()
        for one in (held, *waiting):
            one.result(30)
    with server.reading() as session:
        found = runs.get(session, run)
        assert (found.end_state, found.note) == (EndState.COMPLETED, "slack")
        assert results.newest(session, run) is not None
        row = session.get_one(RunIndexRow, run)
        assert (row.end_state, row.note, row.outcome) == ("completed", "slack", "neutral")
        assert "worn" in row.words


def test_new_names_in_another_order_do_not_block_each_other(server: Database) -> None:
    one_has_one = Event()

    def give(names: tuple[str, str], wait: Callable[[], object]) -> None:
        with server.session() as session:
            search_index._get_name_number(session, ValueSource.METRIC, names[0])
            wait()
            search_index._get_name_number(session, ValueSource.METRIC, names[1])

    def first_waits() -> None:
        one_has_one.set()
        time.sleep(MEANWHILE_S)  # in which the other one gets its first, or waits for it

    with ThreadPoolExecutor(2) as threads:
        first = threads.submit(give, ("p", "q"), first_waits)
        assert one_has_one.wait(30)
        second = threads.submit(give, ("q", "p"), lambda: time.sleep(MEANWHILE_S))
        first.result(30)
        second.result(30)


def test_a_bundle_that_is_taken_in_twice_at_once_is_stored_once(server: Database, tmp_path: Path) -> None:
    here = open_database(tmp_path / "here")
    run = tracked(here)
    file = tmp_path / "run.zip"
    file.write_bytes(b"".join(stream_bundle(here, run, tmp_path)))
    here.close()
    with ThreadPoolExecutor(2) as threads:
        taken = list(threads.map(lambda who: import_bundle(server, file, who, tmp_path), ("Ana", "Ben")))
    assert sorted(one.new for one in taken) == [False, True]
    with server.reading() as session:
        assert runs.count(session) == 2
        assert [bank.version for bank in banks.find(session)] == [1]
