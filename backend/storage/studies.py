"""Studies and the rows that they have computed so far: a row is there once, whoever computes it again."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from typing import Any, Literal

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from backend.models import Value
from backend.storage.orm import Document, StudyPointRow, StudyRow, UnknownRecordError, to_record
from backend.storage.search_index import insert_new
from backend.storage.stations import session_station


@dataclass(frozen=True)
class NewStudy:
    """What decides the points of a study: its ``text``, and in ``base`` all that this speaks of, as it was then."""

    name: str
    title: str
    text: str
    base: Document
    points: int
    who: str


@dataclass(frozen=True)
class StoredStudy(NewStudy):
    """A stored study. ``runner`` computes it, "" for nobody; ``problem`` says what it ended of, where that is wrong."""

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
    """A row of the table. ``state`` is an end state of a run, or why there is none, with ``detail`` in words.

    ``values`` are what was varied. ``figures`` are those of the experiment in SI, None where one was not measured, and
    those of the loop: ±inf where it is unstable, which is stored as "unstable". ``passed`` tells whether all criteria
    hold, None where that is not known.
    """

    number: int
    state: str
    detail: str
    passed: bool | None
    values: Mapping[str, Value]
    figures: Mapping[str, float | Literal["unstable"] | None]


def add(session: Session, new: NewStudy) -> StoredStudy:
    """Keep a study, of which nothing is computed yet."""
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
    """Have the study computed: a stop that was asked before counts no more. Raises UnknownRecordError."""
    _own(session, study_id).stop_asked = False


def claim(session: Session, study_id: int, runner: str) -> bool:
    """Keep that ``runner`` computes the study from now on; False where somebody wants it to stop.

    Raises UnknownRecordError.
    """
    row, now = _own(session, study_id), datetime.now(UTC)
    if row.stop_asked:
        return False
    row.runner, row.seen_at, row.begun_at = runner, now, now
    row.begun_with, row.problem = count_rows(session, study_id), ""
    return True


def refresh_claim(session: Session, study_id: int, runner: str) -> bool:
    """Keep that ``runner`` is alive; return whether it may go on: nobody asked it to stop, or took the study over."""
    row = _own(session, study_id)
    if row.runner != runner:
        return False
    row.seen_at = datetime.now(UTC)
    return not row.stop_asked


def let_go(session: Session, study_id: int, runner: str, problem: str = "") -> None:
    """Keep that ``runner`` does not compute the study any more."""
    row = _own(session, study_id)
    if row.runner == runner:
        row.runner, row.problem = "", problem


def ask_to_stop(session: Session, study_id: int) -> None:
    """Have whoever computes the study stop. Raises UnknownRecordError."""
    _own(session, study_id).stop_asked = True


def add_points(session: Session, study_id: int, points: Sequence[StudyPoint]) -> None:
    """Keep rows but for those that are there already."""
    own: dict[str, Any] = {"study_id": study_id, "station": session_station(session)}
    if points:
        insert_new(session, StudyPointRow, [{**own, **asdict(point)} for point in points])


def forget(session: Session, study_id: int, ends: Sequence[str]) -> None:
    """Drop the rows whose runs ended in one of ``ends``."""
    session.execute(delete(StudyPointRow).where(StudyPointRow.study_id == study_id, StudyPointRow.state.in_(ends)))


def count_rows(session: Session, study_id: int) -> int:
    """Count the rows that are there."""
    query = select(func.count()).select_from(StudyPointRow).where(StudyPointRow.study_id == study_id)
    return session.scalar(query) or 0


def numbers(session: Session, study_id: int) -> set[int]:
    """Return which points are there."""
    return set(session.scalars(select(StudyPointRow.number).where(StudyPointRow.study_id == study_id)))


def states(session: Session, study_id: int) -> dict[str, int]:
    """Count the rows by how their runs ended."""
    counted = select(StudyPointRow.state, func.count()).where(StudyPointRow.study_id == study_id)
    rows = session.execute(counted.group_by(StudyPointRow.state).order_by(StudyPointRow.state))
    return {row[0]: row[1] for row in rows}


def points(session: Session, study_id: int, first: int = 0, limit: int | None = None) -> list[StudyPoint]:
    """Return the rows that are there from number ``first`` on, in order."""
    columns = (getattr(StudyPointRow, field.name) for field in fields(StudyPoint))  # as rows they take twice as long
    query = select(*columns).where(StudyPointRow.study_id == study_id, StudyPointRow.number >= first)
    return [StudyPoint(*row) for row in session.execute(query.order_by(StudyPointRow.number).limit(limit))]


def _own(session: Session, study_id: int) -> StudyRow:
    row = session.get(StudyRow, study_id)
    if row is None or row.station != session_station(session):
        raise UnknownRecordError(f"there is no study {study_id}")
    return row
