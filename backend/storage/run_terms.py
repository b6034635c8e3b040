"""How what every run has is compared: texts, kinds, stations, tags, dates, numbers. From terms to conditions."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from unicodedata import normalize

from sqlalchemy import ColumnElement, and_, not_, or_, select
from sqlalchemy.orm import InstrumentedAttribute, Session

from backend.documents.outcome import Outcome
from backend.storage.index_schema import RunIndexRow, RunTagRow
from backend.storage.run_index import NO_OUTCOME
from backend.storage.run_query import Compare, Op, QueryError, Value
from backend.storage.runs import EndState, RunKind
from backend.storage.stations import station_of

Condition = ColumnElement[bool]
NumberColumn = InstrumentedAttribute[int] | InstrumentedAttribute[float] | InstrumentedAttribute[float | None]

ENDS = tuple(str(state) for state in EndState)
VERDICTS = (*(str(outcome) for outcome in Outcome), NO_OUTCOME)
NONE = "none"
"""As a value: there is no such thing."""

_EVEN = 1e-9
"""Numbers are equal that differ by less of themselves: one is typed in decimals, the other computed."""
_DATES = (("%Y-%m-%d", timedelta(days=1)), ("%Y-%m-%dT%H:%M", timedelta(minutes=1)), ("%Y-%m", None), ("%Y", None))


def stations(session: Session) -> list[str]:
    """Return the stations that have made runs, and the one at work."""
    return sorted({*session.scalars(select(RunIndexRow.station).distinct()), station_of(session)})


def kinds(session: Session) -> list[str]:
    """Return what runs were for: the kinds there are, and the experiments that ran."""
    ran = session.scalars(select(RunIndexRow.experiment).distinct())
    return sorted({*(str(kind) for kind in RunKind), *(name for name in ran if name)})


def text(
    column: InstrumentedAttribute[str], term: Compare, other: InstrumentedAttribute[str] | None = None
) -> Condition:
    """Compare a text, or another one that says the same more shortly."""
    columns = [column] if other is None else [column, other]
    texts = [
        "" if value.text.casefold() == NONE and term.op is not Op.CONTAINS else value.text.casefold()
        for value in term.values
    ]
    match term.op:
        case Op.EQUAL:
            return or_(*(one.in_(texts) for one in columns))
        case Op.UNLIKE:
            return and_(*(one.not_in(texts) for one in columns))
        case Op.CONTAINS:
            return or_(*(one.contains(text, autoescape=True) for one in columns for text in texts))
        case _:
            raise QueryError(
                term.name.place, f"{term.name.text} is a text, which {term.op} does not compare: use = != ~"
            )


def kind(session: Session, term: Compare) -> Condition:
    """Compare what a run was for, by kind or by the name of its experiment."""
    known = kinds(session)
    if term.op is not Op.CONTAINS:
        _require_known(term, known, "kind of runs")
    return text(RunIndexRow.kind, term, RunIndexRow.experiment)


def station(session: Session, term: Compare) -> Condition:
    """Compare the station that made a run."""
    known = [name or NONE for name in stations(session)]
    if term.op is not Op.CONTAINS:
        _require_known(term, known, "station")
    match term.op:
        case Op.EQUAL:
            return RunIndexRow.station.in_([_station_of(value, known) for value in term.values])
        case Op.UNLIKE:
            return RunIndexRow.station.not_in([_station_of(value, known) for value in term.values])
        case Op.CONTAINS:
            return or_(*(RunIndexRow.station.icontains(value.text, autoescape=True) for value in term.values))
        case _:
            raise QueryError(term.name.place, f"station is a text, which {term.op} does not compare: use = != ~")


def _station_of(value: Value, known: Sequence[str]) -> str:
    """Return the station of a name, whose capitals matter only where another one differs by nothing else."""
    meant = [name for name in known if name == value.text] or [
        name for name in known if name.casefold() == value.text.casefold()
    ]
    if len(meant) > 1:
        raise QueryError(value.place, f"{value.text!r} may be several stations: write {' or '.join(meant)}")
    return "" if meant[0] == NONE else meant[0]


def choice(column: InstrumentedAttribute[str], term: Compare, known: Sequence[str]) -> Condition:
    """Compare one of a few words."""
    if term.op is not Op.CONTAINS:
        _require_known(term, known, term.name.text)
    values = [value.text.casefold() for value in term.values]
    match term.op:
        case Op.EQUAL:
            return column.in_(values)
        case Op.UNLIKE:
            return column.not_in(values)
        case _:
            raise QueryError(
                term.name.place, f"{term.name.text} is one of a few words, which {term.op} does not compare: use = !="
            )


def _require_known(term: Compare, known: Sequence[str], what: str) -> None:
    for value in term.values:
        if value.text.casefold() not in {name.casefold() for name in known}:
            raise QueryError(value.place, f"there is no {what} {value.text!r}", known, value.text)


def tag_as_kept(tag: str) -> str:
    """Return a word as tags are kept: small letters, an accent and its letter as one character (Unicode's NFC)."""
    return normalize("NFC", normalize("NFC", tag).casefold())


def tag(term: Compare) -> Condition:
    """Compare the tags of a run, of which one has to fit."""
    tags = [tag_as_kept(value.text) for value in term.values]
    tagged = select(RunTagRow.run_id)
    any_tag = RunIndexRow.run_id.in_(tagged)
    named = RunIndexRow.run_id.in_(tagged.where(RunTagRow.tag.in_(tags)))
    fits = or_(named, not_(any_tag)) if NONE in tags else named
    match term.op:
        case Op.EQUAL:
            return fits
        case Op.UNLIKE:
            return not_(fits)
        case Op.CONTAINS:
            contained = or_(*(RunTagRow.tag.contains(tag, autoescape=True) for tag in tags))
            return RunIndexRow.run_id.in_(tagged.where(contained))
        case _:
            raise QueryError(term.name.place, f"a tag is a word, which {term.op} does not compare: use = != ~")


def date(term: Compare) -> Condition:
    """Compare when a run started with a year, a month, a day or a minute."""
    spans = [_span(value) for value in term.values]
    (first, after), column = spans[0], RunIndexRow.started_at
    within = or_(*(and_(column >= begin, column < end) for begin, end in spans))
    match term.op:
        case Op.EQUAL:
            return within
        case Op.UNLIKE:
            return not_(within)
        case Op.BELOW:
            return column < first
        case Op.AT_MOST:
            return column < after
        case Op.ABOVE:
            return column >= after
        case Op.AT_LEAST:
            return column >= first
        case Op.CONTAINS:
            raise QueryError(term.name.place, "a date is not looked into: use = != < <= > >=")


def _span(value: Value) -> tuple[datetime, datetime]:
    """Return the instants from and up to which a date reaches: a year, a month, a day or a minute, in UTC."""
    for form, length in _DATES:
        try:
            first = datetime.strptime(value.text.upper(), form).replace(tzinfo=UTC)
            if length is not None:
                return first, first + length
            return first, first.replace(
                year=first.year + (form == "%Y" or first.month == 12), month=1 if form == "%Y" else first.month % 12 + 1
            )
        except (ValueError, OverflowError):
            continue
    raise QueryError(value.place, f"{value.text!r} is no date: write 2026-03-31, 2026-03 or 2026-03-31T10:30, in UTC")


def or_none(term: Compare, there: Condition, compared: Callable[[Compare], Condition]) -> Condition:
    """Compare what may not be there, ``none`` among the values; ``compared`` holds for nothing that is not there."""
    asked = tuple(value for value in term.values if value.text.casefold() != NONE)
    if len(asked) == len(term.values) or term.op not in (Op.EQUAL, Op.UNLIKE):
        return compared(term)
    rest = [compared(replace(term, values=asked))] if asked else []
    if term.op is Op.EQUAL:
        return or_(not_(there), *rest)
    return and_(there, *rest)


def number(column: NumberColumn, term: Compare) -> Condition:
    """Compare a number; where there is none, no comparison holds."""
    numbers = [_read(value, term) for value in term.values]
    within = or_(*(column.between(*_around(number)) for number in numbers))
    match term.op:
        case Op.EQUAL:
            return within
        case Op.UNLIKE:
            return and_(column.is_not(None), not_(within))
        case Op.BELOW:
            return column < numbers[0]
        case Op.AT_MOST:
            return column <= numbers[0]
        case Op.ABOVE:
            return column > numbers[0]
        case Op.AT_LEAST:
            return column >= numbers[0]
        case Op.CONTAINS:
            raise QueryError(
                term.name.place, f"{term.name.text} is a number, which ~ does not look into: use = != < <= > >="
            )


def _around(number: float) -> tuple[float, float]:
    return number - _EVEN * abs(number), number + _EVEN * abs(number)


def _read(value: Value, term: Compare) -> float:
    number = as_number(value.text)
    if number is None:
        raise QueryError(
            value.place,
            f"{term.name.text} is compared with a number, which {value.text!r} is not: write it in SI, or as 60°",
        )
    return number


def as_number(text: str) -> float | None:
    """Return a finite number, an angle of degrees in radians; None where a text is neither."""
    text = text.replace("°", "deg")
    degrees = text.endswith("deg")
    try:
        number = float(text.removesuffix("deg"))
    except ValueError:
        return None
    number = math.radians(number) if degrees else number
    return number if math.isfinite(number) else None
