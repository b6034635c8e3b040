"""Every sample of a run is stored once, and gaps are told; how runs end is in test_run_ends."""

import itertools
import sqlite3
import threading
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import event

from backend.realtime.ring_buffer import Ring
from backend.realtime.supervisor import LoopExited
from backend.recording.codec import unpack
from backend.recording.reader import read_samples
from backend.recording.recorder import RecordingError
from backend.sample import INDEX, STORED_NAMES
from backend.storage import events, recordings
from backend.storage.database import Database
from backend.storage.runs import EndState
from tests.recording.stand_in import Writer, new_run, recorder_of, stored_run


def assert_stored(database: Database, run_id: int, rows: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    with database.reading() as session:
        samples = read_samples(session, run_id)
    np.testing.assert_allclose(samples.first_tick + samples.t / 1e-3, rows[:, INDEX["tick"]], atol=1e-6)
    assert set(samples.columns) == set(STORED_NAMES)
    for name, column in samples.columns.items():
        np.testing.assert_array_equal(column, rows[:, INDEX[name]].astype(np.float32), err_msg=name)


@pytest.mark.parametrize("lengths", [(1,), (999,), (1000,), (1001,), (2500,), (300, 1700)])
def test_all_samples_of_a_run_come_back(database: Database, writer: Writer, lengths: tuple[int, ...]) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    writer.write(37)
    written = []
    for length in lengths:
        written.append(writer.write(length, run.id))
        recorder.drain()
    writer.write(5)
    recorder.drain()
    assert_stored(database, run.id, np.concatenate(written))
    ended = stored_run(database, run.id)
    assert (ended.end_state, ended.end_detail) == (EndState.COMPLETED, "")
    with database.reading() as session:
        assert recordings.get(session, run.id).missed == 0
    recorder.close()


def test_runs_that_follow_each_other_are_kept_apart(database: Database, writer: Writer) -> None:
    first, second = new_run(database), new_run(database)
    recorder = recorder_of(writer, database)
    rows = [writer.write(450, first.id), writer.write(1200, second.id)]
    recorder.drain()
    assert stored_run(database, first.id).end_state == EndState.COMPLETED
    assert stored_run(database, second.id).end_state == EndState.RUNNING
    writer.write(1)
    recorder.close()
    assert_stored(database, first.id, rows[0])
    assert_stored(database, second.id, rows[1])


def test_a_recorder_left_behind_tells_the_gap(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    head = writer.write(1000, run.id)
    recorder.drain()
    writer.write(500, run.id)
    tail = writer.write(writer.ring.capacity - 1, run.id)
    recorder.drain()
    writer.write(1)
    recorder.close()
    assert_stored(database, run.id, np.concatenate((head, tail)))
    with database.reading() as session:
        recording = recordings.get(session, run.id)
    assert recording.missed == 500
    assert "500 samples from tick 1000 on were overwritten" in recording.problem


def test_a_run_whose_beginning_is_lost_says_so(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    writer.write(20)
    recorder.drain()
    writer.write(100, run.id)
    writer.write(writer.ring.capacity - 1, run.id)
    recorder.drain()
    with database.reading() as session:
        assert recordings.get(session, run.id).missed == 100


def test_dead_loop_ends_the_run_with_all_its_samples(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    rows = writer.write(1234, run.id)
    recorder.on_event(LoopExited("killed by SIGKILL"))
    recorder.drain()
    assert_stored(database, run.id, rows)
    ended = stored_run(database, run.id)
    assert ended.end_state == EndState.LINK_LOST
    assert "SIGKILL" in ended.end_detail
    successor = Writer(Ring.create(4096))
    recorder.follow(successor.ring)
    second = new_run(database)
    rows = successor.write(50, second.id)
    successor.write(1)
    recorder.drain()
    assert_stored(database, second.id, rows)
    recorder.close()


def test_closing_keeps_what_is_there_and_ends_the_run(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    rows = writer.write(1500, run.id)
    recorder.close()
    assert_stored(database, run.id, rows)
    assert stored_run(database, run.id).end_state == EndState.STOPPED


def test_samples_of_an_unknown_run_are_left_out_and_that_is_told(database: Database, writer: Writer) -> None:
    recorder = recorder_of(writer, database)
    writer.write(1500, run=99)
    known = new_run(database)
    rows = writer.write(10, known.id)
    writer.write(1)
    recorder.close()
    assert_stored(database, known.id, rows)
    with database.reading() as session:
        (told,) = events.find(session, kind="recording")
    assert "run 99" in told.text


def test_thread_records_while_the_loop_writes(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    recording = threading.Thread(target=recorder.run_recording)
    recording.start()
    rows = np.concatenate([writer.write(100, run.id) for _ in range(30)])
    writer.write(1)
    recorder.close()
    recording.join()
    assert_stored(database, run.id, rows)
    assert stored_run(database, run.id).end_state == EndState.COMPLETED


class Hindrance:
    """A pragma put on every connection: SQLite then refuses to write as on a full disk or a read-only file."""

    def __init__(self, database: Database) -> None:
        self.pragma = "PRAGMA query_only=OFF"
        event.listen(database.engine, "checkout", lambda connection, *_: connection.execute(self.pragma))


HINDRANCES = [
    ("PRAGMA max_page_count=60", "PRAGMA max_page_count=1000000", "disk is full"),
    ("PRAGMA query_only=ON", "PRAGMA query_only=OFF", "readonly"),
]


@pytest.mark.parametrize(("hinder", "relieve", "reason"), HINDRANCES)
def test_a_database_that_takes_nothing_is_reported_and_tried_again(
    database: Database, writer: Writer, hinder: str, relieve: str, reason: str
) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    hindrance = Hindrance(database)
    hindrance.pragma = hinder
    rows = [writer.write(3000, run.id)]
    recorder.drain()
    assert reason in recorder.problem
    assert "free space" in recorder.problem
    rows.append(writer.write(2000, run.id))
    recorder.drain()
    assert recorder.problem
    with database.reading() as session:
        for chunk in recordings.chunks(session, run.id, 0, 10_000):
            assert len(unpack(chunk.samples, len(STORED_NAMES))) == chunk.count == 1000
    hindrance.pragma = relieve
    recorder.drain()
    assert recorder.problem == ""
    writer.write(1)
    recorder.close()
    assert_stored(database, run.id, np.concatenate(rows))


def test_closing_on_a_database_that_takes_nothing_is_an_error(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    writer.write(1500, run.id)
    Hindrance(database).pragma = "PRAGMA query_only=ON"
    with pytest.raises(RecordingError, match="readonly"):
        recorder.close()
    assert stored_run(database, run.id).end_state == EndState.RUNNING


def test_locked_database_delays_nothing_but_the_storing(database: Database, writer: Writer, tmp_path: Path) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    rows = [writer.write(1000, run.id)]
    other = sqlite3.connect(tmp_path / "sinew.db", isolation_level=None, check_same_thread=False)
    other.execute("BEGIN IMMEDIATE")
    draining = threading.Thread(target=recorder.drain)
    draining.start()
    rows.append(writer.write(1000, run.id))
    other.execute("COMMIT")
    other.close()
    draining.join()
    writer.write(1)
    recorder.close()
    assert_stored(database, run.id, np.concatenate(rows))


def test_chunks_cover_the_run_without_overlap(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    for length in (1, 700, 1300, 999):
        writer.write(length, run.id)
        recorder.drain()
    writer.write(1)
    recorder.close()
    with database.reading() as session:
        chunks = list(recordings.chunks(session, run.id, 0, 10_000))
    assert [chunk.count for chunk in chunks] == [1000, 1000, 1000]
    ends = itertools.accumulate(chunk.count for chunk in chunks)
    assert [chunk.first_tick for chunk in chunks] == [0, *list(ends)[:-1]]


def test_seconds_that_waited_are_stored_as_each_would_have_been(database: Database, long_writer: Writer) -> None:
    at_once, one_by_one = new_run(database), new_run(database)
    recorder = recorder_of(long_writer, database)
    long_writer.write(41_300, at_once.id)
    recorder.drain()
    first = long_writer.ring.count
    for length in (*[1000] * 41, 300):
        long_writer.write(length, one_by_one.id)
        recorder.drain()
    long_writer.write(1)
    recorder.close()
    with database.reading() as session:
        ours = [(chunk.first_tick, chunk.count) for chunk in recordings.chunks(session, at_once.id, 0, first)]
        theirs = [
            (chunk.first_tick - first, chunk.count) for chunk in recordings.chunks(session, one_by_one.id, 0, 10**6)
        ]
        sizes = [
            sum(len(chunk.samples) + len(chunk.summary) for chunk in recordings.chunks(session, run.id, 0, 10**6))
            for run in (at_once, one_by_one)
        ]
        told = [recordings.get(session, run.id).size_bytes for run in (at_once, one_by_one)]
    assert ours == theirs
    assert told == sizes


def test_a_headless_station_drains_what_is_worth_it_and_each_end_that_is_told(
    database: Database, long_writer: Writer
) -> None:
    run = new_run(database)
    recorder = recorder_of(long_writer, database)
    counts = []
    for length in (19_999, 1, 500):
        long_writer.write(length, run.id)
        recorder.drain_if_due()
        with database.reading() as session:
            counts.append(sum(chunk.count for chunk in recordings.chunks(session, run.id, 0, 10**6)))
    assert counts == [0, 20_000, 20_000]
    long_writer.write(1)
    recorder.drain_if_due()
    assert stored_run(database, run.id).end_state == EndState.COMPLETED
    with database.reading() as session:
        assert recordings.span(session, run.id).end_tick == 20_500
    recorder.close()


@pytest.mark.parametrize("drained", [True, False], ids=["at once", "with what follows"])
@pytest.mark.parametrize(
    ("name", "value"),
    [("tick", 900.0), ("tick", np.nan), ("tick", 1000.5), ("tick", np.inf), ("run", np.nan), ("run", -1.0)],
)
def test_samples_that_cannot_follow_end_the_recording_of_their_run_alone(
    database: Database, writer: Writer, name: str, value: float, drained: bool
) -> None:
    run, following = new_run(database), new_run(database)
    recorder = recorder_of(writer, database)
    head = writer.write(1000, run.id)
    recorder.drain()
    writer.write(1, run.id)
    writer.ring.rows[(writer.ring.count - 1) % writer.ring.capacity, INDEX[name]] = value
    writer.write(300, run.id)
    if drained:
        recorder.drain()
        assert recorder.problem == ""
    writer.write(100, run.id)
    whole = writer.write(1500, following.id)
    writer.write(1)
    recorder.drain()
    recorder.close()
    assert_stored(database, run.id, head)
    assert_stored(database, following.id, whole)
    with database.reading() as session:
        assert recordings.get(session, run.id).missed == 401
        assert recordings.get(session, following.id).missed == 0
        (entry,) = events.find(session, kind=events.EventKind.RECORDING)
    assert (entry.tick, f"run {run.id}:" in entry.text) == (1000, True)
    assert stored_run(database, following.id).end_state == EndState.COMPLETED


def test_a_position_beyond_the_ring_is_noticed(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    recorder._position = 10**6
    recorder.drain()
    rows = writer.write(1500, run.id)
    writer.write(1)
    recorder.drain()
    assert_stored(database, run.id, rows)
    recorder.close()
