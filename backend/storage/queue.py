"""Queued experiments of a station, in order of execution."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from backend.storage.orm import Document, QueuedRow, to_record
from backend.storage.stations import session_station


@dataclass(frozen=True)
class StoredQueued:
    """A queued experiment with all its settings; ``id`` is never reused."""

    id: int
    name: str
    settings: Document
    who: str
    added_at: datetime


def load_waiting(session: Session) -> list[StoredQueued]:
    """Return the queued experiments, the next one first."""
    of_station = QueuedRow.station == session_station(session)
    rows = session.scalars(select(QueuedRow).where(of_station).order_by(QueuedRow.place, QueuedRow.id))
    return [to_record(StoredQueued, row) for row in rows]


def add(session: Session, name: str, settings: Document, who: str) -> StoredQueued:
    """Append an experiment."""
    station = session_station(session)
    last = session.scalar(select(func.max(QueuedRow.place)).where(QueuedRow.station == station))
    place = 0 if last is None else last + 1
    row = QueuedRow(place=place, name=name, settings=settings, who=who, added_at=datetime.now(UTC), station=station)
    session.add(row)
    session.flush()
    return to_record(StoredQueued, row)


def remove(session: Session, item_id: int) -> None:
    """Remove an experiment if it is queued."""
    session.execute(delete(QueuedRow).where(QueuedRow.id == item_id, QueuedRow.station == session_station(session)))


def arrange(session: Session, order: Sequence[int]) -> None:
    """Order the queued experiments by these numbers."""
    places = {item_id: place for place, item_id in enumerate(order)}
    for row in session.scalars(select(QueuedRow).where(QueuedRow.station == session_station(session))):
        row.place = places.get(row.id, len(places))
