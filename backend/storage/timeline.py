"""Everything that happened, newest first: events, and when runs began and ended, with what people say of events."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from typing import Any, NamedTuple

from sqlalchemy import func, or_, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from backend.refusal import Because, RefusalError
from backend.storage import recordings
from backend.storage.events import EventKind
from backend.storage.index_schema import RunIndexRow
from backend.storage.records import UnknownRecordError
from backend.storage.run_terms import Condition
from backend.storage.schema import EventRow, FlightRow, RemarkRow, RunRow
from backend.storage.stations import station_of
from backend.storage.tags import read_tag

NOTE_MAX = 2000
TAGS_MAX = 20
_NEXT = timedelta(microseconds=1)
AFTER = timedelta(seconds=2)
"""So long after a run ended what ended it may be written: a flight record is, once its seconds are over."""


@dataclass(frozen=True)
class Asked:
    """Which of it: of these kinds (none: of all), with each of these words, from ``since`` and ``before`` a time."""

    kinds: Sequence[EventKind] = ()
    words: Sequence[str] = ()
    since: datetime | None = None
    before: datetime | None = None


@dataclass(frozen=True)
class Happening:
    """One thing that happened; ``event_id`` is None of a run that began or ended.

    ``t`` [s] counts from the first sample of its run, ``flight`` tells that a flight record was kept of it, and
    ``note``, ``tags`` and ``remark_by`` are what a person says of it.
    """

    at: datetime
    kind: EventKind
    who: str
    text: str
    event_id: int | None = None
    run_id: int | None = None
    tick: int | None = None
    t: float | None = None
    flight: bool = False
    note: str = ""
    tags: tuple[str, ...] = ()
    remark_by: str = ""


def find(session: Session, asked: Asked, limit: int) -> tuple[list[Happening], datetime | None]:
    """Return the newest of the station, and before which time there is more; None where there is none."""
    found = _merged(session, asked, limit)
    if len(found) < limit:
        return _placed(session, found), None
    last = found[-1].at  # what happened at one moment is not torn apart
    newer = [one for one in found if one.at > last]
    at_once = _merged(session, replace(asked, since=last, before=last + _NEXT), None)
    more = _merged(session, replace(asked, before=last), 1)
    return _placed(session, newer + at_once), last if more else None


def _merged(session: Session, asked: Asked, limit: int | None) -> list[Happening]:
    wanted = set(asked.kinds) or set(EventKind)
    found = _events(session, asked, limit) if wanted - {EventKind.RUN} else []
    if EventKind.RUN in wanted:
        found += _began(session, asked, limit) + _ended(session, asked, limit)
    found.sort(key=lambda one: (one.at, one.event_id or 0), reverse=True)
    return found[:limit]


def remark(session: Session, event_id: int, note: str, tags: Sequence[str], who: str) -> None:
    """Put a note and tags on an event of the station in the place of those before; with neither they go.

    Raises UnknownRecordError, TagError, RefusalError for a note that is too long or too many tags.
    """
    event = session.get(EventRow, event_id)
    if event is None or event.station != station_of(session):
        raise UnknownRecordError(f"there is no event {event_id}")
    if len(note) > NOTE_MAX or len(tags) > TAGS_MAX:
        raise RefusalError(
            Because.BAD_VALUE,
            f"a note of {len(note)} characters and {len(tags)} tags: at most {NOTE_MAX} and {TAGS_MAX}; shorten it",
        )
    words = " ".join(dict.fromkeys(map(read_tag, tags)))
    row = session.get(RemarkRow, event_id)
    if not note and not words:
        if row is not None:
            session.delete(row)
        return
    session.merge(RemarkRow(event_id=event_id, note=note, tags=f" {words} ", who=who, at=datetime.now(UTC)))


def _events(session: Session, asked: Asked, limit: int | None) -> list[Happening]:
    query = (
        select(EventRow, RemarkRow, FlightRow.event_id)
        .outerjoin(RemarkRow, RemarkRow.event_id == EventRow.id)
        .outerjoin(FlightRow, FlightRow.event_id == EventRow.id)
        .where(EventRow.station == station_of(session), *_within(EventRow.at, asked))
        .order_by(EventRow.at.desc(), EventRow.id.desc())
        .limit(limit)
    )
    if asked.kinds:
        query = query.where(EventRow.kind.in_([str(kind) for kind in asked.kinds]))
    for word in asked.words:
        places = EventRow.text, EventRow.who, RemarkRow.note, RemarkRow.tags
        query = query.where(or_(*(_holds(place, word) for place in places)))
    return [
        Happening(
            event.at,
            EventKind(event.kind) if event.kind in set(EventKind) else EventKind.NOTE,
            event.who,
            event.text,
            event.id,
            event.run_id,
            event.tick,
            flight=flight is not None,
            note="" if said is None else said.note,
            tags=() if said is None else tuple(said.tags.split()),
            remark_by="" if said is None else said.who,
        )
        for event, said, flight in session.execute(query)
    ]


def _began(session: Session, asked: Asked, limit: int | None) -> list[Happening]:
    rows = _runs(session, RunRow.started_at, asked, limit)
    return [Happening(run.at, EventKind.RUN, run.who, f"{run.title} began", run_id=run.id) for run in rows]


def _ended(session: Session, asked: Asked, limit: int | None) -> list[Happening]:
    rows = _runs(session, RunRow.ended_at, asked, limit)
    return [Happening(run.at, EventKind.RUN, "", f"{run.title} {run.end}", run_id=run.id) for run in rows]


class _Run(NamedTuple):
    """A run at the moment when it began or ended."""

    id: int
    at: datetime
    who: str
    title: str
    end: str


def _runs(session: Session, moment: InstrumentedAttribute[Any], asked: Asked, limit: int | None) -> list[_Run]:
    query = (
        select(RunRow.id, moment, RunRow.who, RunIndexRow.title, RunRow.end_state, RunRow.end_detail)
        .join(RunIndexRow, RunIndexRow.run_id == RunRow.id)
        .where(RunRow.station == station_of(session), moment.is_not(None), *_within(moment, asked))
        .order_by(moment.desc(), RunRow.id.desc())
        .limit(limit)
    )
    for word in asked.words:
        named = RunIndexRow.words.contains(word.casefold(), autoescape=True)
        query = query.where(or_(named, _holds(RunRow.end_detail, word)))
    return [
        _Run(run, at, who, title, _in_words(state, detail))
        for run, at, who, title, state, detail in session.execute(query)
    ]


def _in_words(end_state: str, detail: str) -> str:
    """Return how a run ended; what a fault is called stands before the colon of ``detail``, symbols behind it."""
    fault, colon, seen = detail.partition(":")
    why = f"{fault.replace('_', ' ')}{colon}{seen}"
    return end_state.replace("_", " ") + (f", {why}" if detail else "")


def _within(moment: InstrumentedAttribute[Any], asked: Asked) -> list[Condition]:
    since = [] if asked.since is None else [moment >= asked.since]
    return since if asked.before is None else [*since, moment < asked.before]


def _holds(place: InstrumentedAttribute[str], word: str) -> Condition:
    return func.lower(place).contains(word.lower(), autoescape=True)


def _placed(session: Session, found: list[Happening]) -> list[Happening]:
    """Find the second of the recording at which each event of a tick stands, in the run that was recorded then.

    Ticks begin anew with each loop process: an event belongs to a run only if both its time and its tick fit.
    """
    ticked = [one for one in found if one.tick is not None]
    if not ticked:
        return found
    overlap = select(RunRow.id, RunRow.started_at, RunRow.ended_at).where(
        RunRow.station == station_of(session),
        RunRow.started_at <= ticked[0].at,
        or_(RunRow.ended_at.is_(None), RunRow.ended_at >= ticked[-1].at),
    )
    rows = session.execute(overlap.order_by(RunRow.started_at.desc())).all()
    known = recordings.of_runs(session, [run for run, _, _ in rows])

    def placed(one: Happening) -> Happening:
        for run, began, ended in rows:
            recording, extent = known.get(run, (None, None))
            if one.tick is None or recording is None or extent is None:
                continue
            fits = began <= one.at and (ended is None or one.at <= ended + AFTER)
            if fits and extent.first_tick <= one.tick <= extent.end_tick:
                return replace(one, run_id=run, t=(one.tick - extent.first_tick) * recording.period_s)
        return one

    return [placed(one) for one in found]
