"""Flight records: samples around a trip or a trigger, stored with its event."""

from dataclasses import asdict, dataclass
from datetime import datetime

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from backend.storage import messages, runs
from backend.storage.orm import Document, EventRow, FlightRow, UnknownRecordError, require
from backend.storage.stations import session_station

DELETE_BATCH = 50
TRIGGER = "trigger"
"""Name in place of the fault in a capture of a trigger, and key of the condition in the detail of the event."""


@dataclass(frozen=True)
class NewFlight:
    """A flight record: the samples around a trip or trigger at ``trip_tick``.

    It has ``count`` samples from ``first_tick`` on, packed by ``backend.recording.codec``.
    """

    event_id: int
    fault: str
    first_tick: int
    trip_tick: int
    count: int
    fields: list[str]
    samples: bytes


@dataclass(frozen=True)
class Flight:
    """A stored flight record without its samples; ``text`` describes the event.

    ``run_id`` is its run. ``who`` pressed STOP or armed the trigger; ``trigger`` is the condition, None for a trip.
    """

    event_id: int
    at: datetime
    fault: str
    text: str
    run_id: int | None
    first_tick: int
    trip_tick: int
    count: int
    who: str
    trigger: Document | None


def add(session: Session, new: NewFlight) -> None:
    """Store a flight record with its event."""
    session.add(FlightRow(**asdict(new)))
    session.flush()


def known_run(session: Session, run_id: int) -> int | None:
    """Return the number of a stored run, None for 0 and unknown runs."""
    try:
        return runs.get(session, run_id).id if run_id else None
    except UnknownRecordError:
        return None


def delete_oldest(session: Session, records: int, size_bytes: int, of: str = "") -> int:
    """Delete the station's oldest records beyond a number or size; return how many.

    The newest remains. Captures ``of`` triggers and records of trips have separate quotas. Their events remain. At most
    ``DELETE_BATCH`` are deleted, so that other transactions do not wait long.
    """
    sizes = select(FlightRow.event_id, func.length(FlightRow.samples)).join(EventRow)
    alike = FlightRow.fault == TRIGGER if of == TRIGGER else FlightRow.fault != TRIGGER
    of_station = sizes.where(EventRow.station == session_station(session), alike).order_by(FlightRow.event_id.desc())
    total, beyond = 0, []
    for position, (event_id, size) in enumerate(session.execute(of_station)):
        total += size
        if position > 0 and (position >= records or total > size_bytes):
            beyond.append(event_id)
    going = beyond[-DELETE_BATCH:]
    session.execute(delete(FlightRow).where(FlightRow.event_id.in_(going)))
    return len(going)


def find(session: Session, limit: int = 100) -> list[Flight]:
    """Return flight records of the station, newest first."""
    columns = (
        FlightRow.event_id,
        EventRow.at,
        FlightRow.fault,
        EventRow.text,
        EventRow.detail,
        EventRow.run_id,
        FlightRow.first_tick,
        FlightRow.trip_tick,
        FlightRow.count,
        EventRow.who,
    )
    of_station = select(*columns).join(EventRow).where(EventRow.station == session_station(session))
    query = of_station.order_by(FlightRow.event_id.desc()).limit(limit)
    return [
        Flight(
            event_id=event_id,
            at=at,
            fault=fault,
            text=_with_followers(text, detail),
            run_id=run_id,
            first_tick=first_tick,
            trip_tick=trip_tick,
            count=count,
            who=who,
            trigger=detail.get(TRIGGER),
        )
        for event_id, at, fault, text, detail, run_id, first_tick, trip_tick, count, who in session.execute(query)
    ]


def _with_followers(text: str, detail: Document) -> str:
    followed_by = detail.get("followed_by")
    return messages.followed_by(text=text, followers=followed_by) if followed_by else text


def get(session: Session, event_id: int) -> NewFlight:
    """Return one flight record with its samples. Raises UnknownRecordError."""
    row = require(session, FlightRow, event_id, "flight record")
    return NewFlight(
        event_id=row.event_id,
        fault=row.fault,
        first_tick=row.first_tick,
        trip_tick=row.trip_tick,
        count=row.count,
        fields=row.fields,
        samples=row.samples,
    )
