"""Events: what happened and who asked for it, in order. Text, person and time never change.

The event of a trip gets its run and the trips that followed once its flight record ends.
"""

from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum

from sqlalchemy import select
from sqlalchemy.orm import Session

from backend.storage.orm import Document, EventRow, require, to_record
from backend.storage.stations import session_station

_ONE_TRIP = timedelta(seconds=2)
"""So far apart may be the times that two parts of the service give one trip."""


class EventKind(StrEnum):
    """What an event is about. Those that are marks on the time axis too are called as ``MarkKind`` calls them."""

    MODE = "mode"
    TUNING = "tuning"
    BANK = "bank"
    FAULT = "fault"
    REFERENCES = "references"
    NOTE = "note"
    TRIP = "trip"
    TRIGGER = "trigger"
    RECORDING = "recording"
    RETENTION = "retention"
    FLIGHT_QUOTA = "flight_quota"
    BACKUP = "backup"
    ACCESS = "access"
    REFUSAL = "refusal"
    RUN = "run"
    """Not stored as an event: runs say themselves when they began and ended."""


@dataclass(frozen=True)
class Event:
    """A stored event. ``run_id`` and ``tick`` are None where it belongs to no run or to no sample."""

    id: int
    at: datetime
    kind: str
    who: str
    text: str
    run_id: int | None
    tick: int | None
    detail: Document


def add(
    session: Session,
    kind: str,
    text: str,
    *,
    who: str = "",
    run_id: int | None = None,
    tick: int | None = None,
    detail: Document | None = None,
    at: datetime | None = None,
) -> Event:
    """Store an event that happened at ``at`` (None: now); ``who`` is empty when nobody asked for it."""
    row = EventRow(
        at=at or datetime.now(UTC),
        kind=kind,
        who=who,
        text=text,
        run_id=run_id,
        tick=tick,
        detail=detail or {},
        station=session_station(session),
    )
    session.add(row)
    session.flush()
    return to_record(Event, row)


def find(session: Session, *, run_id: int | None = None, kind: str | None = None, limit: int = 500) -> list[Event]:
    """Return events of the station, newest first."""
    query = (
        select(EventRow)
        .where(EventRow.station == session_station(session))
        .order_by(EventRow.at.desc(), EventRow.id.desc())
        .limit(limit)
    )
    if run_id is not None:
        query = query.where(EventRow.run_id == run_id)
    if kind is not None:
        query = query.where(EventRow.kind == kind)
    return [to_record(Event, row) for row in session.scalars(query)]


def find_trip(session: Session, tick: int, at: datetime) -> Event | None:
    """Return the station's event of the trip at ``tick`` at about the time ``at``, None where none was stored.

    Ticks begin anew with each loop process, so the time decides between trips at one tick. The death of the loop is
    kept at its last tick, its record at the tick that did not come.
    """
    query = select(EventRow).where(
        EventRow.station == session_station(session),
        EventRow.kind == EventKind.TRIP,
        EventRow.tick.in_((tick, tick - 1)),
        EventRow.at.between(at - _ONE_TRIP, at + _ONE_TRIP),
    )
    row = session.scalars(query.order_by(EventRow.id).limit(1)).first()
    return None if row is None else to_record(Event, row)


def complete(session: Session, event_id: int, *, run_id: int | None, followed_by: str) -> None:
    """Add to the event of a trip what is known once its record ends: the run, and the trips that followed."""
    row = require(session, EventRow, event_id, "event")
    row.run_id = row.run_id or run_id
    if followed_by:
        row.detail = {**row.detail, "followed_by": followed_by}


def between(
    session: Session, since: datetime, until: datetime | None, *, station: str | None = None, limit: int = 2000
) -> list[Event]:
    """Return the events of a station (None: the own one) from ``since`` to ``until`` (None: to now), oldest first."""
    whose = session_station(session) if station is None else station
    query = select(EventRow).where(EventRow.station == whose, EventRow.at >= since)
    if until is not None:
        query = query.where(EventRow.at <= until)
    ordered = query.order_by(EventRow.at, EventRow.id).limit(limit)
    return [to_record(Event, row) for row in session.scalars(ordered)]
