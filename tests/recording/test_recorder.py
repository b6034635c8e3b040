"""Recorded runs: samples, gaps, ends, obstacles, and a real loop."""

import asyncio
import itertools
import sqlite3
import threading
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import event

from backend.faults import FAULT_CODE, Fault
from backend.models.run import MAX_WALL_CHANGES, StoredWall, build_stored_wall, find_wall_at, merge_wall_changes
from backend.realtime.commands import Accepted, PretensionReached, RunEnded, SetMode, SetReferences, Stop, WallChanged
from backend.realtime.gains import make_tuning_command
from backend.realtime.headless import SimulatedLoop
from backend.realtime.modes import MODE_CODE, Cause, Mode, ModeCause
from backend.realtime.ring_buffer import Ring
from backend.realtime.supervisor import LoopExited
from backend.recording import messages
from backend.recording.codec import unpack
from backend.recording.reader import read_envelope, read_samples
from backend.recording.recorder import ObstacleChanges, Recorder, RecordingError
from backend.sample import INDEX, STORED_NAMES
from backend.storage import events, recordings
from backend.storage.database import Database
from backend.storage.runs import EndState
from backend.tuning.gains import TuningParameters
from plant.dynamics import Obstacle
from plant.parameters import load_parameters
from plant.simulator import Simulator
from tests.recording.stand_in import Writer, new_run, read_problem, recorder_of, stored_run
from tests.refusals import refused

# Every sample of a run is stored once, and gaps are reported; the ends of runs are tested below.


def assert_stored(database: Database, run_id: int, rows: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    with database.reading() as session:
        samples = read_samples(session, run_id)
    np.testing.assert_allclose(samples.first_tick + samples.t / 1e-3, rows[:, INDEX["tick"]], atol=1e-6)
    assert set(samples.columns) == set(STORED_NAMES)
    for name, column in samples.columns.items():
        np.testing.assert_array_equal(column, rows[:, INDEX[name]].astype(np.float32), err_msg=name)


@pytest.mark.parametrize("lengths", [(1,), (999,), (1000,), (1001,), (2500,), (300, 1700)])
def test_all_samples_of_a_run_are_read_back(database: Database, writer: Writer, lengths: tuple[int, ...]) -> None:
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


def test_consecutive_runs_are_stored_separately(database: Database, writer: Writer) -> None:
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


def test_an_overtaken_recorder_reports_the_gap(database: Database, writer: Writer) -> None:
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
    assert recording.problem == messages.samples_overwritten(count=500, tick=1000)


def test_a_run_without_its_beginning_reports_the_gap(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    writer.write(20)
    recorder.drain()
    writer.write(100, run.id)
    writer.write(writer.ring.capacity - 1, run.id)
    recorder.drain()
    with database.reading() as session:
        assert recordings.get(session, run.id).missed == 100


def test_a_dead_loop_ends_the_run_with_all_its_samples(database: Database, writer: Writer) -> None:
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


def test_closing_stores_the_samples_and_ends_the_run(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    rows = writer.write(1500, run.id)
    recorder.close()
    assert_stored(database, run.id, rows)
    assert stored_run(database, run.id).end_state == EndState.STOPPED


def test_samples_of_an_unknown_run_are_skipped_and_reported(database: Database, writer: Writer) -> None:
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


def test_the_recorder_thread_records_while_the_loop_writes(database: Database, writer: Writer) -> None:
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
    """A pragma on every connection: SQLite then rejects writes as on a full disk or a read-only file."""

    def __init__(self, database: Database) -> None:
        self.pragma = "PRAGMA query_only=OFF"
        event.listen(database.engine, "checkout", lambda connection, *_: connection.execute(self.pragma))


HINDRANCES = [
    ("PRAGMA max_page_count=60", "PRAGMA max_page_count=1000000", "database or disk is full"),
    ("PRAGMA query_only=ON", "PRAGMA query_only=OFF", "attempt to write a readonly database"),
]


@pytest.mark.parametrize(("hinder", "relieve", "reason"), HINDRANCES)
def test_an_unwritable_database_is_reported_and_retried(
    database: Database, writer: Writer, hinder: str, relieve: str, reason: str
) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    hindrance = Hindrance(database)
    hindrance.pragma = hinder
    rows = [writer.write(3000, run.id)]
    recorder.drain()
    assert read_problem(recorder.problem) == ("database_takes_no_samples", reason)
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


def test_closing_on_an_unwritable_database_raises(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    writer.write(1500, run.id)
    Hindrance(database).pragma = "PRAGMA query_only=ON"
    reason = "attempt to write a readonly database"
    with refused(RecordingError, "database_takes_no_samples", reason=reason):
        recorder.close()
    assert stored_run(database, run.id).end_state == EndState.RUNNING


def test_a_locked_database_delays_only_the_storage(database: Database, writer: Writer, tmp_path: Path) -> None:
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


def test_delayed_seconds_are_stored_like_immediate_ones(database: Database, long_writer: Writer) -> None:
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


def test_a_headless_recorder_drains_large_batches_and_each_reported_end(
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
def test_samples_out_of_order_end_only_the_recording_of_their_run(
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


def test_a_position_beyond_the_ring_buffer_is_detected(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    recorder._position = 10**6
    recorder.drain()
    rows = writer.write(1500, run.id)
    writer.write(1)
    recorder.drain()
    assert_stored(database, run.id, rows)
    recorder.close()


# How a run ended: as the loop says it, whatever is stored when, and as what is known where the loop says nothing.

EARLY = messages.program_stopped()


@pytest.mark.parametrize(
    ("why", "detail", "end_state", "kept"),
    [
        (Cause.ASKED_FOR, "", EndState.STOPPED, EARLY),
        (Fault.STOP_PRESSED, "", EndState.STOPPED, "stop_pressed"),
        (Fault.OPERATOR_LOST, "", EndState.LINK_LOST, "operator_lost"),
        (Fault.SERVICE_LOST, "", EndState.SERVICE_DIED, "service_lost"),
        (
            Fault.FORCE_LIMIT,
            "F_A = 161 N",
            EndState.TRIPPED,
            messages.stopped_by_fault(fault="force_limit", detail="F_A = 161 N"),
        ),
        (Fault.SERVICE_ENDED, "service ended by SIGTERM", EndState.STOPPED, "service ended by SIGTERM"),
    ],
)
@pytest.mark.parametrize("told", ["before its samples are stored", "between", "after them", "after the next began"])
def test_a_run_gets_the_end_state_of_the_loop_whenever_it_is_reported(
    database: Database, writer: Writer, told: str, why: ModeCause, detail: str, end_state: EndState, kept: str
) -> None:
    run, following = new_run(database), new_run(database)
    recorder = Recorder(database, writer.ring)
    end = RunEnded(tick=1010, run=run.id, completed=False, why=why, detail=detail)
    writer.write(1010, run.id)
    if told == "before its samples are stored":
        recorder.on_event(end)
    recorder.drain()
    if told == "between":
        recorder.on_event(end)
    writer.write(1)
    recorder.drain()
    if told == "after them":
        recorder.on_event(end)
    writer.write(1100, following.id)
    recorder.drain()
    if told == "after the next began":
        assert stored_run(database, run.id).end_state == EndState.RUNNING
        recorder.on_event(end)
    recorder.drain()
    ended = stored_run(database, run.id)
    assert (ended.end_state, ended.end_detail) == (end_state, kept)
    assert stored_run(database, following.id).end_state == EndState.RUNNING
    recorder.close()


def test_a_fault_in_the_samples_does_not_end_the_run(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = Recorder(database, writer.ring)
    writer.write(10, run.id)
    writer.write(1, fault=FAULT_CODE[Fault.SLACK])
    recorder.drain()
    assert stored_run(database, run.id).end_state == EndState.RUNNING
    recorder.on_event(LoopExited("killed by SIGKILL"))
    recorder.drain()
    ended = stored_run(database, run.id)
    assert (ended.end_state, ended.end_detail) == (EndState.LINK_LOST, messages.loop_died(reason="killed by SIGKILL"))


@pytest.mark.parametrize("sampled", [0, 10])
def test_an_end_reported_before_the_loop_died_remains(database: Database, writer: Writer, sampled: int) -> None:
    """Also if the run ended before its first sample."""
    run, open_still = new_run(database), new_run(database)
    recorder = Recorder(database, writer.ring)
    if sampled:
        writer.write(sampled, run.id)
    recorder.on_event(RunEnded(sampled, run.id, completed=False, why=Fault.STOP_PRESSED))
    writer.write(10, open_still.id)
    recorder.on_event(LoopExited("killed by SIGKILL"))
    recorder.follow(Ring.create(16))
    recorder.drain()
    ended = [stored_run(database, one.id) for one in (run, open_still)]
    assert [one.end_state for one in ended] == [EndState.STOPPED, EndState.LINK_LOST]
    assert ended[0].end_detail == "stop_pressed"


def test_programs_ended_early_are_all_stopped_though_their_samples_are_stored_at_once(
    database: Database, writer: Writer
) -> None:
    format_early_end = [new_run(database), new_run(database)]
    complete = new_run(database)
    recorder = Recorder(database, writer.ring)
    for run in (*format_early_end, complete):
        writer.write(10, run.id)
        recorder.on_event(RunEnded(10, run.id, completed=run is complete, why=Cause.ASKED_FOR))
    writer.write(1)
    recorder.drain()
    stopped = [stored_run(database, run.id) for run in format_early_end]
    assert [(run.end_state, run.end_detail) for run in stopped] == [(EndState.STOPPED, EARLY)] * 2
    assert stored_run(database, complete.id).end_state == EndState.COMPLETED


# Obstacles stored with a run: those active in its samples, whenever they were reported.

ABOVE, BELOW = Obstacle(1.0, 0.3, 2e4, 1.0), Obstacle(-1.0, -0.4, 5e3, 0.0)
DOWN = StoredWall(0.0, 0.0, 0.0, 0.0, 0.0)


def test_a_run_stores_the_obstacles_of_its_samples_and_the_next_the_active_one(
    database: Database, writer: Writer
) -> None:
    recorder = recorder_of(writer, database)
    first, second, third = (new_run(database).id for _ in range(3))
    recorder.on_event(WallChanged(100, 0, BELOW))
    recorder.on_event(WallChanged(200, 0, ABOVE))
    writer.write(500)  # of no run: what stood last stands when the first begins, at 500
    writer.write(700, run=first)
    recorder.drain()
    recorder.on_event(WallChanged(900, 0, None))  # told late: nothing of that second is stored yet
    recorder.on_event(WallChanged(1250, 0, BELOW))  # in the second run's samples, told while the first is recorded
    writer.write(600, run=second)
    recorder.drain()
    recorder.on_event(WallChanged(1850, 0, None))  # between the second and the third
    writer.write(100)
    writer.write(2500, run=third)
    recorder.drain()
    recorder.on_event(WallChanged(2950, 0, ABOVE))  # in a second that is stored already: told too late, and kept
    writer.write(1100, run=third)
    writer.write(1)
    recorder.drain()
    kept = [stored_run(database, run).set_to.walls for run in (first, second, third)]
    assert kept[0] == (build_stored_wall(0.0, ABOVE), build_stored_wall(0.4, None))
    assert kept[1] == (build_stored_wall(0.05, BELOW),)
    assert kept[2] == (build_stored_wall(1.05, ABOVE),)


def test_runs_without_obstacles_and_of_a_new_loop_store_none(database: Database, writer: Writer) -> None:
    recorder = recorder_of(writer, database)
    first, second = new_run(database).id, new_run(database).id
    writer.write(300, run=first)
    writer.write(1)
    recorder.on_event(WallChanged(301, 0, ABOVE))
    recorder.drain()
    assert stored_run(database, first).set_to.walls is None
    assert "walls" not in stored_run(database, first).settings
    recorder.follow(writer.ring)  # another process: nothing stands in its plant's way
    recorder._position = writer.ring.count
    recorder._drain()
    recorder._position = writer.ring.count
    writer.write(300, run=second)
    writer.write(1)
    recorder.drain()
    assert stored_run(database, second).set_to.walls is None


def test_the_obstacle_at_a_time_is_found() -> None:
    changes = merge_wall_changes(
        [build_stored_wall(0.5, ABOVE), build_stored_wall(0.2, BELOW)],
        [build_stored_wall(0.9, None), build_stored_wall(0.5, BELOW)],
    )
    assert [find_wall_at(changes, t) for t in (0.1, 0.2, 0.5, 0.899, 0.9, 5.0)] == [
        None,
        BELOW,
        BELOW,
        BELOW,
        None,
        None,
    ]
    many = merge_wall_changes((), [build_stored_wall(float(t), ABOVE) for t in range(MAX_WALL_CHANGES + 10)])
    assert len(many) == MAX_WALL_CHANGES
    assert find_wall_at(many, MAX_WALL_CHANGES - 2.0) == ABOVE
    assert find_wall_at(many, MAX_WALL_CHANGES + 5.0) is None


def test_only_the_last_obstacle_change_before_a_run_is_stored() -> None:
    walls = ObstacleChanges()
    for tick in range(12_000):
        walls.add(WallChanged(tick, 0, ABOVE if tick % 2 else None))
    walls.begin(20_000)
    assert walls.until(21_000) == [build_stored_wall(0.0, ABOVE)]
    walls.discard_until(21_000)
    assert walls.until(22_000) == []


# The real loop on the simulator, recorded: every tick of the run is in the database as it was in the ring.


def test_a_session_on_the_simulator_is_recorded_completely(database: Database) -> None:
    async def session() -> None:
        parameters = load_parameters("lab")
        recorders: list[Recorder] = []

        def record(_ring: Ring) -> None:
            for recorder in recorders:
                recorder.drain()

        headless = SimulatedLoop(
            Simulator(parameters, seed=3), parameters, make_tuning_command(parameters, TuningParameters()), record
        )
        recorders.append(Recorder(database, headless.ring))
        headless.listen(recorders[0].on_event)
        reached: list[object] = []
        headless.listen(lambda event: reached.append(event) if isinstance(event, PretensionReached) else None)
        await headless.send(SetMode(Mode.PRETENSION))
        await headless.advance_until(lambda: bool(reached), timeout_s=60.0)
        run = new_run(database)
        assert isinstance(await headless.send(SetMode(Mode.RUN, run=run.id)), Accepted)
        start = headless.ring.count
        await headless.send(SetReferences(0.2, 10.0))
        await headless.advance(3.21)
        end = headless.ring.count
        await headless.send(Stop(hard=False))
        await headless.advance(1.0)
        headless.close()
        recorders[0].close()

        ended = stored_run(database, run.id)
        assert (ended.end_state, ended.end_detail) == (EndState.STOPPED, Fault.STOP_PRESSED)
        _, rows, _ = headless.ring.read(start, end - start)
        with database.reading() as reading:
            samples = read_samples(reading, run.id)
            envelope = read_envelope(reading, run.id, points=50, names=["q"])
            recording = recordings.get(reading, run.id)
            packed = sum(len(chunk.samples) for chunk in recordings.chunks(reading, run.id, 0, 2**40))
        assert recording.missed == 0
        assert samples.first_tick == start
        assert len(samples.t) == 3210
        assert np.all(samples.columns["mode"] == MODE_CODE[Mode.RUN])
        for name in STORED_NAMES:
            np.testing.assert_array_equal(samples.columns[name], rows[:, INDEX[name]].astype(np.float32), err_msg=name)
        assert np.nanmax(envelope.maximum["q"]) == samples.columns["q"].max() > 0.15
        assert packed < 0.4 * len(rows) * len(STORED_NAMES) * 4

    asyncio.run(session())
