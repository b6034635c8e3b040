"""Looks for runs among many: what ``run_query`` has understood becomes conditions on the tables of ``run_index``."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import partial

from sqlalchemy import and_, false, func, not_, or_, select, true
from sqlalchemy.orm import InstrumentedAttribute, Session

from backend.storage.index_schema import ParameterValueRow, RunIndexRow, RunTagRow, RunValueRow, ValueNameRow
from backend.storage.run_index import ValueSource
from backend.storage.run_query import All, AnyOf, Compare, Not, Op, Query, QueryError, Value, Word, names_in
from backend.storage.run_terms import (
    ENDS,
    VERDICTS,
    Condition,
    as_number,
    choice,
    date,
    kind,
    kinds,
    number,
    or_none,
    station,
    stations,
    tag,
    text,
)
from backend.storage.stations import station_of

_TEXTS: dict[str, InstrumentedAttribute[str]] = {
    "experiment": RunIndexRow.experiment,
    "title": RunIndexRow.title,
    "plant": RunIndexRow.plant,
    "parameters": RunIndexRow.parameters,
    "who": RunIndexRow.who,
    "note": RunIndexRow.note,
}
_OTHERS = ("run", "lasted_s", "kind", "bank", "station", "tag", "end", "verdict", "date")
FIELDS = tuple(sorted((*_TEXTS, *_OTHERS)))
"""What every run has; beside these there are the names of parameters, settings and metrics."""


@dataclass(frozen=True)
class Found:
    """The numbers of the runs of a page, newest first, and how many there are altogether."""

    run_ids: tuple[int, ...]
    total: int


@dataclass(frozen=True)
class KnownWords:
    """What can be asked for among the runs that are stored."""

    kinds: tuple[str, ...]
    tags: tuple[str, ...]
    stations: tuple[str, ...]
    values: dict[str, tuple[str, ...]]


def search(session: Session, query: Query, *, everywhere: bool, limit: int | None, offset: int = 0) -> Found:
    """Return the runs that fit: of the station, or with ``everywhere``, or where stations are named, of all of them.

    Raises QueryError.
    """
    conditions = _fits(session, query, everywhere=everywhere)
    asked = select(RunIndexRow.run_id).where(*conditions).order_by(RunIndexRow.run_id.desc()).limit(limit)
    return Found(tuple(session.scalars(asked.offset(offset))), _count(session, conditions))


def _fits(session: Session, query: Query, *, everywhere: bool) -> list[Condition]:
    conditions = [_condition(session, query)]
    if not everywhere and "station" not in names_in(query):
        conditions.append(RunIndexRow.station == station_of(session))
    return conditions


def _count(session: Session, conditions: Sequence[Condition]) -> int:
    return session.scalar(select(func.count()).select_from(RunIndexRow).where(*conditions)) or 0


@dataclass(frozen=True)
class MetricPoints:
    """A metric of runs, oldest first: number, start, value. ``fitting`` runs were asked of, ``measured`` have it."""

    points: tuple[tuple[int, datetime, float], ...]
    fitting: int
    measured: int


def metric_points(session: Session, query: Query, metric: str, *, everywhere: bool, limit: int) -> MetricPoints:
    """Return a metric of the runs that fit, of the newest ``limit`` that have it. Raises QueryError."""
    fits = _fits(session, query, everywhere=everywhere)
    name_id = select(ValueNameRow.id).where(
        ValueNameRow.source == ValueSource.METRIC.value, ValueNameRow.name == metric
    )
    valued = select(RunIndexRow.run_id, RunIndexRow.started_at, RunValueRow.value)
    valued = valued.join(RunValueRow, RunValueRow.run_id == RunIndexRow.run_id)
    valued = valued.where(*fits, RunValueRow.name_id == name_id.scalar_subquery(), RunValueRow.value.is_not(None))
    newest = session.execute(valued.order_by(RunIndexRow.started_at.desc(), RunIndexRow.run_id.desc()).limit(limit))
    points = tuple((run_id, at, value) for run_id, at, value in newest if value is not None)
    measured = session.scalar(select(func.count()).select_from(valued.subquery())) or 0
    return MetricPoints(points[::-1], _count(session, fits), measured)


def known_words(session: Session) -> KnownWords:
    """Return what can be asked for."""
    named = session.execute(select(ValueNameRow.source, ValueNameRow.name).order_by(ValueNameRow.name))
    values: dict[str, list[str]] = {str(source): [] for source in ValueSource}
    for source, name in named:
        values[source].append(name)
    return KnownWords(
        kinds=tuple(kinds(session)),
        tags=tuple(session.scalars(select(RunTagRow.tag).distinct().order_by(RunTagRow.tag))),
        stations=tuple(stations(session)),
        values={source: tuple(names) for source, names in values.items()},
    )


def _condition(session: Session, query: Query) -> Condition:
    match query:
        case Word(value):
            return _word(value.text)
        case All(parts):
            return and_(true(), *(_condition(session, part) for part in parts))
        case AnyOf(parts):
            return or_(false(), *(_condition(session, part) for part in parts))
        case Not(part):
            return not_(_condition(session, part))
        case Compare():
            return _compared(session, query)


def _word(text: str) -> Condition:
    contained = RunIndexRow.words.contains(text.casefold(), autoescape=True)
    return or_(RunIndexRow.run_id == int(text), contained) if _is_run_number(text) else contained


def _is_run_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 10


def _compared(session: Session, term: Compare) -> Condition:
    name = term.name.text
    match name:
        case "kind":
            return kind(session, term)
        case "bank":
            return text(RunIndexRow.bank, term, RunIndexRow.bank_name)
        case "station":
            return station(session, term)
        case "tag":
            return tag(term)
        case "end":
            return choice(RunIndexRow.end_state, term, ENDS)
        case "verdict":
            return choice(RunIndexRow.outcome, term, VERDICTS)
        case "date":
            return date(term)
        case _:
            return _plain(session, term)


def _plain(session: Session, term: Compare) -> Condition:
    name = term.name.text
    if name in _TEXTS:
        return text(_TEXTS[name], term)
    if name == "run":
        return number(RunIndexRow.run_id, term)
    if name == "lasted_s":
        return _lasted(term)
    return _value(session, term)


def _lasted(term: Compare) -> Condition:
    """Compare how long a run lasted; one that is not over fits no comparison, and so each ``not`` of one."""
    over = RunIndexRow.lasted_s.is_not(None)
    return or_none(term, over, lambda asked: and_(over, number(RunIndexRow.lasted_s, asked)))


def _value(session: Session, term: Compare) -> Condition:
    """Compare a parameter, a setting or a metric, by its name or with its source before it: metric.rise_q_s."""
    source, name_id = _named(session, term.name)
    if source is ValueSource.PARAMETER:
        of_sets = select(ParameterValueRow.parameters_sha256).where(ParameterValueRow.name_id == name_id)
        digest = RunIndexRow.parameters_sha256
        return or_none(
            term, digest.in_(of_sets), lambda asked: digest.in_(of_sets.where(number(ParameterValueRow.value, asked)))
        )
    of_runs = select(RunValueRow.run_id).where(RunValueRow.name_id == name_id)
    fits: Callable[[Compare], Condition] = partial(number, RunValueRow.value)
    if session.scalar(of_runs.where(RunValueRow.value.is_(None)).limit(1)) is not None:
        fits = _number_or_word
        numbers = session.scalar(of_runs.where(RunValueRow.value.is_not(None)).limit(1))
        if numbers is None and term.op not in (Op.EQUAL, Op.UNLIKE, Op.CONTAINS):
            said = f"{term.name.text} is a word, which {term.op} does not compare: use = != ~"
            raise QueryError(term.name.place, said)
    run_id = RunIndexRow.run_id
    return or_none(term, run_id.in_(of_runs), lambda asked: run_id.in_(of_runs.where(fits(asked))))


def _number_or_word(term: Compare) -> Condition:
    """Compare a setting that is a word in some runs; what is a number is one in others."""
    words = [value.text.casefold() for value in term.values]
    numbers = tuple(value for value in term.values if as_number(value.text) is not None)
    of_number = [number(RunValueRow.value, replace(term, values=numbers))] if numbers else []
    match term.op:
        case Op.EQUAL:
            return or_(RunValueRow.word.in_(words), *of_number)
        case Op.UNLIKE:
            return or_(RunValueRow.word.not_in(words), and_(RunValueRow.value.is_not(None), *of_number))
        case Op.CONTAINS:
            return or_(*(RunValueRow.word.contains(word, autoescape=True) for word in words))
        case _:
            return number(RunValueRow.value, term)


def _named(session: Session, name: Value) -> tuple[ValueSource, int]:
    rows = session.execute(select(ValueNameRow.source, ValueNameRow.name, ValueNameRow.id)).all()
    by_name = {(source, known): name_id for source, known, name_id in rows}
    before, dot, rest = name.text.partition(".")
    wanted = rest if dot and before in set(ValueSource) else name.text
    sources = [ValueSource(before)] if wanted != name.text else list(ValueSource)
    found = [(source, by_name[source.value, wanted]) for source in sources if (source.value, wanted) in by_name]
    if not found:
        known = sorted({known for _, known in by_name})
        raise QueryError(name.place, f"no stored run has a {wanted!r}", [*FIELDS, *known], wanted)
    if len(found) > 1:
        said = " or ".join(f"{source}.{wanted}" for source, _ in found)
        raise QueryError(name.place, f"{wanted} is the name of several things: write {said}")
    return found[0]
