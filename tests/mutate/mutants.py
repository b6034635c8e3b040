"""Mutants of a source file, each with one changed operator, constant or sign.

Numbers below 10 are increased by one, and larger ones are doubled, because tests tolerate one in a thousand.
Comparisons are reversed. If one side is plainly an integer, their boundary is moved too, because two measured or
computed floats are never equal. Code that affects only texts is unchanged: docstrings, type hints, f-strings,
exceptions, log messages, decorators. So are the arguments by which a compiled function is specialized.
"""

import ast
import bisect
import io
import itertools
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass

_ARITHMETIC: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("+", "-"),
    ast.Sub: ("-", "+"),
    ast.Mult: ("*", "/"),
    ast.Div: ("/", "*"),
    ast.FloorDiv: ("//", "*"),
    ast.Mod: ("%", "*"),
    ast.Pow: ("**", "*"),
    ast.MatMult: ("@", "*"),
    ast.BitAnd: ("&", "|"),
    ast.LShift: ("<<", ">>"),
    ast.RShift: (">>", "<<"),
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, tuple[str, ...]]] = {
    ast.Lt: ("<", ("<=", ">")),
    ast.LtE: ("<=", ("<", ">=")),
    ast.Gt: (">", (">=", "<")),
    ast.GtE: (">=", (">", "<=")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
    ast.Is: ("is", ("is not",)),
    ast.IsNot: ("is not", ("is",)),
    ast.In: ("in", ("not in",)),
    ast.NotIn: ("not in", ("in",)),
}
_JOINED = {ast.And: ("and", "or"), ast.Or: ("or", "and")}

_NOT_COMPUTED = {"annotation", "returns", "decorator_list", "type_params"}
_OF_WORDS = {"repr", "strict"}
"""Arguments that say how something is shown, or that lengths agree, which mypy and the shapes of arrays say already."""

_WHOLE_CALLS = {"len", "round", "int", "ord"}
_LARGE = 10

Place = tuple[int, int]
"""Line from 1 and column from 0, in characters."""


@dataclass(frozen=True)
class Mutant:
    """``path`` with ``new`` for ``old`` at offset ``at`` of its text; ``before`` and ``after`` are the line."""

    path: str
    line: int
    at: int
    old: str
    new: str
    before: str
    after: str

    def of(self, text: str) -> str:
        """Return the text of the file with this mutant."""
        return text[: self.at] + self.new + text[self.at + len(self.old) :]


def mutants(path: str, text: str) -> list[Mutant]:
    """Return the mutants of a file in the order of its text."""
    return sorted(_Finder(path, text).found(), key=lambda mutant: (mutant.at, mutant.new))


class _Finder:
    def __init__(self, path: str, text: str) -> None:
        self._path, self._text = path, text
        self._lines = text.splitlines(keepends=True)
        self._starts = [0]
        for line in self._lines:
            self._starts.append(self._starts[-1] + len(line))
        self._tokens = [
            token
            for token in tokenize.generate_tokens(io.StringIO(text).readline)
            if token.type in (tokenize.OP, tokenize.NAME)
        ]
        self._places = [token.start for token in self._tokens]

    def found(self) -> Iterator[Mutant]:
        return self._in(ast.parse(self._text))

    def _in(self, node: ast.AST) -> Iterator[Mutant]:
        yield from self._at(node)
        for name, value in ast.iter_fields(node):
            if name in _NOT_COMPUTED or isinstance(node, ast.JoinedStr | ast.Raise):
                continue
            if isinstance(node, ast.keyword) and node.arg in _OF_WORDS:
                continue
            if isinstance(node, ast.Call) and (_called(node) == "Specialised" or _logs(node)):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from self._in(child)

    def _at(self, node: ast.AST) -> Iterator[Mutant]:
        match node:
            case ast.BinOp(left=left, op=op, right=right) if type(op) in _ARITHMETIC and not (
                _words(left) or _words(right)
            ):
                old, new = _ARITHMETIC[type(op)]
                yield from self._operator(_end(self, left), _start(self, right), old, (new,))
            case ast.AugAssign(target=target, op=op, value=value) if type(op) in _ARITHMETIC and not _words(value):
                old, new = _ARITHMETIC[type(op)]
                yield from self._operator(_end(self, target), _start(self, value), f"{old}=", (f"{new}=",))
            case ast.Compare(left=left, ops=ops, comparators=comparators):
                for before, compared, after in zip([left, *comparators], ops, comparators, strict=False):
                    old, others = _COMPARISONS[type(compared)]
                    if len(others) > 1 and not (_is_whole(before) or _is_whole(after)):
                        others = others[1:]
                    yield from self._operator(_end(self, before), _start(self, after), old, others)
            case ast.BoolOp(op=joined, values=values):
                old, new = _JOINED[type(joined)]
                for before, after in itertools.pairwise(values):
                    yield from self._operator(_end(self, before), _start(self, after), old, (new,))
            case ast.UnaryOp(op=ast.USub() | ast.Not() as op, operand=operand):
                old = "-" if isinstance(op, ast.USub) else "not"
                yield from self._operator(_start(self, node), _start(self, operand), old, ("",))
            case ast.Constant(value=bool() as value):
                yield self._mutant(_start(self, node), str(value), str(not value))
            case ast.Constant(value=int() | float() as value):
                old = ast.get_source_segment(self._text, node) or ""
                yield self._mutant(_start(self, node), old, repr(value + 1 if abs(value) < _LARGE else 2 * value))
            case _:
                pass  # no computation

    def _operator(self, begin: Place, end: Place, old: str, others: tuple[str, ...]) -> Iterator[Mutant]:
        """Change the operator between two operands, which may be in parentheses."""
        first, *rest = old.split()
        for index in range(bisect.bisect_left(self._places, begin), bisect.bisect_left(self._places, end)):
            if [token.string for token in self._tokens[index : index + 1 + len(rest)]] == [first, *rest]:
                last = self._tokens[index + len(rest)]
                spelt = self._text[self._offset(self._tokens[index].start) : self._offset(last.end)]
                for new in others:
                    yield self._mutant(self._tokens[index].start, spelt, new)
                return

    def _mutant(self, place: Place, old: str, new: str) -> Mutant:
        at, line = self._offset(place), place[0]
        before = self._lines[line - 1].rstrip("\n")
        changed = self._text[:at] + new + self._text[at + len(old) :]
        after = changed[self._starts[line - 1] :].split("\n", 1)[0]
        return Mutant(self._path, line, at, old, new, before.strip(), after.strip())

    def _offset(self, place: Place) -> int:
        return self._starts[place[0] - 1] + place[1]

    def characters(self, line: int, in_bytes: int) -> Place:
        """Return the position of a column that ast counts in bytes."""
        return line, len(self._lines[line - 1].encode()[:in_bytes].decode())


def _start(finder: _Finder, node: ast.AST) -> Place:
    return finder.characters(node.lineno, node.col_offset)  # type: ignore[attr-defined]  # each expression has them


def _end(finder: _Finder, node: ast.AST) -> Place:
    return finder.characters(node.end_lineno, node.end_col_offset)  # type: ignore[attr-defined]  # likewise


def _is_whole(node: ast.AST) -> bool:
    """Return whether an operand is plainly an integer: a literal, a length, or composed of these."""
    match node:
        case ast.Constant(value=value):
            return isinstance(value, int) and not isinstance(value, bool)
        case ast.UnaryOp(operand=operand):
            return _is_whole(operand)
        case ast.BinOp(left=left, right=right):
            return _is_whole(left) or _is_whole(right)
        case ast.Call():
            return _called(node) in _WHOLE_CALLS
        case ast.Attribute(attr=name):
            return name in ("size", "ndim", "count")
        case _:
            return False


def _called(call: ast.Call) -> str:
    return call.func.id if isinstance(call.func, ast.Name) else getattr(call.func, "attr", "")


def _logs(call: ast.Call) -> bool:
    logger = call.func.value if isinstance(call.func, ast.Attribute) else None
    return isinstance(logger, ast.Name) and logger.id.lower() in ("_log", "logging")


def _words(node: ast.AST) -> bool:
    return isinstance(node, ast.JoinedStr) or (isinstance(node, ast.Constant) and isinstance(node.value, str))
