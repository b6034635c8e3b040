"""Flight records: every tick from ten seconds before each trip to five after it."""

import asyncio
import sqlite3
from collections.abc import Callable
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import Stopped
from backend.realtime.ring_buffer import Ring
from backend.realtime.supervisor import LoopExited
from backend.recording import messages
from backend.recording.flight import DIED, POLL_S, FlightRecorder, Quota, read_flight_columns
from backend.sample import INDEX
from backend.storage import events, flights
from backend.storage.database import Database
from backend.storage.orm import StorageError, UnknownRecordError
from plant.interface import T_s
from tests.recording.stand_in import Writer, new_run, read_problem
from tests.refusals import refused

QUOTA = Quota(100, 10**9)


@pytest.fixture
def writer() -> Writer:
    return Writer(Ring.create(65536))


def stored(database: Database) -> list[flights.Flight]:
    with database.reading() as session:
        return flights.find(session)


def trip(tick: int, fault: Fault = Fault.SLACK) -> Stopped:
    return Stopped(fault, True, tick, tick, 0.1, "F_A = 0.2 N")


def test_a_flight_record_has_all_ticks_from_ten_seconds_before_to_five_after(
    database: Database, writer: Writer
) -> None:
    run = new_run(database)
    recorder = FlightRecorder(database, lambda: writer.ring, QUOTA)
    before = writer.write(20_000, run=run.id)
    recorder.on_event(trip(20_000))
    after = [writer.write(4_999, fault=FAULT_CODE[Fault.SLACK])]
    recorder.drain()
    assert stored(database) == []
    after.append(writer.write(1, fault=FAULT_CODE[Fault.SLACK]))
    recorder.drain()
    (flight,) = stored(database)
    assert (flight.fault, flight.run_id, flight.first_tick, flight.count) == ("slack", run.id, 10_000, 15_000)
    assert "F_A = 0.2 N" in flight.text
    columns = read_flight_columns(database, flight.event_id)
    rows = np.concatenate((before[10_000:], *after))
    for name in ("q", "F_A", "fault", "run"):
        np.testing.assert_array_equal(columns[name], rows[:, INDEX[name]].astype(np.float32))
    assert (columns["t"][0], columns["t"][10_000], columns["t"][-1]) == (-10.0, 0.0, pytest.approx(4.999))


def test_a_trip_whose_loop_was_replaced_is_stored_at_once(database: Database, writer: Writer) -> None:
    """A reset replaces the loop where the watchdog is dead; this is not reported as the death of the loop."""
    present = writer
    recorder = FlightRecorder(database, lambda: present.ring, QUOTA)
    writer.write(1_000)
    recorder.on_event(trip(1_000, Fault.WATCHDOG_DEAD))
    writer.write(300)
    recorder.drain()
    assert stored(database) == []
    present = Writer(Ring.create(65536))
    recorder.drain()
    (flight,) = stored(database)
    assert (flight.fault, flight.count) == ("watchdog_dead", 1_300)


def test_a_flight_record_has_the_time_of_its_trip_in_the_event_log(database: Database, writer: Writer) -> None:
    recorder = FlightRecorder(database, lambda: writer.ring, QUOTA)
    writer.write(3_000)
    since = datetime.now(UTC)
    recorder.on_event(trip(3_000))
    until = datetime.now(UTC)
    # a trip that is heard of late, as after a busy second of the service
    writer.write(13_000)
    hearing = datetime.now(UTC)
    recorder.on_event(trip(10_000, Fault.STOP_PRESSED))
    heard = datetime.now(UTC)
    with database.session() as session:
        reset = events.add(session, "fault", "reset", at=heard + timedelta(seconds=2))
    writer.write(5_000)
    recorder.drain()
    late, first = stored(database)
    assert since <= first.at <= until
    early, rounding = timedelta(seconds=6.0), timedelta(milliseconds=2)
    assert hearing - early - rounding <= late.at <= heard - early + rounding
    with database.reading() as session:
        told = events.between(session, since - timedelta(seconds=10), None)
        assert [event.text for event in events.find(session)] == [event.text for event in reversed(told)]
    assert [event.id for event in told] == [late.event_id, first.event_id, reset.id]


def test_trips_in_quick_succession_share_one_flight_record(database: Database, writer: Writer) -> None:
    recorder = FlightRecorder(database, lambda: writer.ring, QUOTA)
    writer.write(3_000)
    recorder.on_event(trip(3_000))
    writer.write(1_000)
    recorder.on_event(trip(4_000, Fault.STOP_PRESSED))
    writer.write(6_000)
    recorder.drain()
    (flight,) = stored(database)
    assert (flight.fault, flight.trip_tick, flight.first_tick, flight.count) == ("slack", 3_000, 0, 8_000)
    told = messages.following_trip(fault="stop_pressed", delay_s=1.0)
    assert f"Followed by {told}." in flight.text


def test_a_fault_in_every_tick_gives_one_flight_record_per_five_seconds(database: Database, writer: Writer) -> None:
    recorder = FlightRecorder(database, lambda: writer.ring, QUOTA)
    writer.write(10_000)
    for tick in range(10_000, 13_000):
        recorder.on_event(trip(tick, Fault.PLANT_ERROR))
        writer.write(1)
    writer.write(12_000)
    recorder.on_event(trip(25_000, Fault.PLANT_ERROR))
    writer.write(5_000)
    recorder.drain()
    later, first = stored(database)
    assert (first.trip_tick, first.count) == (10_000, 15_000)
    told = [messages.following_trip(fault="plant_error", delay_s=ticks * T_s) for ticks in range(1, 6)]
    assert first.text.endswith(f"Followed by {messages.following_trips(trips=told, others=2994)}.")
    assert (later.trip_tick, later.count) == (25_000, 15_000)


@pytest.mark.parametrize(("quota", "kept"), [(Quota(2, 10**9), 2), (Quota(100, 1), 1)])
def test_new_flight_records_replace_the_oldest_and_an_event_reports_it(
    database: Database, writer: Writer, quota: Quota, kept: int
) -> None:
    recorder = FlightRecorder(database, lambda: writer.ring, quota)
    for turn in range(4):
        recorder.on_event(trip(6_000 * turn))
        writer.write(6_000)
        recorder.drain()
    assert [flight.trip_tick for flight in stored(database)] == [18_000, 12_000, 6_000, 0][:kept]
    with database.reading() as session:
        told = [event.text for event in events.find(session, limit=100)]
    assert sum("were deleted" in text for text in told) == 4 - kept
    assert sum("F_A = 0.2 N" in text for text in told) == 4, "the events of the trips stay"


def test_the_death_of_the_loop_ends_pending_records_and_has_its_own_record(database: Database, writer: Writer) -> None:
    recorder = FlightRecorder(database, lambda: writer.ring, QUOTA)
    writer.write(12_000)
    recorder.on_event(trip(12_000))
    writer.write(100)
    recorder.on_event(LoopExited("killed by SIGKILL"))
    recorder.drain()
    death, slack = stored(database)
    assert (slack.fault, slack.count) == ("slack", 10_100)
    assert (death.fault, death.trip_tick, death.count) == (DIED, 12_100, 10_000)


def test_a_failed_flight_record_is_reported_and_retried(
    database: Database, writer: Writer, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = FlightRecorder(database, lambda: writer.ring, QUOTA)
    writer.write(9_000)
    recorder.on_event(trip(3_000))
    with monkeypatch.context() as full:
        full.setattr(flights, "add", _disk_full)
        recorder.drain()
        assert read_problem(recorder.problem) == ("flight_record_not_stored", "database or disk is full")
        assert stored(database) == []
    recorder.drain()
    assert recorder.problem == ""
    assert len(stored(database)) == 1


def _disk_full(*_: object) -> None:
    raise StorageError("database or disk is full")


def test_a_loop_may_die_while_a_trip_is_stored(database: Database, writer: Writer, tmp_path: Path) -> None:
    """The event loop changes the pending list while a thread stores from it."""

    async def session() -> None:
        recorder = FlightRecorder(database, lambda: writer.ring, QUOTA)
        running = asyncio.create_task(recorder.run())
        other = sqlite3.connect(tmp_path / "sinew.db", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        writer.write(6_000)
        recorder.on_event(trip(1_000))
        await asyncio.sleep(2 * POLL_S)  # the thread waits for the database by now
        recorder.on_event(LoopExited("killed by SIGKILL"))
        other.execute("COMMIT")
        other.close()
        await _until(lambda: len(stored(database)) >= 2)
        await asyncio.sleep(2 * POLL_S)
        recorder.on_event(trip(900))
        await _until(lambda: any(flight.trip_tick == 900 for flight in stored(database)))
        assert not running.done()
        running.cancel()

    asyncio.run(asyncio.wait_for(session(), 30.0))
    assert sorted((flight.fault, flight.trip_tick) for flight in stored(database)) == [
        (DIED, 6_000),
        ("slack", 900),
        ("slack", 1_000),
    ]


async def _until(reached: Callable[[], bool]) -> None:
    while not reached():
        await asyncio.sleep(0.01)


def test_pending_flight_records_are_stored_when_the_service_ends(database: Database, writer: Writer) -> None:
    recorder = FlightRecorder(database, lambda: writer.ring, QUOTA)
    writer.write(2_000)
    recorder.on_event(trip(1_500))
    recorder.close()
    assert [flight.count for flight in stored(database)] == [2_000]


def test_an_unknown_flight_record_is_reported(database: Database) -> None:
    with refused(UnknownRecordError, "record_not_found", record="flight record", number=7):
        read_flight_columns(database, 7)
