"""Results of runs: metrics with a verdict per criterion, and issued reports."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from backend.models import CRITERIA, METRICS, Metrics, RunCriterion, UnreadableDocumentError
from backend.storage.orm import ReportRow, ResultRow, mark_for_reindex, to_record


@dataclass(frozen=True)
class NewResult:
    """Metrics and criteria of a run."""

    run_id: int
    metrics: Metrics
    criteria: tuple[RunCriterion, ...]
    software: str


@dataclass(frozen=True)
class Result(NewResult):
    """A stored result."""

    id: int
    created_at: datetime


@dataclass(frozen=True)
class StoredReport:
    """A report as issued; ``format`` is html or pdf."""

    id: int
    run_id: int
    format: str
    created_at: datetime
    content: bytes


def add(session: Session, new: NewResult) -> Result:
    """Store a result; earlier ones of the run remain."""
    row = ResultRow(
        run_id=new.run_id,
        metrics=METRICS.write(new.metrics),
        criteria=CRITERIA.write(new.criteria),
        software=new.software,
        created_at=datetime.now(UTC),
    )
    session.add(row)
    session.flush()
    mark_for_reindex(session, new.run_id)
    return _result(row)


def newest(session: Session, run_id: int) -> Result | None:
    """Return the newest result of a run, None without one.

    Raises UnreadableDocumentError.
    """
    row = session.scalar(select(ResultRow).where(ResultRow.run_id == run_id).order_by(ResultRow.id.desc()).limit(1))
    return None if row is None else _result(row)


def load_newest(session: Session, run_ids: Sequence[int]) -> dict[int, Result | None]:
    """Return the newest result of each of these runs with results.

    None for an unreadable one.
    """
    last = select(func.max(ResultRow.id)).where(ResultRow.run_id.in_(run_ids)).group_by(ResultRow.run_id)
    return {row.run_id: _readable(row) for row in session.scalars(select(ResultRow).where(ResultRow.id.in_(last)))}


def _readable(row: ResultRow) -> Result | None:
    try:
        return _result(row)
    except UnreadableDocumentError:
        return None


def _result(row: ResultRow) -> Result:
    of = f"run {row.run_id}"
    return Result(
        id=row.id,
        run_id=row.run_id,
        metrics=METRICS.read(row.metrics, of),
        criteria=CRITERIA.read(row.criteria, of),
        software=row.software,
        created_at=row.created_at,
    )


def numbers(session: Session, run_id: int) -> list[int]:
    """Return the numbers of all results of a run, oldest first."""
    return list(session.scalars(select(ResultRow.id).where(ResultRow.run_id == run_id).order_by(ResultRow.id)))


def present(session: Session, run_ids: Sequence[int]) -> set[int]:
    """Return the runs among these that have a result."""
    return set(session.scalars(select(ResultRow.run_id).where(ResultRow.run_id.in_(run_ids)).distinct()))


def add_report(session: Session, run_id: int, report_format: str, content: bytes) -> StoredReport:
    """Store a report as issued."""
    row = ReportRow(run_id=run_id, format=report_format, created_at=datetime.now(UTC), content=content)
    session.add(row)
    session.flush()
    return to_record(StoredReport, row)


def newest_report(session: Session, run_id: int, report_format: str) -> StoredReport | None:
    """Return the newest report of a run in a format, None without one."""
    query = select(ReportRow).where(ReportRow.run_id == run_id, ReportRow.format == report_format)
    row = session.scalar(query.order_by(ReportRow.id.desc()).limit(1))
    return None if row is None else to_record(StoredReport, row)
