"""Event log, newest first: events with notes, and starts and ends of runs."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime, timedelta
from itertools import islice
from typing import Any

from sqlalchemy import Row, Select, func, or_, select, true
from sqlalchemy.orm import InstrumentedAttribute, Session

from backend.errors import RequestRejectedError
from backend.response_docs import COMPLETE_RESPONSE_CONFIG, HIDDEN_FIELD, describe_field
from backend.storage import messages, recordings
from backend.storage.events import EventKind
from backend.storage.orm import EventRow, FlightRow, RemarkRow, RunIndexRow, RunRow, UnknownRecordError
from backend.storage.search import Condition
from backend.storage.stations import session_station
from backend.storage.tags import read_tag
from backend.units import AngleUnit, format_text
from plant import UNIT_MARK, ErrorCode

NOTE_MAX = 2000
TAGS_MAX = 20
_AT_ONCE = 500
_LONGEST_NUMBER = 10
_UNITS = re.compile(r"d|de|deg(/s?)?|°(/s?)?|r|ra|rad(/s?)?|eg(/s?)?|ad(/s?)?|[ga](/s?)?|/s?|e")
"""Parts of units of angles and their speeds; texts in the database have rad."""
_SPELLED = re.compile(r"(?<=\d)deg")
_Query = Select[*tuple[Any, ...]]
_Row = Row[*tuple[Any, ...]]
_NEXT = timedelta(microseconds=1)
AFTER = timedelta(seconds=2)
"""Time after the end of a run in which its cause may be written: a flight record is written after its seconds."""


@dataclass(frozen=True)
class LogQuery:
    """Selection of entries: kinds (empty for all), words, and a time range.

    ``since`` is inclusive, ``before`` exclusive; all words must be contained. They are searched in the displayed text
    with angles in ``angles``: "60°" and "60 deg" match a text in rad.
    """

    kinds: Sequence[EventKind] = ()
    words: Sequence[str] = ()
    since: datetime | None = None
    before: datetime | None = None
    angles: AngleUnit = AngleUnit.DEGREES


@dataclass(frozen=True)
class LogEntry:
    """An entry of the log; ``event`` is its number, None for starts and ends of runs.

    ``t`` [s] is relative to the first sample of its run; ``flight`` states whether a flight record was stored;
    ``note``, ``tags`` and ``remark_by`` are the annotation by a person.
    """

    __pydantic_config__ = COMPLETE_RESPONSE_CONFIG

    at: datetime
    kind: EventKind
    who: str = field(metadata=describe_field("the person who requested it; empty without one"))
    text: str
    event: int | None = field(
        default=None, metadata=describe_field("number of the event; null for the start or the end of a run")
    )
    run: int | None = None
    tick: int | None = field(default=None, metadata=HIDDEN_FIELD)
    t: float | None = field(
        default=None,
        metadata=describe_field("time in the recording of the run, since its first sample", "s"),
    )
    flight: bool = field(default=False, metadata=describe_field("whether a flight record with this number was stored"))
    note: str = ""
    tags: tuple[str, ...] = ()
    remark_by: str = field(default="", metadata=describe_field("author of the note and the tags"))


def find(session: Session, asked: LogQuery, limit: int) -> tuple[list[LogEntry], datetime | None]:
    """Return the newest entries of the station, and the time before which more exist.

    None if there are no more.
    """
    found = _merge_entries(session, asked, limit)
    if len(found) < limit:
        return _locate_entries(session, found), None
    last = found[-1].at  # entries of the same time stay together
    newer = [one for one in found if one.at > last]
    at_once = _merge_entries(session, replace(asked, since=last, before=last + _NEXT), None)
    more = _merge_entries(session, replace(asked, before=last), 1)
    return _locate_entries(session, newer + at_once), last if more else None


def _merge_entries(session: Session, asked: LogQuery, limit: int | None) -> list[LogEntry]:
    wanted = set(asked.kinds) or set(EventKind)
    found = _events(session, asked, limit) if wanted - {EventKind.RUN} else []
    if EventKind.RUN in wanted:
        found += _began(session, asked, limit) + _load_run_ends(session, asked, limit)
    found.sort(key=lambda one: (one.at, one.event or 0), reverse=True)
    return found[:limit]


def remark(session: Session, event_id: int, note: str, tags: Sequence[str], who: str) -> None:
    """Set note and tags of an event of the station; without both, remove them.

    Raises UnknownRecordError, TagError, RequestRejectedError for a note that is too long or too many tags.
    """
    event = session.get(EventRow, event_id)
    if event is None or event.station != session_station(session):
        raise UnknownRecordError(messages.record_not_found(record="event", number=event_id))
    if len(note) > NOTE_MAX or len(tags) > TAGS_MAX:
        raise RequestRejectedError(
            ErrorCode.BAD_VALUE,
            messages.remark_too_long(length=len(note), tags=len(tags), maximum_length=NOTE_MAX, maximum_tags=TAGS_MAX),
        )
    words = " ".join(dict.fromkeys(map(read_tag, tags)))
    row = session.get(RemarkRow, event_id)
    if not note and not words:
        if row is not None:
            session.delete(row)
        return
    session.merge(RemarkRow(event_id=event_id, note=note, tags=f" {words} ", who=who, at=datetime.now(UTC)))


def count(session: Session, asked: LogQuery) -> int:
    """Return the number of selected entries."""
    wanted, found = set(asked.kinds) or set(EventKind), 0
    if wanted - {EventKind.RUN}:
        found += _count(session, _of_events(session, asked), _event, asked)
    if EventKind.RUN in wanted:
        for moment, made in ((RunRow.started_at, _make_begin_entry), (RunRow.ended_at, _end)):
            found += _count(session, _of_runs(session, moment, asked), made, asked)
    return found


def _count(session: Session, query: _Query, made: Callable[[_Row], tuple[LogEntry, str]], asked: LogQuery) -> int:
    if any(map(_may_be_of_angle, asked.words)):
        return len(_query_entries(session, query, made, asked, None))
    return session.scalar(select(func.count()).select_from(query.order_by(None).subquery())) or 0


def _query_entries(
    session: Session,
    query: _Query,
    make: Callable[[_Row], tuple[LogEntry, str]],
    asked: LogQuery,
    limit: int | None,
) -> list[LogEntry]:
    """Return the first entries of a query.

    Filter words of angles by the displayed text. The database has angles in rad: rows with an angle are filtered here.
    """
    words = [_normalize_text(word) for word in asked.words if _may_be_of_angle(word)]
    if not words:
        return [make(row)[0] for row in session.execute(query.limit(limit))]

    def matches(found: tuple[LogEntry, str]) -> bool:
        one, beside = found
        turned = (format_text(text, asked.angles) for text in (one.text, beside))
        read = [_normalize_text(place) for place in (*turned, one.who, one.note, *one.tags)]
        read += [place.replace("°", " deg") for place in read]
        return all(word == str(one.run) or any(word in place for place in read) for word in words)

    rows = session.execute(query.execution_options(yield_per=_AT_ONCE))
    try:
        return [one for one, _ in islice(filter(matches, map(make, rows)), limit)]
    finally:
        rows.close()


def _may_be_of_angle(word: str) -> bool:
    """Return whether a word may be part of a displayed angle: a number, or a unit."""
    return any(letter.isdigit() for letter in word) or bool(_UNITS.fullmatch(word.casefold()))


def _normalize_text(text: str) -> str:
    return _SPELLED.sub("°", text.casefold().replace("−", "-"))


def _with_angle(place: InstrumentedAttribute[str]) -> list[Condition]:
    return [place.contains(f"{UNIT_MARK}rad"), place.contains(f"{UNIT_MARK}deg")]


def _events(session: Session, asked: LogQuery, limit: int | None) -> list[LogEntry]:
    return _query_entries(session, _of_events(session, asked), _event, asked, limit)


def _of_events(session: Session, asked: LogQuery) -> _Query:
    query = (
        select(EventRow, RemarkRow, FlightRow.event_id)
        .outerjoin(RemarkRow, RemarkRow.event_id == EventRow.id)
        .outerjoin(FlightRow, FlightRow.event_id == EventRow.id)
        .where(EventRow.station == session_station(session), *_within(EventRow.at, asked))
        .order_by(EventRow.at.desc(), EventRow.id.desc())
    )
    if asked.kinds:
        query = query.where(EventRow.kind.in_([str(kind) for kind in asked.kinds]))
    for word in asked.words:
        places = EventRow.text, EventRow.who, RemarkRow.note, RemarkRow.tags
        turned = _with_angle(EventRow.text) if _may_be_of_angle(word) else []
        query = query.where(or_(*(_holds(place, word) for place in places), *turned))
    return query


def _event(row: _Row) -> tuple[LogEntry, str]:
    event, text, flight = row
    entry = LogEntry(
        at=event.at,
        kind=EventKind(event.kind) if event.kind in set(EventKind) else EventKind.NOTE,
        who=event.who,
        text=event.text,
        event=event.id,
        run=event.run_id,
        tick=event.tick,
        flight=flight is not None,
        note="" if text is None else text.note,
        tags=() if text is None else tuple(text.tags.split()),
        remark_by="" if text is None else text.who,
    )
    return entry, ""


def _began(session: Session, asked: LogQuery, limit: int | None) -> list[LogEntry]:
    return _query_entries(session, _of_runs(session, RunRow.started_at, asked), _make_begin_entry, asked, limit)


def _load_run_ends(session: Session, asked: LogQuery, limit: int | None) -> list[LogEntry]:
    return _query_entries(session, _of_runs(session, RunRow.ended_at, asked), _end, asked, limit)


def _make_begin_entry(row: _Row) -> tuple[LogEntry, str]:
    run, at, who, title, words, _, _ = row
    return LogEntry(at, EventKind.RUN, who, messages.run_began(title=title), run=run), words


def _end(row: _Row) -> tuple[LogEntry, str]:
    run, at, _, title, words, state, detail = row
    return LogEntry(
        at, EventKind.RUN, "", messages.run_ended(title=title, end_state=state, detail=detail), run=run
    ), words


def _of_runs(session: Session, moment: InstrumentedAttribute[Any], asked: LogQuery) -> _Query:
    index = RunIndexRow
    query = (
        select(RunRow.id, moment, RunRow.who, index.title, index.words, RunRow.end_state, RunRow.end_detail)
        .join(RunIndexRow, RunIndexRow.run_id == RunRow.id)
        .where(RunRow.station == session_station(session), moment.is_not(None), *_within(moment, asked))
        .order_by(moment.desc(), RunRow.id.desc())
    )
    for word in asked.words:
        named = [index.words.contains(word.casefold(), autoescape=True), _holds(RunRow.end_detail, word)]
        named += _with_angle(RunRow.end_detail) if _may_be_of_angle(word) else []
        named += [RunRow.id == int(word)] if word.isascii() and word.isdigit() and len(word) < _LONGEST_NUMBER else []
        query = query.where(true() if word.casefold() == "run" else or_(*named))
    return query


def _within(moment: InstrumentedAttribute[Any], asked: LogQuery) -> list[Condition]:
    since = [] if asked.since is None else [moment >= asked.since]
    return since if asked.before is None else [*since, moment < asked.before]


def _holds(place: InstrumentedAttribute[str], word: str) -> Condition:
    return func.lower(place).contains(word.lower(), autoescape=True)


def _locate_entries(session: Session, found: list[LogEntry]) -> list[LogEntry]:
    """Set the time in the recording for each event with a tick.

    Ticks restart with each loop process: an event belongs to a run only if both its time and its tick match.
    """
    ticked = [one for one in found if one.tick is not None]
    if not ticked:
        return found
    overlap = select(RunRow.id, RunRow.started_at, RunRow.ended_at).where(
        RunRow.station == session_station(session),
        RunRow.started_at <= ticked[0].at,
        or_(RunRow.ended_at.is_(None), RunRow.ended_at >= ticked[-1].at),
    )
    rows = session.execute(overlap.order_by(RunRow.started_at.desc())).all()
    known = recordings.of_runs(session, [run for run, _, _ in rows])

    def locate(one: LogEntry) -> LogEntry:
        for run, began, ended in rows:
            recording, extent = known.get(run, (None, None))
            if one.tick is None or recording is None or extent is None:
                continue
            fits = began <= one.at and (ended is None or one.at <= ended + AFTER)
            if fits and extent.first_tick <= one.tick <= extent.end_tick:
                return replace(one, run=run, t=(one.tick - extent.first_tick) * recording.period_s)
        return one

    return [locate(one) for one in found]
