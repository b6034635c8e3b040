"""A full disk and a database that has become read-only, as SQLite itself refuses them: told, nothing half-written."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from sqlalchemy import event

from backend.recording.reader import read_samples
from backend.recording.recorder import RecordingError
from backend.sample import INDEX
from backend.storage import recordings
from backend.storage.database import Database, find_database_errors
from backend.storage.runs import EndState
from tests.recording.stand_in import Writer, new_run, recorder_of, stored_run


def fill(database: Database) -> None:
    """Let the file grow by no page from here on, as on a full disk."""
    _for_all_connections(database, "PRAGMA max_page_count=1")


def make_read_only(database: Database) -> None:
    _for_all_connections(database, "PRAGMA query_only=ON")


def _for_all_connections(database: Database, pragma: str) -> None:
    event.listen(database.engine, "connect", lambda connection, _record: connection.execute(pragma))
    database.engine.dispose()


def repair(database: Database) -> None:
    _for_all_connections(database, "PRAGMA query_only=OFF")
    _for_all_connections(database, "PRAGMA max_page_count=1073741823")


@pytest.mark.parametrize(("breaks", "words"), [(fill, "disk is full"), (make_read_only, "readonly database")])
def test_samples_wait_in_the_ring_and_none_is_lost(
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
        assert words in recorder.problem
        assert "free space" in recorder.problem
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


def test_what_the_ring_could_not_keep_is_a_gap_of_the_run(database: Database, writer: Writer) -> None:
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
    assert "overwritten before they could be stored" in recording.problem


def test_a_recorder_that_ends_with_samples_unstored_says_so(database: Database, writer: Writer) -> None:
    run = new_run(database)
    recorder = recorder_of(writer, database)
    writer.write(500, run.id)
    make_read_only(database)
    with pytest.raises(RecordingError, match="readonly"):
        recorder.close()
    assert stored_run(database, run.id).end_state == EndState.RUNNING
    repair(database)
    assert find_database_errors(database.engine) == []


def test_a_run_whose_folder_is_gone_is_not_called_complete_and_goes_on_once_it_is_back(
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
    assert "samples cannot be stored" in recorder.problem
    assert "Put it back" in recorder.problem
    assert stored_run(database, run.id).end_state == EndState.RUNNING
    aside.rename(tmp_path)
    recorder.drain()
    assert recorder.problem == ""
    assert stored_run(database, run.id).end_state == EndState.COMPLETED
    with database.reading() as session:
        samples = read_samples(session, run.id)
        assert recordings.get(session, run.id).missed == 0
    np.testing.assert_array_equal(samples.columns["q"], np.concatenate(rows)[:, INDEX["q"]].astype(np.float32))
