"""Flight records: the samples around a trip, kept with the event that tells of it."""

from dataclasses import asdict, dataclass
from datetime import datetime

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from backend.storage.records import require
from backend.storage.schema import EventRow, FlightRow

GIVE_WAY_AT_ONCE = 50


@dataclass(frozen=True)
class NewFlight:
    """``count`` samples from ``first_tick`` on, packed by ``backend.recording.codec``; the trip at ``trip_tick``."""

    event_id: int
    fault: str
    first_tick: int
    trip_tick: int
    count: int
    fields: list[str]
    samples: bytes


@dataclass(frozen=True)
class Flight:
    """A stored flight record without its samples; ``text`` tells what happened, ``run_id`` to what run."""

    event_id: int
    at: datetime
    fault: str
    text: str
    run_id: int | None
    first_tick: int
    trip_tick: int
    count: int


def add(session: Session, new: NewFlight) -> None:
    """Keep a flight record with its event."""
    session.add(FlightRow(**asdict(new)))
    session.flush()


def give_way(session: Session, records: int, size_bytes: int) -> int:
    """Delete the oldest records beyond a number of records or bytes; return how many. The newest always stays.

    Their events stay too. At most ``GIVE_WAY_AT_ONCE`` go, so that nobody waits long for the database.
    """
    sizes = select(FlightRow.event_id, func.length(FlightRow.samples)).order_by(FlightRow.event_id.desc())
    total, beyond = 0, []
    for position, (event_id, size) in enumerate(session.execute(sizes)):
        total += size
        if position > 0 and (position >= records or total > size_bytes):
            beyond.append(event_id)
    going = beyond[-GIVE_WAY_AT_ONCE:]
    session.execute(delete(FlightRow).where(FlightRow.event_id.in_(going)))
    return len(going)


def find(session: Session, limit: int = 100) -> list[Flight]:
    """Return flight records, newest first."""
    columns = (
        FlightRow.event_id,
        EventRow.at,
        FlightRow.fault,
        EventRow.text,
        EventRow.run_id,
        FlightRow.first_tick,
        FlightRow.trip_tick,
        FlightRow.count,
    )
    query = select(*columns).join(EventRow).order_by(FlightRow.event_id.desc()).limit(limit)
    return [Flight(*row) for row in session.execute(query)]


def get(session: Session, event_id: int) -> NewFlight:
    """Return one flight record with its samples. Raises UnknownRecordError."""
    row = require(session, FlightRow, event_id, "flight record")
    return NewFlight(row.event_id, row.fault, row.first_tick, row.trip_tick, row.count, row.fields, row.samples)
