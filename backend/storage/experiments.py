"""Own experiments in versions, each as the text of its author."""

from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import Select, func, select
from sqlalchemy.orm import Session

from backend.storage import messages
from backend.storage.orm import ExperimentRow, UnknownRecordError, require_distinct_name, to_record
from backend.storage.stations import session_station


@dataclass(frozen=True)
class StoredExperiment:
    """One version of an experiment."""

    id: int
    name: str
    version: int
    text: str
    who: str
    created_at: datetime


def add(session: Session, name: str, text: str, who: str) -> StoredExperiment:
    """Store the next version of the experiment of this name; earlier versions remain.

    An unchanged text creates no version. Raises RequestRejectedError for a new name that resembles an existing one.
    """
    newest = _newest(session, name)
    if newest is not None and newest.text == text:
        return to_record(StoredExperiment, newest)
    if newest is None:
        of_station = ExperimentRow.station == session_station(session)
        names = session.scalars(select(ExperimentRow.name).distinct().where(of_station))
        require_distinct_name("an experiment", name, names)
    version = 1 if newest is None else newest.version + 1
    row = ExperimentRow(
        name=name, version=version, text=text, who=who, created_at=datetime.now(UTC), station=session_station(session)
    )
    session.add(row)
    session.flush()
    return to_record(StoredExperiment, row)


def get(session: Session, name: str, version: int | None = None) -> StoredExperiment:
    """Return a version of an experiment, by default the newest.

    Raises UnknownRecordError.
    """
    query = _of_station(session).where(ExperimentRow.name == name, ExperimentRow.version == version)
    row = _newest(session, name) if version is None else session.scalar(query)
    if row is None:
        raise UnknownRecordError(messages.experiment_not_found(name=name, version=version))
    return to_record(StoredExperiment, row)


def newest(session: Session) -> list[StoredExperiment]:
    """Return the newest version of each experiment, by name."""
    of_station = ExperimentRow.station == session_station(session)
    last = select(func.max(ExperimentRow.id)).where(of_station).group_by(ExperimentRow.name)
    rows = session.scalars(select(ExperimentRow).where(ExperimentRow.id.in_(last)).order_by(ExperimentRow.name))
    return [to_record(StoredExperiment, row) for row in rows]


def versions(session: Session, name: str) -> list[StoredExperiment]:
    """Return all versions of an experiment, newest first."""
    of_name = _of_station(session).where(ExperimentRow.name == name).order_by(ExperimentRow.version.desc())
    return [to_record(StoredExperiment, row) for row in session.scalars(of_name)]


def _newest(session: Session, name: str) -> ExperimentRow | None:
    of_name = _of_station(session).where(ExperimentRow.name == name)
    return session.scalar(of_name.order_by(ExperimentRow.version.desc()).limit(1))


def _of_station(session: Session) -> Select[ExperimentRow]:
    return select(ExperimentRow).where(ExperimentRow.station == session_station(session))
