"""The search of runs: query language, terms, and conditions on the tables."""

import math
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from difflib import get_close_matches
from enum import StrEnum
from functools import partial
from unicodedata import normalize

from sqlalchemy import ColumnElement, and_, false, func, not_, or_, select, true
from sqlalchemy.orm import InstrumentedAttribute, Session

from backend.errors import RequestRejectedError
from backend.models import Outcome
from backend.storage import messages
from backend.storage.orm import ParameterValueRow, RunIndexRow, RunTagRow, RunValueRow, ValueNameRow
from backend.storage.runs import EndState, RunKind
from backend.storage.search_index import NO_OUTCOME, ValueSource
from backend.storage.stations import session_station
from plant import ErrorCode

# Run query -----------------------------------------------------------------------------------------
# The query language: from text to a query tree.
#
#     tracking tag=worn overshoot_q_percent < 5 and (date >= 2026-03-01 or who ~ "ana") not end = tripped
#
# A bare word is contained in the run's texts, ``run 12`` is the run of that number; NAME OP VALUE compares, with = != <
# <= > >= and ~ for "contains"; of several values separated by commas one must match. Adjacent terms must all match;
# ``or`` binds weaker than ``and``, ``not`` strongest.


LONGEST = 1000
_DEEPEST = 20
_MOST_TERMS = 60
_NEAR = 3


class Op(StrEnum):
    """Comparison operator."""

    EQUAL = "="
    UNLIKE = "!="
    BELOW = "<"
    AT_MOST = "<="
    ABOVE = ">"
    AT_LEAST = ">="
    CONTAINS = "~"


@dataclass(frozen=True)
class Value:
    """A value as written, and the position of its first character, from 0."""

    text: str
    place: int


@dataclass(frozen=True)
class Word:
    """A word contained in the run's texts."""

    value: Value


@dataclass(frozen=True)
class Compare:
    """One of ``values`` must match ``name``."""

    name: Value
    op: Op
    values: tuple[Value, ...]


@dataclass(frozen=True)
class All:
    """All parts must match; without parts every run matches."""

    parts: "tuple[Query, ...]" = ()


@dataclass(frozen=True)
class AnyOf:
    """One part must match."""

    parts: "tuple[Query, ...]"


@dataclass(frozen=True)
class Not:
    """The part must not match."""

    part: "Query"


Query = Word | Compare | All | AnyOf | Not


class QueryError(RequestRejectedError):
    """An invalid query: position, reason, and known names."""

    def __init__(self, place: int, problem: str, known: Iterable[str] = (), given: str = "") -> None:
        self.place = place
        legal = list(known)
        near = get_close_matches(given, legal, _NEAR) if given else []
        message = messages.invalid_search(place=place, reason=problem, near=near, known=legal)
        super().__init__(ErrorCode.BAD_VALUE, message, code="bad_search", legal=legal or None)


@dataclass(frozen=True)
class _Token:
    text: str
    place: int
    quoted: bool = False

    def is_word(self) -> bool:
        return self.quoted or not _SIGN.fullmatch(self.text)

    def is_sign(self, sign: str) -> bool:
        return not self.quoted and self.text == sign

    def is_keyword(self, keyword: str) -> bool:
        return not self.quoted and self.text.lower() == keyword


_SIGN = re.compile(r"<=|>=|!=|[<>=~(),]")
_TOKEN = re.compile(r'\s*(?:(<=|>=|!=|[<>=~(),])|"((?:[^"\\]|\\.)*)"|([^\s<>=!~(),"]+))', re.DOTALL)


def parse_query(text: str) -> Query:
    """Return the query tree of a text. Raises QueryError."""
    if len(text) > LONGEST:
        raise QueryError(LONGEST, messages.search_too_long(maximum=LONGEST))
    require_printable(text)
    return _Parser(text).whole()


def require_printable(text: str) -> None:
    """Raise QueryError for NUL, surrogates and other characters that no database accepts."""
    for place, letter in enumerate(text):
        if not letter.isprintable() and not letter.isspace():
            raise QueryError(place, messages.unprintable_character())


def find_names(query: Query) -> Iterator[str]:
    """Yield the names that are compared."""
    match query:
        case Compare(name):
            yield name.text
        case All(parts) | AnyOf(parts):
            for part in parts:
                yield from find_names(part)
        case Not(part):
            yield from find_names(part)
        case Word():
            pass


class _Parser:
    def __init__(self, text: str) -> None:
        self._tokens = list(_tokens(text))
        self._end = len(text)
        self._at = 0
        self._terms = 0

    def whole(self) -> Query:
        if not self._tokens:
            return All()
        found = self._either(0)
        if self._at < len(self._tokens):
            token = self._tokens[self._at]
            raise QueryError(token.place, messages.unexpected_token(token=token.text))
        return found

    def _either(self, depth: int) -> Query:
        parts = [self._both(depth)]
        while self._accept("or"):
            parts.append(self._both(depth))
        return parts[0] if len(parts) == 1 else AnyOf(tuple(parts))

    def _both(self, depth: int) -> Query:
        parts = [self._one(depth)]
        while (token := self._next()) is not None and not token.is_keyword("or") and not token.is_sign(")"):
            self._accept("and")
            parts.append(self._one(depth))
        return parts[0] if len(parts) == 1 else All(tuple(parts))

    def _one(self, depth: int) -> Query:
        token = self._next()
        if token is None:
            raise QueryError(self._end, messages.term_missing())
        if depth > _DEEPEST:
            raise QueryError(token.place, messages.nested_too_deep(maximum=_DEEPEST))
        if self._accept("not"):
            return Not(self._one(depth + 1))
        if token.is_sign("("):
            self._at += 1
            found = self._either(depth + 1)
            closing = self._next()
            if closing is None or not closing.is_sign(")"):
                raise QueryError(token.place, messages.bracket_not_closed())
            self._at += 1
            return found
        return self._term(token)

    def _term(self, token: _Token) -> Query:
        self._terms += 1
        if self._terms > _MOST_TERMS:
            raise QueryError(token.place, messages.too_many_terms(maximum=_MOST_TERMS))
        if not token.is_word() or token.is_keyword("and") or token.is_keyword("or"):
            raise QueryError(token.place, messages.not_a_term(token=token.text))
        self._at += 1
        sign = self._next()
        if token.is_keyword("run") and sign is not None and self._is_number_alone(sign):
            self._at += 1
            return Compare(Value("run", token.place), Op.EQUAL, (Value(sign.text, sign.place),))
        if token.quoted or sign is None or sign.quoted or sign.text not in set(Op):
            return Word(Value(token.text, token.place))
        self._at += 1
        op, values = Op(sign.text), [self._value(sign)]
        while (comma := self._next()) is not None and comma.is_sign(","):
            self._at += 1
            values.append(self._value(comma))
        if len(values) > 1 and op not in (Op.EQUAL, Op.UNLIKE, Op.CONTAINS):
            raise QueryError(values[1].place, messages.too_many_values(operator=op))
        return Compare(Value(token.text, token.place), op, tuple(values))

    def _is_number_alone(self, token: _Token) -> bool:
        """Return whether the next token is a number that is not compared: that of a run."""
        behind = self._tokens[self._at + 1] if self._at + 1 < len(self._tokens) else None
        compared = behind is not None and not behind.quoted and behind.text in set(Op)
        return not token.quoted and re.fullmatch(r"[0-9]{1,15}", token.text) is not None and not compared

    def _value(self, after: _Token) -> Value:
        token = self._next()
        if token is None or not token.is_word():
            place = self._end if token is None else token.place
            raise QueryError(place, messages.value_missing(token=after.text))
        self._at += 1
        return Value(token.text, token.place)

    def _next(self) -> _Token | None:
        return self._tokens[self._at] if self._at < len(self._tokens) else None

    def _accept(self, keyword: str) -> bool:
        token = self._next()
        taken = token is not None and token.is_keyword(keyword)
        self._at += taken
        return taken


def _tokens(text: str) -> Iterator[_Token]:
    at = 0
    while text[at:].strip():
        found = _TOKEN.match(text, at)
        if found is None:
            at += len(text[at:]) - len(text[at:].lstrip())
            if text[at] == '"':
                raise QueryError(at, messages.quote_not_closed())
            raise QueryError(at, messages.meaningless_character(character=text[at]))
        sign, quoted, word = found.groups()
        if quoted is not None:
            yield _Token(re.sub(r"\\(.)", r"\1", quoted), found.start(2) - 1, quoted=True)
        else:
            yield _Token(sign or word, found.start(1) if sign else found.start(3))
        at = found.end()


# Run terms -----------------------------------------------------------------------------------------
# Comparison of attributes that every run has: texts, kinds, stations, tags, dates, numbers.


Condition = ColumnElement[bool]
NumberColumn = InstrumentedAttribute[int] | InstrumentedAttribute[float] | InstrumentedAttribute[float | None]

ENDS = tuple(str(state) for state in EndState)
VERDICTS = (*(str(outcome) for outcome in Outcome), NO_OUTCOME)
NONE = "none"
"""Value that means that there is none."""

_EVEN = 1e-9
"""Relative difference within which numbers are equal: one is typed as a decimal, the other computed."""
_DATES = (("%Y-%m-%d", timedelta(days=1)), ("%Y-%m-%dT%H:%M", timedelta(minutes=1)), ("%Y-%m", None), ("%Y", None))


def stations(session: Session) -> list[str]:
    """Return the stations with runs, and the current one."""
    return sorted({*session.scalars(select(RunIndexRow.station).distinct()), session_station(session)})


def kinds(session: Session) -> list[str]:
    """Return the existing kinds of runs, and the experiments that ran."""
    ran = session.scalars(select(RunIndexRow.experiment).distinct())
    return sorted({*(str(kind) for kind in RunKind), *(name for name in ran if name)})


def text(
    column: InstrumentedAttribute[str], term: Compare, other: InstrumentedAttribute[str] | None = None
) -> Condition:
    """Compare a text, or an alternative shorter form of it."""
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
            raise QueryError(term.name.place, messages.operator_not_for_text(name=term.name.text, operator=term.op))


def kind(session: Session, term: Compare) -> Condition:
    """Compare the kind of a run, or the name of its experiment."""
    known = kinds(session)
    if term.op is not Op.CONTAINS:
        _require_known(term, known, "kind of run")
    return text(RunIndexRow.kind, term, RunIndexRow.experiment)


def station(session: Session, term: Compare) -> Condition:
    """Compare the station of a run."""
    known = [name or NONE for name in stations(session)]
    if term.op is not Op.CONTAINS:
        _require_known(term, known, "station")
    match term.op:
        case Op.EQUAL:
            return RunIndexRow.station.in_([_resolve_station(value, known) for value in term.values])
        case Op.UNLIKE:
            return RunIndexRow.station.not_in([_resolve_station(value, known) for value in term.values])
        case Op.CONTAINS:
            return or_(*(RunIndexRow.station.icontains(value.text, autoescape=True) for value in term.values))
        case _:
            raise QueryError(term.name.place, messages.operator_not_for_text(name="station", operator=term.op))


def _resolve_station(value: Value, known: Sequence[str]) -> str:
    """Return the station of a name; case matters only if names differ by nothing else."""
    meant = [name for name in known if name == value.text] or [
        name for name in known if name.casefold() == value.text.casefold()
    ]
    if len(meant) > 1:
        raise QueryError(value.place, messages.station_ambiguous(name=value.text, stations=meant))
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
            raise QueryError(term.name.place, messages.operator_not_for_choice(name=term.name.text, operator=term.op))


def _require_known(term: Compare, known: Sequence[str], what: str) -> None:
    for value in term.values:
        if value.text.casefold() not in {name.casefold() for name in known}:
            raise QueryError(value.place, messages.value_not_known(attribute=what, value=value.text), known, value.text)


def normalize_tag(tag: str) -> str:
    """Return a tag as stored: casefolded, in Unicode's NFC."""
    return normalize("NFC", normalize("NFC", tag).casefold())


def tag(term: Compare) -> Condition:
    """Compare the tags of a run, of which one must match."""
    tags = [normalize_tag(value.text) for value in term.values]
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
            raise QueryError(term.name.place, messages.operator_not_for_tag(operator=term.op))


def date(term: Compare) -> Condition:
    """Compare the start of a run with a year, a month, a day or a minute."""
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
            raise QueryError(term.name.place, messages.operator_not_for_date())


def _span(value: Value) -> tuple[datetime, datetime]:
    """Return the times from and up to which a date extends, in UTC.

    The date is a year, a month, a day or a minute.
    """
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
    raise QueryError(value.place, messages.not_a_date(value=value.text))


def or_none(term: Compare, there: Condition, compared: Callable[[Compare], Condition]) -> Condition:
    """Compare a value that may be missing, with ``none`` among the values.

    ``compared`` never matches a missing value.
    """
    asked = tuple(value for value in term.values if value.text.casefold() != NONE)
    if len(asked) == len(term.values) or term.op not in (Op.EQUAL, Op.UNLIKE):
        return compared(term)
    rest = [compared(replace(term, values=asked))] if asked else []
    if term.op is Op.EQUAL:
        return or_(not_(there), *rest)
    return and_(there, *rest)


def number(column: NumberColumn, term: Compare) -> Condition:
    """Compare a number; a missing number matches no comparison."""
    numbers = [_parse_number(value, term) for value in term.values]
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
            raise QueryError(term.name.place, messages.operator_not_for_number(name=term.name.text))


def _around(number: float) -> tuple[float, float]:
    return number - _EVEN * abs(number), number + _EVEN * abs(number)


def _parse_number(value: Value, term: Compare) -> float:
    number = as_number(value.text)
    if number is None:
        raise QueryError(value.place, messages.not_a_number(name=term.name.text, value=value.text))
    return number


def as_number(text: str) -> float | None:
    """Return a finite number, degrees converted to radians; None for other texts."""
    text = text.replace("°", "deg")
    degrees = text.endswith("deg")
    try:
        number = float(text.removesuffix("deg"))
    except ValueError:
        return None
    number = math.radians(number) if degrees else number
    return number if math.isfinite(number) else None


# Run search ----------------------------------------------------------------------------------------
# Search of runs: queries become conditions on the tables of the search index.


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
"""Attributes of every run, in addition to the names of parameters, settings and metrics."""


@dataclass(frozen=True)
class SearchPage:
    """Numbers of the runs of a page, newest first, and the total."""

    run_ids: tuple[int, ...]
    total: int


@dataclass(frozen=True)
class KnownWords:
    """Values that can be searched among the stored runs."""

    kinds: tuple[str, ...]
    tags: tuple[str, ...]
    stations: tuple[str, ...]
    values: dict[str, tuple[str, ...]]


def search(session: Session, query: Query, *, everywhere: bool, limit: int | None, offset: int = 0) -> SearchPage:
    """Return the matching runs: of the station, or of all stations.

    Of all with ``everywhere``, or if the query names stations. Raises QueryError.
    """
    conditions = _fits(session, query, everywhere=everywhere)
    asked = select(RunIndexRow.run_id).where(*conditions).order_by(RunIndexRow.run_id.desc()).limit(limit)
    return SearchPage(tuple(session.scalars(asked.offset(offset))), _count(session, conditions))


def _fits(session: Session, query: Query, *, everywhere: bool) -> list[Condition]:
    conditions = [_condition(session, query)]
    if not everywhere and "station" not in find_names(query):
        conditions.append(RunIndexRow.station == session_station(session))
    return conditions


def _count(session: Session, conditions: Sequence[Condition]) -> int:
    return session.scalar(select(func.count()).select_from(RunIndexRow).where(*conditions)) or 0


@dataclass(frozen=True)
class MetricPoints:
    """A metric of runs, oldest first: number, start, value.

    ``fitting`` is the number of matching runs, ``measured`` that of those with the metric.
    """

    points: tuple[tuple[int, datetime, float], ...]
    fitting: int
    measured: int


def metric_points(session: Session, query: Query, metric: str, *, everywhere: bool, limit: int) -> MetricPoints:
    """Return a metric of the matching runs, of the newest ``limit`` that have it.

    Raises QueryError.
    """
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
    """Return the values that can be searched."""
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
            return _compile_comparison(session, query)


def _word(text: str) -> Condition:
    contained = RunIndexRow.words.contains(text.casefold(), autoescape=True)
    return or_(RunIndexRow.run_id == int(text), contained) if _is_run_number(text) else contained


def _is_run_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 10


def _compile_comparison(session: Session, term: Compare) -> Condition:
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
        return _compile_duration(term)
    return _value(session, term)


def _compile_duration(term: Compare) -> Condition:
    """Compare the duration of a run.

    A run that is not over matches no comparison, nor the ``not`` of one.
    """
    over = RunIndexRow.lasted_s.is_not(None)
    return or_none(term, over, lambda asked: and_(over, number(RunIndexRow.lasted_s, asked)))


def _value(session: Session, term: Compare) -> Condition:
    """Compare a parameter, setting or metric, by name or as metric.rise_q_s."""
    source, name_id = _find_value_name(session, term.name)
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
            raise QueryError(term.name.place, messages.operator_not_for_word(name=term.name.text, operator=term.op))
    run_id = RunIndexRow.run_id
    return or_none(term, run_id.in_(of_runs), lambda asked: run_id.in_(of_runs.where(fits(asked))))


def _number_or_word(term: Compare) -> Condition:
    """Compare a setting that is a word in some runs and a number in others."""
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


def _find_value_name(session: Session, name: Value) -> tuple[ValueSource, int]:
    rows = session.execute(select(ValueNameRow.source, ValueNameRow.name, ValueNameRow.id)).all()
    by_name = {(source, known): name_id for source, known, name_id in rows}
    before, dot, rest = name.text.partition(".")
    wanted = rest if dot and before in set(ValueSource) else name.text
    sources = [ValueSource(before)] if wanted != name.text else list(ValueSource)
    found = [(source, by_name[source.value, wanted]) for source in sources if (source.value, wanted) in by_name]
    if not found:
        known = sorted({known for _, known in by_name})
        raise QueryError(name.place, messages.name_in_no_run(name=wanted), [*FIELDS, *known], wanted)
    if len(found) > 1:
        candidates = [f"{source}.{wanted}" for source, _ in found]
        raise QueryError(name.place, messages.name_ambiguous(name=wanted, candidates=candidates))
    return found[0]
