"""Events in order of time: text, person and time of an event never change.

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
"""Largest difference between the times that two parts of the service assign to one trip."""


class EventKind(StrEnum):
    """Kind of an event; marks on the time axis have the names of ``MarkKind``."""

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
    """Not stored as an event: derived from the start and end of runs."""


@dataclass(frozen=True)
class Event:
    """A stored event.

    ``run_id`` and ``tick`` are None if it belongs to no run or to no sample.
    """

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
    """Store an event at time ``at`` (None: now); ``who`` is empty without a person."""
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
    """Return the station's event of the trip at ``tick``, around time ``at``, or None.

    Ticks restart with each loop process, so the time distinguishes trips at one tick. The death of the loop is stored
    at its last tick, its record at the tick that was missing.
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
    """Complete the event of a trip once its record ends: run, and following trips."""
    row = require(session, EventRow, event_id, "event")
    row.run_id = row.run_id or run_id
    if followed_by:
        row.detail = {**row.detail, "followed_by": followed_by}


def between(
    session: Session, since: datetime, until: datetime | None, *, station: str | None = None, limit: int = 2000
) -> list[Event]:
    """Return the events of a station from ``since`` to ``until``, oldest first.

    ``station`` None: the own one; ``until`` None: now.
    """
    whose = session_station(session) if station is None else station
    query = select(EventRow).where(EventRow.station == whose, EventRow.at >= since)
    if until is not None:
        query = query.where(EventRow.at <= until)
    ordered = query.order_by(EventRow.at, EventRow.id).limit(limit)
    return [to_record(Event, row) for row in session.scalars(ordered)]
