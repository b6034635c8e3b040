"""Recorders that are killed, and databases that cannot be written."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import event

from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import RunEnded
from backend.realtime.ring_buffer import Ring
from backend.recording import messages
from backend.recording.reader import read_samples
from backend.recording.recorder import Recorder, RecordingError
from backend.sample import INDEX
from backend.storage import recordings, runs
from backend.storage.database import Database, Session, find_database_errors, open_database
from backend.storage.runs import EndState
from tests.recording.stand_in import Writer, new_run, read_problem, recorder_of, stored_run
from tests.refusals import refused

# A recorder killed while it writes loses nothing that was committed, and leaves nothing half-written.

ROOT = Path(__file__).parents[2]
STAND_IN = Path(__file__).with_name("recorder_stand_in.py")


def test_a_killed_recorder_loses_at_most_the_last_second(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    run = new_run(database)
    writer = Writer(Ring.create(65536))
    command = [sys.executable, str(STAND_IN), str(writer.ring.fd), str(tmp_path)]
    recorder = subprocess.Popen(
        command, pass_fds=[writer.ring.fd], stdout=subprocess.PIPE, text=True, env={"PYTHONPATH": str(ROOT)}
    )
    assert recorder.stdout is not None
    recorder.stdout.readline()
    rows = np.concatenate([writer.write(500, run.id) for _ in range(31)])
    committed = 0
    for line in recorder.stdout:
        committed = int(line)
        if committed >= 4000:
            break
    recorder.kill()
    remaining, _ = recorder.communicate()
    committed = max([committed, *map(int, remaining.split()[:-1])])
    with database.session() as session:
        samples = read_samples(session, run.id)
        assert runs.close_interrupted(session) == [run.id]
    kept = len(samples.t)
    assert kept >= committed
    np.testing.assert_array_equal(samples.columns["q"], rows[:kept, INDEX["q"]].astype(np.float32))
    with database.reading() as session:
        assert runs.get(session, run.id).end_state == EndState.SERVICE_DIED
    database.close()
    writer.ring.close()


def test_a_drained_recorder_is_less_than_a_second_behind(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    run = new_run(database)
    writer = Writer(Ring.create(65536))
    command = [sys.executable, str(STAND_IN), str(writer.ring.fd), str(tmp_path)]
    with subprocess.Popen(
        command, pass_fds=[writer.ring.fd], stdout=subprocess.PIPE, text=True, env={"PYTHONPATH": str(ROOT)}
    ) as recorder:
        assert recorder.stdout is not None
        recorder.stdout.readline()
        writer.write(3999, run.id)
        for line in recorder.stdout:
            if int(line) > 2999:
                break
        recorder.kill()
    with database.reading() as session:
        assert len(read_samples(session, run.id).t) == 3000
    database.close()
    writer.ring.close()


class DeadlyDatabase(Database):
    """Ends the thread that uses it right after a commit, once."""

    def __init__(self, database: Database, commits: int) -> None:
        super().__init__(database.engine)
        self._commits_left = commits

    @contextmanager
    def session(self) -> Iterator[Session]:
        with super().session() as session:
            yield session
        self._commits_left -= 1
        if self._commits_left == 0:
            raise SystemExit


@pytest.mark.parametrize("commits", [1, 2, 3, 4], ids=["the beginning", "twenty seconds", "what is left", "the end"])
def test_a_recorder_that_dies_after_a_commit_continues_from_there(
    database: Database, long_writer: Writer, commits: int
) -> None:
    run = new_run(database)
    recorder = recorder_of(long_writer, DeadlyDatabase(database, commits))
    written = long_writer.write(20_500, run.id)
    long_writer.write(1)
    with pytest.raises(SystemExit):
        recorder.drain()
    recorder.drain()
    recorder.close()
    assert recorder.problem == ""
    with database.reading() as session:
        ended, stored = runs.get(session, run.id), read_samples(session, run.id)
        recording = recordings.get(session, run.id)
    assert ended.end_state == EndState.COMPLETED
    np.testing.assert_allclose(stored.columns["q"], written[:, INDEX["q"]], rtol=1e-6)
    assert (recording.missed, recording.problem) == (0, "")


def test_a_run_aborted_before_its_first_samples_are_read_gets_their_end_state(
    database: Database, writer: Writer
) -> None:
    run = new_run(database)
    recorder = Recorder(database, writer.ring)
    with database.session() as session:
        runs.end(session, run.id, EndState.SERVICE_DIED, "aborted: service ended by SIGTERM")
    writer.write(10, run.id)
    writer.write(1, fault=FAULT_CODE[Fault.SERVICE_ENDED])
    recorder.on_event(RunEnded(10, run.id, completed=False, why=Fault.SERVICE_ENDED, detail="service ended by SIGTERM"))
    recorder.close()
    with database.reading() as session:
        ended, stored = runs.get(session, run.id), read_samples(session, run.id)
    assert (ended.end_state, ended.end_detail) == (EndState.STOPPED, "service ended by SIGTERM")
    assert len(stored.t) == 10


# A full disk and a read-only database, as SQLite rejects them: reported, and no partial write.


def fill(database: Database) -> None:
    """Prevent any growth of the file from here on, as on a full disk."""
    _for_all_connections(database, "PRAGMA max_page_count=1")


def make_read_only(database: Database) -> None:
    _for_all_connections(database, "PRAGMA query_only=ON")


def _for_all_connections(database: Database, pragma: str) -> None:
    event.listen(database.engine, "connect", lambda connection, _record: connection.execute(pragma))
    database.engine.dispose()


def repair(database: Database) -> None:
    _for_all_connections(database, "PRAGMA query_only=OFF")
    _for_all_connections(database, "PRAGMA max_page_count=1073741823")


@pytest.mark.parametrize(
    ("breaks", "words"), [(fill, "database or disk is full"), (make_read_only, "attempt to write a readonly database")]
)
def test_samples_wait_in_the_ring_buffer_and_none_is_lost(
    database: Database, writer: Writer, breaks: Callable[[Database], None], words: str
) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    rows = [writer.write(1500, run.id)]
    recorder.drain()
    breaks(database)
    for _ in range(4):
        rows.append(writer.write(1000, run.id))
        recorder.drain()
        assert read_problem(recorder.problem) == ("database_takes_no_samples", words)
    with database.reading() as session:
        assert recordings.extent(session, run.id).count == 1000
        assert recordings.get(session, run.id).missed == 0
    repair(database)
    assert find_database_errors(database.engine) == []
    rows.append(writer.write(700, run.id))
    writer.write(1)
    recorder.drain()
    assert recorder.problem == ""
    assert stored_run(database, run.id).end_state == EndState.COMPLETED
    with database.reading() as session:
        samples = read_samples(session, run.id)
        assert recordings.get(session, run.id).missed == 0
    np.testing.assert_array_equal(samples.columns["q"], np.concatenate(rows)[:, INDEX["q"]].astype(np.float32))


def test_samples_overwritten_in_the_ring_buffer_are_a_gap_of_the_run(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    writer.write(1000, run.id)
    recorder.drain()
    fill(database)
    written = 3 * writer.ring.capacity
    writer.write(written, run.id)
    recorder.drain()
    repair(database)
    recorder.drain()
    recorder.close()
    with database.reading() as session:
        recording, extent = recordings.get(session, run.id), recordings.extent(session, run.id)
    assert recording.missed > 0
    assert recording.missed + extent.count == 1000 + written
    lost = messages.samples_overwritten(count=recording.missed, tick=1000)
    assert recording.problem == lost


def test_a_recorder_that_ends_with_unstored_samples_reports_them(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    writer.write(500, run.id)
    make_read_only(database)
    reason = "attempt to write a readonly database"
    with refused(RecordingError, "database_takes_no_samples", reason=reason):
        recorder.close()
    assert stored_run(database, run.id).end_state == EndState.RUNNING
    repair(database)
    assert find_database_errors(database.engine) == []


def test_a_run_without_its_folder_is_incomplete_and_resumes_with_the_folder(
    database: Database, writer: Writer, tmp_path: Path
) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    rows = [writer.write(1000, run.id)]
    recorder.drain()
    aside = tmp_path.rename(tmp_path.with_name(f"{tmp_path.name}-aside"))
    rows.append(writer.write(1000, run.id))
    writer.write(1)  # the run has ended in the loop
    recorder.drain()
    code, reason = read_problem(recorder.problem)
    assert (code, reason.code) == ("samples_not_stored", "database_file_replaced")
    assert stored_run(database, run.id).end_state == EndState.RUNNING
    aside.rename(tmp_path)
    recorder.drain()
    assert recorder.problem == ""
    assert stored_run(database, run.id).end_state == EndState.COMPLETED
    with database.reading() as session:
        samples = read_samples(session, run.id)
        assert recordings.get(session, run.id).missed == 0
    np.testing.assert_array_equal(samples.columns["q"], np.concatenate(rows)[:, INDEX["q"]].astype(np.float32))
