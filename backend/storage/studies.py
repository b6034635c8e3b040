"""Studies and their computed rows; a row exists once, whoever computes it again."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from typing import Any, Literal

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from backend.models import Value
from backend.storage import messages
from backend.storage.orm import Document, StudyPointRow, StudyRow, UnknownRecordError, to_record
from backend.storage.search_index import insert_new
from backend.storage.stations import session_station


@dataclass(frozen=True)
class NewStudy:
    """Definition of a study: its ``text``, and in ``base`` the data it refers to.

    ``base`` is as of the study's creation.
    """

    name: str
    title: str
    text: str
    base: Document
    points: int
    who: str


@dataclass(frozen=True)
class StoredStudy(NewStudy):
    """A stored study.

    ``runner`` computes it, "" for none; ``problem`` is the error that ended its computation.
    """

    id: int
    created_at: datetime
    runner: str
    seen_at: datetime | None
    begun_at: datetime | None
    begun_with: int
    stop_asked: bool
    problem: str


@dataclass(frozen=True)
class StudyPoint:
    """A row of the table.

    ``state`` is an end state of a run, or why there is none, with ``detail`` as text. ``values`` are the varied ones.
    ``figures`` are those of the experiment in SI, None if not measured, and those of the loop: ±inf if it is unstable,
    which is stored as "unstable". ``passed``: all criteria are met, None if unknown.
    """

    number: int
    state: str
    detail: str
    passed: bool | None
    values: Mapping[str, Value]
    figures: Mapping[str, float | Literal["unstable"] | None]


def add(session: Session, new: NewStudy) -> StoredStudy:
    """Store a study without computed points."""
    row = StudyRow(
        **asdict(new),
        created_at=datetime.now(UTC),
        runner="",
        begun_with=0,
        stop_asked=False,
        problem="",
        station=session_station(session),
    )
    session.add(row)
    session.flush()
    return to_record(StoredStudy, row)


def get(session: Session, study_id: int) -> StoredStudy:
    """Return a study of the station. Raises UnknownRecordError."""
    return to_record(StoredStudy, _own(session, study_id))


def newest(session: Session, limit: int) -> list[StoredStudy]:
    """Return the newest studies of the station, newest first."""
    query = (
        select(StudyRow).where(StudyRow.station == session_station(session)).order_by(StudyRow.id.desc()).limit(limit)
    )
    return [to_record(StoredStudy, row) for row in session.scalars(query)]


def want(session: Session, study_id: int) -> None:
    """Request the computation of the study, cancelling an earlier stop.

    Raises UnknownRecordError.
    """
    _own(session, study_id).stop_asked = False


def claim(session: Session, study_id: int, runner: str) -> bool:
    """Assign the study to ``runner``; return False if a stop was requested.

    Raises UnknownRecordError.
    """
    row, now = _own(session, study_id), datetime.now(UTC)
    if row.stop_asked:
        return False
    row.runner, row.seen_at, row.begun_at = runner, now, now
    row.begun_with, row.problem = count_rows(session, study_id), ""
    return True


def refresh_claim(session: Session, study_id: int, runner: str) -> bool:
    """Record that ``runner`` is alive; return whether it may continue.

    It must stop on request, or if another runner has taken the study.
    """
    row = _own(session, study_id)
    if row.runner != runner:
        return False
    row.seen_at = datetime.now(UTC)
    return not row.stop_asked


def release(session: Session, study_id: int, runner: str, problem: str = "") -> None:
    """Record that ``runner`` no longer computes the study."""
    row = _own(session, study_id)
    if row.runner == runner:
        row.runner, row.problem = "", problem


def ask_to_stop(session: Session, study_id: int) -> None:
    """Request a stop of the computation. Raises UnknownRecordError."""
    _own(session, study_id).stop_asked = True


def add_points(session: Session, study_id: int, points: Sequence[StudyPoint]) -> None:
    """Store rows except existing ones."""
    own: dict[str, Any] = {"study_id": study_id, "station": session_station(session)}
    if points:
        insert_new(session, StudyPointRow, [{**own, **asdict(point)} for point in points])


def forget(session: Session, study_id: int, ends: Sequence[str]) -> None:
    """Delete the rows whose runs ended in one of ``ends``."""
    session.execute(delete(StudyPointRow).where(StudyPointRow.study_id == study_id, StudyPointRow.state.in_(ends)))


def count_rows(session: Session, study_id: int) -> int:
    """Return the number of rows."""
    query = select(func.count()).select_from(StudyPointRow).where(StudyPointRow.study_id == study_id)
    return session.scalar(query) or 0


def numbers(session: Session, study_id: int) -> set[int]:
    """Return the numbers of the existing points."""
    return set(session.scalars(select(StudyPointRow.number).where(StudyPointRow.study_id == study_id)))


def states(session: Session, study_id: int) -> dict[str, int]:
    """Return the number of rows per state."""
    counted = select(StudyPointRow.state, func.count()).where(StudyPointRow.study_id == study_id)
    rows = session.execute(counted.group_by(StudyPointRow.state).order_by(StudyPointRow.state))
    return {row[0]: row[1] for row in rows}


def points(session: Session, study_id: int, first: int = 0, limit: int | None = None) -> list[StudyPoint]:
    """Return the rows from number ``first`` on, in order."""
    # ORM objects would take twice as long
    columns = (getattr(StudyPointRow, field.name) for field in fields(StudyPoint))
    query = select(*columns).where(StudyPointRow.study_id == study_id, StudyPointRow.number >= first)
    return [StudyPoint(*row) for row in session.execute(query.order_by(StudyPointRow.number).limit(limit))]


def _own(session: Session, study_id: int) -> StudyRow:
    row = session.get(StudyRow, study_id)
    if row is None or row.station != session_station(session):
        raise UnknownRecordError(messages.record_not_found(record="study", number=study_id))
    return row
