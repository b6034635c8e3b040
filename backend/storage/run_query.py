"""The language that runs are searched with: from its text to what is asked. Pure.

    tracking tag=worn overshoot_q_percent < 5 and (date >= 2026-03-01 or who ~ "ana") not end = tripped

A bare word stands somewhere in the run's texts, ``run 12`` is the run of that number; NAME OP VALUE compares, with
= != < <= > >= and ~ for "contains"; of several values with commas between one has to fit. Parts beside each other have
all to hold; ``or`` binds weaker than ``and``, ``not`` strongest.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from enum import StrEnum

from backend.errors import Because, RefusalError

LONGEST = 1000
_DEEPEST = 20
_MOST_TERMS = 60
_NEAR = 3


class Op(StrEnum):
    """How a value is compared."""

    EQUAL = "="
    UNLIKE = "!="
    BELOW = "<"
    AT_MOST = "<="
    ABOVE = ">"
    AT_LEAST = ">="
    CONTAINS = "~"


@dataclass(frozen=True)
class Value:
    """A value as it was written, and the place of its first character, from 0."""

    text: str
    place: int


@dataclass(frozen=True)
class Word:
    """A word that stands somewhere."""

    value: Value


@dataclass(frozen=True)
class Compare:
    """One of ``values`` has to fit what goes by ``name``."""

    name: Value
    op: Op
    values: tuple[Value, ...]


@dataclass(frozen=True)
class All:
    """All parts have to hold; without parts everything does."""

    parts: "tuple[Query, ...]" = ()


@dataclass(frozen=True)
class AnyOf:
    """One part has to hold."""

    parts: "tuple[Query, ...]"


@dataclass(frozen=True)
class Not:
    """The part must not hold."""

    part: "Query"


Query = Word | Compare | All | AnyOf | Not


class QueryError(RefusalError):
    """A search that says nothing that could be looked for: at which character, why, and what is known there."""

    def __init__(self, place: int, problem: str, known: Iterable[str] = (), given: str = "") -> None:
        self.place = place
        legal = list(known)
        near = get_close_matches(given, legal, _NEAR) if given else []
        hint = f"; did you mean {' or '.join(near)}?" if near else f"; known: {', '.join(legal[:12])}" if legal else ""
        more = f" and {len(legal) - 12} more" if legal and not near and len(legal) > 12 else ""
        said = f"search, character {place + 1}: {problem}{hint}{more}"
        super().__init__(Because.BAD_VALUE, said, code="bad_search", legal=legal or None)


@dataclass(frozen=True)
class _Token:
    text: str
    place: int
    quoted: bool = False

    def is_word(self) -> bool:
        return self.quoted or not _SIGN.fullmatch(self.text)

    def is_sign(self, sign: str) -> bool:
        return not self.quoted and self.text == sign

    def says(self, keyword: str) -> bool:
        return not self.quoted and self.text.lower() == keyword


_SIGN = re.compile(r"<=|>=|!=|[<>=~(),]")
_TOKEN = re.compile(r'\s*(?:(<=|>=|!=|[<>=~(),])|"((?:[^"\\]|\\.)*)"|([^\s<>=!~(),"]+))', re.DOTALL)


def parse(text: str) -> Query:
    """Return what a search asks. Raises QueryError."""
    if len(text) > LONGEST:
        raise QueryError(LONGEST, f"a search has {LONGEST} characters at most: shorten it")
    for place, letter in enumerate(text):
        if not letter.isprintable() and not letter.isspace():  # NUL and half characters, which no database takes
            raise QueryError(place, "a character that cannot be printed stands here: delete it")
    return _Parser(text).whole()


def names_in(query: Query) -> Iterator[str]:
    """Yield the names that are compared."""
    match query:
        case Compare(name):
            yield name.text
        case All(parts) | AnyOf(parts):
            for part in parts:
                yield from names_in(part)
        case Not(part):
            yield from names_in(part)
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
            raise QueryError(token.place, f"{token.text} has nothing that it belongs to: delete it, or write a term")
        return found

    def _either(self, depth: int) -> Query:
        parts = [self._both(depth)]
        while self._takes("or"):
            parts.append(self._both(depth))
        return parts[0] if len(parts) == 1 else AnyOf(tuple(parts))

    def _both(self, depth: int) -> Query:
        parts = [self._one(depth)]
        while (token := self._next()) is not None and not token.says("or") and not token.is_sign(")"):
            self._takes("and")
            parts.append(self._one(depth))
        return parts[0] if len(parts) == 1 else All(tuple(parts))

    def _one(self, depth: int) -> Query:
        token = self._next()
        if token is None:
            raise QueryError(self._end, "it ends where a term is expected: write a word, or NAME = VALUE")
        if depth > _DEEPEST:
            raise QueryError(token.place, f"brackets and nots go {_DEEPEST} deep at most: write it flatter")
        if self._takes("not"):
            return Not(self._one(depth + 1))
        if token.is_sign("("):
            self._at += 1
            found = self._either(depth + 1)
            closing = self._next()
            if closing is None or not closing.is_sign(")"):
                raise QueryError(token.place, "the bracket is not closed: write ) after what belongs into it")
            self._at += 1
            return found
        return self._term(token)

    def _term(self, token: _Token) -> Query:
        self._terms += 1
        if self._terms > _MOST_TERMS:
            raise QueryError(token.place, f"a search has {_MOST_TERMS} terms at most: leave some out")
        if not token.is_word() or token.says("and") or token.says("or"):
            raise QueryError(
                token.place, f"{token.text} stands where a term is expected: write a word, or NAME = VALUE"
            )
        self._at += 1
        sign = self._next()
        if token.says("run") and sign is not None and self._is_number_alone(sign):
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
            raise QueryError(values[1].place, f"{op} compares with one value: leave the others out")
        return Compare(Value(token.text, token.place), op, tuple(values))

    def _is_number_alone(self, token: _Token) -> bool:
        """Tell whether a number stands here that nothing is compared with: that of a run, as people write it."""
        behind = self._tokens[self._at + 1] if self._at + 1 < len(self._tokens) else None
        compared = behind is not None and not behind.quoted and behind.text in set(Op)
        return not token.quoted and re.fullmatch(r"[0-9]{1,15}", token.text) is not None and not compared

    def _value(self, after: _Token) -> Value:
        token = self._next()
        if token is None or not token.is_word():
            place = self._end if token is None else token.place
            raise QueryError(place, f"there is no value after {after.text}: write one, with spaces in quotes")
        self._at += 1
        return Value(token.text, token.place)

    def _next(self) -> _Token | None:
        return self._tokens[self._at] if self._at < len(self._tokens) else None

    def _takes(self, keyword: str) -> bool:
        token = self._next()
        taken = token is not None and token.says(keyword)
        self._at += taken
        return taken


def _tokens(text: str) -> Iterator[_Token]:
    at = 0
    while text[at:].strip():
        found = _TOKEN.match(text, at)
        if found is None:
            at += len(text[at:]) - len(text[at:].lstrip())
            open_quote = text[at] == '"'
            said = 'the quote is not closed: write " at its end' if open_quote else f"{text[at]} means nothing here"
            raise QueryError(at, said)
        sign, quoted, word = found.groups()
        if quoted is not None:
            yield _Token(re.sub(r"\\(.)", r"\1", quoted), found.start(2) - 1, quoted=True)
        else:
            yield _Token(sign or word, found.start(1) if sign else found.start(3))
        at = found.end()
