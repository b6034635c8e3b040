"""Several stations and transactions on one database."""

import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path
from threading import Barrier, Event

import pytest
from sqlalchemy import Connection, NullPool, create_engine, text

from backend.errors import STATION_NAME_LENGTH, RequestRejectedError, check_station_name
from backend.exports.importer import import_bundle
from backend.recording import retention
from backend.recording.retention import NotRemovableError, RetentionRule
from backend.services.downloads import stream_bundle
from backend.storage import (
    banks,
    commissioning,
    events,
    experiments,
    flights,
    identifications,
    recordings,
    results,
    runs,
    search,
    search_index,
    settings,
    tags,
)
from backend.storage.banks import BankEntry
from backend.storage.commissioning import NewStepResult
from backend.storage.database import Database, Session, open_database
from backend.storage.flights import NewFlight
from backend.storage.orm import RunIndexRow, UnknownRecordError
from backend.storage.recordings import Chunk
from backend.storage.results import NewResult
from backend.storage.runs import EndState
from backend.storage.search import parse_query
from backend.storage.search_index import ValueSource
from backend.storage.stations import HeldStation, StationTakenError, assign_unowned_rows
from tests.exports.stored import tracked
from tests.postgres import new_database
from tests.refusals import refused
from tests.storage.refused_search import refused_search
from tests.storage.test_lineage import METRICS, NEW_IDENTIFICATION, NEW_RUN

# Several stations on one database: what one of them writes, no other takes for its own.


@pytest.fixture
def stations(database: Database, tmp_path: Path) -> Iterator[tuple[Database, Database]]:
    """The database once more, opened by two stations."""
    url = database.engine.url.render_as_string(hide_password=False)
    with ExitStack() as stack:
        opened = [open_database(tmp_path / name, url, station=name) for name in ("rig-a", "rig-b")]
        for one in opened:
            stack.callback(one.close)
        yield opened[0], opened[1]


def test_each_station_has_its_own_data(stations: tuple[Database, Database]) -> None:
    step = NewStepResult("wiring", "card", "f" * 64, passed=False, text="", who="Ana")
    since = datetime.now(UTC) - timedelta(seconds=1)
    mine: list[dict[str, object]] = []
    for station in stations:
        with station.session() as session:
            run = runs.create(session, replace(NEW_RUN, note=f"at {station.station}"))
            identification = identifications.add(session, replace(NEW_IDENTIFICATION, run_id=run.id))
            bank = banks.add(session, "bench", [BankEntry(8.0, {})], who="Ana")
            settings.save(session, "active bank", bank.id, "Ana")
            settings.save(session, "search/mine", {"where": station.station}, "Ana")
            text_of = experiments.add(session, "battery", f"of {station.station}", "Ana")
            event = events.add(session, "trip", "too much force", run_id=run.id, tick=7)
            flights.add(session, NewFlight(event.id, "force_limit", 0, 7, 9, ["q"], b"xx"))
            failed = commissioning.add(session, step)
            passed = commissioning.add(session, replace(step, passed=True))
        mine.append(
            {
                "run": [run.id],
                "identification": [identification.id],
                "bank": [(bank.id, 1)],
                "setting": bank.id,
                "history": 1,
                "search": [{"where": station.station}],
                "experiment": [(text_of.id, 1, f"of {station.station}")],
                "event": [event.id],
                "between": [event.id],
                "flight": [event.id],
                "step": passed.id,
                "failure": failed.id,
                "passed": [passed.id],
            }
        )
    for station, expected in zip(stations, mine, strict=True):
        with station.reading() as session:
            active = settings.newest(session, "active bank")
            seen = {
                "run": [run.id for run in runs.find(session)],
                "identification": [one.id for one in identifications.find(session)],
                "bank": [(bank.id, bank.version) for bank in banks.find(session)],
                "setting": None if active is None else active.value,
                "history": len(settings.history(session, "active bank")),
                "search": [kept.value for kept in settings.newest_under(session, "search/")],
                "experiment": [(one.id, one.version, one.text) for one in experiments.newest(session)],
                "event": [event.id for event in events.find(session)],
                "between": [event.id for event in events.between(session, since, None)],
                "flight": [flight.event_id for flight in flights.find(session)],
                "step": commissioning.newest(session)["wiring"].id,
                "failure": commissioning.last_failure(session, "wiring"),
                "passed": [one.id for one in commissioning.passed_with(session, "f" * 64)],
            }
            assert seen == expected
            assert experiments.get(session, "battery").text == f"of {station.station}"


def test_a_start_closes_the_runs_of_its_own_station_only(stations: tuple[Database, Database]) -> None:
    a, b = stations
    with a.session() as session:
        of_a = runs.create(session, NEW_RUN).id
    with b.session() as session:
        of_b = runs.create(session, NEW_RUN).id
        assert runs.close_interrupted(session) == [of_b]
    with a.reading() as session:
        assert runs.get(session, of_a).end_state == EndState.RUNNING
        assert runs.get(session, of_b).end_state == EndState.SERVICE_DIED


def test_maintenance_does_not_affect_other_stations(stations: tuple[Database, Database]) -> None:
    a, b = stations
    numbers = []
    for station in stations:
        with station.session() as session:
            run = runs.create(session, NEW_RUN)
            recordings.begin(session, run.id, ["q"], 1e-3)
            recordings.add_chunks(session, run.id, [Chunk(0, 10, b"s", b"x" * 99)])
            runs.end(session, run.id, EndState.COMPLETED)
            for tick in range(3):
                event = events.add(session, "trip", "", tick=tick)
                flights.add(session, NewFlight(event.id, "force_limit", 0, tick, 9, ["q"], b"xx"))
        numbers.append(run.id)
    rule = RetentionRule(max_bytes=1, keep_days=0)
    assert [one.run_id for one in retention.summarize_retention(a, rule).may_go] == numbers[:1]
    assert retention.summarize_retention(a, rule).total_bytes == 100
    with refused(NotRemovableError, "runs_not_removable", refused=[numbers[1]]):
        retention.delete_recordings(a, rule, [numbers[1]], "Ana")
    retention.delete_recordings(a, rule, [numbers[0]], "Ana")
    with a.session() as session:
        assert flights.delete_oldest(session, records=1, size_bytes=10**9) == 2
    with b.reading() as session:
        assert len(flights.find(session)) == 3
        assert [one.run_id for one in recordings.load_held(session)] == numbers[1:]
        assert recordings.extent(session, numbers[1]).count == 10


def test_lists_show_the_own_station_by_default(stations: tuple[Database, Database]) -> None:
    a, b = stations
    numbers = []
    for station in stations:
        with station.session() as session:
            numbers.append(runs.create(session, NEW_RUN).id)
            tags.add(session, numbers[-1], "worn")
    of_a, of_b = numbers
    for query, everywhere, expected in (
        ("", False, [of_a]),
        ("", True, [of_b, of_a]),
        ("station = rig-b", False, [of_b]),
        ("station = RIG-B", False, [of_b]),
        ("station = rig-a, rig-b", False, [of_b, of_a]),
        ("station != rig-a", False, [of_b]),
        ("station ~ rig", False, [of_b, of_a]),
        ("tag = worn", False, [of_a]),
    ):
        with a.reading() as session:
            found = search.search(session, parse_query(query), everywhere=everywhere, limit=9)
            assert (list(found.run_ids), found.total) == (expected, len(expected))
    with a.session() as session:
        assert tags.rename(session, "worn", "old") == 1
    with b.reading() as session:
        assert tags.of_runs(session, numbers) == {of_a: ["old"], of_b: ["worn"]}
        assert search.known_words(session).stations == ("rig-a", "rig-b")


def test_station_names_are_case_sensitive(database: Database) -> None:
    for name in ("Rig", "rig", "Lab"):
        with Database(database.engine, station=name).session() as session:
            runs.create(session, NEW_RUN)
    with database.reading() as session:
        for query, expected in (("station = Rig", 1), ("station = rig", 2), ("station = lab", 3)):
            assert search.search(session, parse_query(query), everywhere=True, limit=9).run_ids == (expected,)
        with refused_search(11, "station_ambiguous", name="RIG", stations=["Rig", "rig"]):
            search.search(session, parse_query("station = RIG"), everywhere=True, limit=9)


def test_notes_and_tags_of_a_run_are_changed_only_at_its_station(stations: tuple[Database, Database]) -> None:
    a, b = stations
    with a.session() as session:
        run = runs.create(session, NEW_RUN).id
        tags.add(session, run, "worn")
    changes: tuple[Callable[[Session], object], ...] = (
        lambda session: tags.add(session, run, "mine"),
        lambda session: tags.take(session, run, "worn"),
        lambda session: runs.set_note(session, run, "overwritten"),
    )
    for change in changes:
        expected = refused(UnknownRecordError, "run_of_another_station", run_id=run, station="rig-a")
        with expected, b.session() as session:
            change(session)
    with a.reading() as session:
        assert (runs.get(session, run).note, tags.of_runs(session, [run])) == ("", {run: ["worn"]})


def test_a_bank_of_another_station_is_readable_but_cannot_be_active(stations: tuple[Database, Database]) -> None:
    a, b = stations
    with a.session() as session:
        bank = banks.add(session, "bench", [BankEntry(8.0, {})], who="Ana")
        assert banks.own(session, bank.id) == bank
    with b.reading() as session:
        assert banks.get(session, bank.id) == bank
        with refused(UnknownRecordError, "bank_of_another_station", bank_id=bank.id, station="rig-a"):
            banks.own(session, bank.id)


def test_other_processes_receive_the_station_with_the_database(stations: tuple[Database, Database]) -> None:
    again, arguments = stations[0].__reduce__()
    reopened = again(*arguments)
    assert reopened.station == "rig-a"
    reopened.close()


def test_data_without_a_station_is_assigned_to_one(database: Database, tmp_path: Path) -> None:
    url = database.engine.url.render_as_string(hide_password=False)
    with database.session() as session:
        run = runs.create(session, NEW_RUN)
        settings.save(session, "active bank", 3, "Ana")
        banks.add(session, "bench", [BankEntry(8.0, {})], who="Ana")
    with database.session() as session:
        assert assign_unowned_rows(session, "rig-a") == 1
    with (
        database.session() as session,
        refused(RequestRejectedError, "station_has_rows", station="rig-a", rows=1, table="run"),
    ):
        assign_unowned_rows(session, "rig-a")
    with closing(open_database(tmp_path / "a", url, station="rig-a")) as station, station.reading() as session:
        assert runs.count(session) == 1
        assert [bank.name for bank in banks.find(session)] == ["bench"]
        active = settings.newest(session, "active bank")
        assert active is not None
        assert active.value == 3
        for query in ("", "rig-a", "station = rig-a"):
            assert search.search(session, parse_query(query), everywhere=False, limit=9).run_ids == (run.id,)
    with database.reading() as session:
        assert runs.count(session) == 0
        assert settings.newest(session, "active bank") is None


def test_two_services_may_create_the_tables_simultaneously(postgres: str, tmp_path: Path) -> None:
    url = new_database(postgres, "at_once")
    together = Barrier(2)

    def open_as(name: str) -> str:
        together.wait(30)
        database = open_database(tmp_path / name, url, station=name)
        with database.session() as session:
            runs.create(session, NEW_RUN)
        database.close()
        return database.station

    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(open_as, ("rig-a", "rig-b"))) == ["rig-a", "rig-b"]


@pytest.mark.parametrize("name", ["-a", "a b", "a/b", "ä", "a" * (STATION_NAME_LENGTH + 1), "\n", ".a"])
def test_invalid_station_names_are_rejected(name: str) -> None:
    with pytest.raises(ValueError, match="letters, digits"):
        check_station_name(name)


@pytest.mark.parametrize("name", ["", "a", "rig-2", "Lab.1_x", "a" * STATION_NAME_LENGTH])
def test_station_names_are_stored_unchanged(name: str) -> None:
    assert check_station_name(name) == name


# One service works for a station, and another may as soon as it does not, however it ended.


def test_a_server_accepts_one_service_per_station(postgres: str) -> None:
    engines = [create_engine(postgres, poolclass=NullPool) for _ in range(3)]
    first, other = HeldStation(engines[0], "rig-a"), HeldStation(engines[1], "rig-b")
    with refused(StationTakenError, "station_taken", service="another service", station="rig-a"):
        HeldStation(engines[2], "rig-a")
    first.release()
    HeldStation(engines[2], "rig-a").release()
    other.release()


def test_a_station_is_free_before_its_connection_has_ended(postgres: str) -> None:
    engine, other = (create_engine(postgres) for _ in range(2))
    held = HeldStation(engine, "rig-a")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Connection, "invalidate", lambda self: None)
        patch.setattr(Connection, "close", lambda self: None)
        held.release()
    HeldStation(other, "rig-a").release()
    engine.dispose()
    other.dispose()


def test_the_lock_of_a_killed_service_is_released(postgres: str) -> None:
    engine, other = (create_engine(postgres) for _ in range(2))
    held = HeldStation(engine, "rig-a")
    with other.connect() as connection:
        connection.execute(text("SELECT pg_terminate_backend(pid, 5000) FROM pg_locks WHERE locktype = 'advisory'"))
    HeldStation(other, "rig-a").release()
    held.release()
    engine.dispose()
    other.dispose()


# Several transactions of one PostgreSQL at the same time: none loses what it writes, and none waits for ever.

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
def test_two_simultaneous_changes_of_a_run_are_both_stored(
    server: Database, first: Callable[[Session, int], object]
) -> None:
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


def test_new_names_in_different_orders_do_not_deadlock(server: Database) -> None:
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


def test_a_bundle_imported_twice_simultaneously_is_stored_once(server: Database, tmp_path: Path) -> None:
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
