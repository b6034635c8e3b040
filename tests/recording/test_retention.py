"""Old recordings: which are deletable, which never are, and that only listed ones are deleted."""

from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta

import pytest
from sqlalchemy import text

from backend.models.run import Metrics
from backend.recording import messages
from backend.recording.reader import read_samples
from backend.recording.retention import NotRemovableError, RetentionRule, delete_recordings, summarize_retention
from backend.storage import events, identifications, recordings, results, runs
from backend.storage.database import Database, Session
from backend.storage.orm import UnknownRecordError
from backend.storage.recordings import Chunk
from backend.storage.results import NewResult
from backend.storage.runs import EndState
from tests.reasons import assert_reason
from tests.recording.stand_in import new_run
from tests.refusals import refused
from tests.storage.test_lineage import NEW_IDENTIFICATION

CHUNKS, BYTES = 450, 450 * 110


def recorded(database: Database, days: int = 100, end: EndState = EndState.STOPPED) -> int:
    run = new_run(database)
    with database.session() as session:
        recordings.begin(session, run.id, ["q"], 1e-3)
        for second in range(CHUNKS):
            recordings.add_chunks(session, run.id, [Chunk(1000 * second, 1000, b"s" * 10, b"x" * 100)])
        if end is not EndState.RUNNING:
            runs.end(session, run.id, end)
        started = datetime.now(UTC) - timedelta(days=days)
        session.execute(
            text("UPDATE run SET started_at = :at WHERE id = :run"),
            {"at": started.replace(tzinfo=None).isoformat(" "), "run": run.id},
        )
    return run.id


def ids(database: Database, rule: RetentionRule) -> list[int]:
    return [run.run_id for run in summarize_retention(database, rule).may_go]


def test_below_the_limit_no_recording_is_deletable(database: Database) -> None:
    run = recorded(database)
    found = summarize_retention(database, RetentionRule(BYTES, 30))
    assert (found.total_bytes, found.may_go, found.describe) == (BYTES, (), "")
    with refused(NotRemovableError, "runs_not_removable", refused=[run], removable=[]):
        delete_recordings(database, RetentionRule(BYTES, 30), [run], "Ana")


def test_only_the_necessary_number_of_oldest_recordings_is_deletable(database: Database) -> None:
    first, second, third = (recorded(database, days) for days in (90, 80, 70))
    assert ids(database, RetentionRule(3 * BYTES, 30)) == []
    assert ids(database, RetentionRule(2 * BYTES, 30)) == [first]
    assert ids(database, RetentionRule(BYTES, 30)) == [first, second]
    assert ids(database, RetentionRule(1, 30)) == [first, second, third]
    says = summarize_retention(database, RetentionRule(BYTES, 30)).describe
    assert_reason(
        says,
        "recordings_deletable",
        max_bytes=BYTES,
        total_bytes=3 * BYTES,
        freed_bytes=2 * BYTES,
        runs=2,
        keep_days=30,
    )


def test_recent_and_open_recordings_are_not_deletable(database: Database) -> None:
    recorded(database, days=29)
    recorded(database, days=90, end=EndState.RUNNING)
    found = summarize_retention(database, RetentionRule(1, 30))
    assert found.may_go == ()
    assert_reason(found.describe, "no_recording_deletable", max_bytes=1, keep_days=30)


def _identified(session: Session, run: int) -> None:
    identifications.add(session, replace(NEW_IDENTIFICATION, run_id=run))


def _judged(session: Session, run: int) -> None:
    results.add(
        session,
        NewResult(
            run_id=run, metrics=Metrics(complete=True, played_s=1.0, planned_s=1.0), criteria=(), software="0.1.0"
        ),
    )


@pytest.mark.parametrize("use", [_identified, _judged])
def test_sources_of_models_and_results_are_never_deletable(
    database: Database, use: Callable[[Session, int], None]
) -> None:
    used, unused = recorded(database, 90), recorded(database, 80)
    with database.session() as session:
        use(session, used)
    assert ids(database, RetentionRule(1, 0)) == [unused]
    with refused(NotRemovableError, "runs_not_removable", refused=[used], removable=[unused]):
        delete_recordings(database, RetentionRule(1, 0), [used, unused], "Ana")
    with database.reading() as session:
        assert recordings.extent(session, unused).count == CHUNKS * 1000, "refused as a whole"
    assert summarize_retention(database, RetentionRule(1, 0)).in_use_bytes == BYTES


@pytest.mark.parametrize("named", [[], [999]])
def test_only_listed_runs_can_be_deleted(database: Database, named: list[int]) -> None:
    run = recorded(database)
    with refused(NotRemovableError, "runs_not_removable", refused=named):
        delete_recordings(database, RetentionRule(1, 30), named, "Ana")
    assert ids(database, RetentionRule(1, 30)) == [run]


def test_deletion_removes_the_samples_and_marks_the_run(database: Database) -> None:
    gone, kept = recorded(database, 90), recorded(database, 80)
    left = delete_recordings(database, RetentionRule(1, 30), [gone], "Ana")
    assert [run.run_id for run in left.may_go] == [kept]
    assert left.total_bytes == BYTES
    with database.reading() as session:
        assert runs.get(session, gone).end_state == "stopped"
        recording = recordings.get(session, gone)
        assert recording.removed_at is not None
        assert recording.size_bytes == 0
        assert recording.problem == messages.samples_deleted_by(who="Ana", day=recording.removed_at.date())
        with refused(UnknownRecordError, "recording_removed", run_id=gone, reason=recording.problem):
            read_samples(session, gone)
        (told,) = events.find(session, kind="retention")
        assert (told.run_id, told.who) == (gone, "Ana")
        assert recordings.extent(session, kept).count == CHUNKS * 1000
        assert session.scalar(text(f"SELECT count(*) FROM chunk WHERE run_id = {gone}")) == 0
