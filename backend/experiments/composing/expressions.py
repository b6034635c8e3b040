"""Small expressions of settings, "2 * hold_s": numbers, names, arithmetic, comparison, choice. Pure; nothing is run.

Every number is a float, and length, depth and rounding are bounded: the cost of an expression is known before any of it
is evaluated. With Python's own whole numbers ``round(1, -1000000000)`` computes a power of ten with a billion digits.
"""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

Names = Mapping[str, bool | int | float | str]
CONSTANTS = {"pi": math.pi}
MAX_LENGTH = 500
"""Longest expression [characters]."""

MAX_NODES = 200
"""Most numbers, names and operations of an expression."""

MAX_DEPTH = 30
"""Deepest nesting of an expression."""

MAX_DIGITS = 15
"""Most digits that a number is rounded to, before or after its point: a float has no more."""


def _rounded(number: float, digits: float = 0.0) -> float:
    if not abs(digits) <= MAX_DIGITS or digits != int(digits):
        raise ValueError(f"round takes a whole number of digits from -{MAX_DIGITS} to {MAX_DIGITS}")
    return round(float(number), int(digits))


FUNCTIONS: dict[str, Callable[..., Any]] = {
    "min": min,
    "max": max,
    "abs": abs,
    "sqrt": math.sqrt,
    "round": _rounded,
}
_BINARY: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Mod: operator.mod,
    ast.Pow: math.pow,
}
_UNARY: dict[type, Callable[[Any], Any]] = {ast.UAdd: operator.pos, ast.USub: operator.neg, ast.Not: operator.not_}
_COMPARE: dict[type, Callable[[Any, Any], bool]] = {
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
    ast.Eq: operator.eq,
    ast.NotEq: operator.ne,
}


class ExpressionError(ValueError):
    """An expression that cannot be read, or has no value."""


def number_of(expression: float | str, names: Names) -> float:
    """Return the number that an expression stands for. Raises ExpressionError."""
    value = _value_of(expression, names)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ExpressionError(f"{expression!r} is {value!r}, which is not a finite number")
    return float(value)


def truth_of(expression: str, names: Names) -> bool:
    """Return whether a comparison holds. Raises ExpressionError."""
    value = _value_of(expression, names)
    if not isinstance(value, bool):
        raise ExpressionError(f"{expression!r} is {value!r}, which is not a comparison")
    return value


def require_known(expression: float | str, names: Names) -> None:
    """Raise ExpressionError for a name or a form that is not known, whatever the values."""
    if isinstance(expression, str):
        _look(parsed(expression).body, names)


def names_in(expression: str) -> set[str]:
    """Return the names that an expression speaks of. Raises ExpressionError."""
    return {node.id for node in ast.walk(parsed(expression)) if isinstance(node, ast.Name)}


class Compared(NamedTuple):
    """A name that is compared with a bound, both as numbers; ``below``: it has to stay below it."""

    name: str
    value: float
    bound: float
    below: bool


def bound_of(expression: str, names: Names) -> Compared | None:
    """Return what a comparison such as "S_low < S_high" says of its first name; None where it is less plain."""
    match parsed(expression).body:
        case ast.Compare(
            left=ast.Name(id=name), ops=[ast.Lt() | ast.LtE() | ast.Gt() | ast.GtE() as sign], comparators=[right]
        ):
            value, bound = names.get(name), number_of(ast.unparse(right), names)
            if isinstance(value, int | float):
                return Compared(name, float(value), bound, isinstance(sign, ast.Lt | ast.LtE))
        case _:
            pass
    return None


def _value_of(expression: float | str, names: Names) -> Any:
    if not isinstance(expression, str):
        try:
            return _plain(expression)
        except OverflowError:
            raise ExpressionError("a number has more than 308 digits") from None
    tree = parsed(expression)
    _look(tree.body, names)
    try:
        return _evaluate(tree.body, names)
    except (ArithmeticError, ValueError, TypeError) as error:
        raise ExpressionError(f"{expression!r} has no value: {error}") from None


def parsed(expression: str) -> ast.Expression:
    """Return an expression as a tree of bounded size. Raises ExpressionError."""
    if len(expression) > MAX_LENGTH:
        raise ExpressionError(
            f"{expression[:40]!r}… has {len(expression)} characters, at most {MAX_LENGTH} are accepted: shorten it"
        )
    try:
        tree = ast.parse(expression.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ExpressionError(f"{expression!r} is no expression") from None
    _require_small(tree)
    return tree


def _require_small(tree: ast.Expression) -> None:
    """Raise ExpressionError for more than MAX_NODES nodes or a nesting deeper than MAX_DEPTH."""
    level: list[ast.AST] = [tree.body]
    count = depth = 0
    while level:
        count, depth = count + len(level), depth + 1
        if count > MAX_NODES:
            raise ExpressionError(f"an expression has at most {MAX_NODES} numbers, names and operations: simplify it")
        if depth > MAX_DEPTH:
            raise ExpressionError(f"an expression is nested at most {MAX_DEPTH} times: simplify it")
        level = [child for node in level for child in ast.iter_child_nodes(node) if isinstance(child, ast.expr)]


def _look(node: ast.AST, names: Names) -> None:
    match node:
        case ast.Name(id=name) if name not in names and name not in CONSTANTS:
            known = ", ".join((*names, *CONSTANTS))
            raise ExpressionError(f"{name!r} is not known here; known are {known}")
        case ast.Constant(value=value) if not isinstance(value, bool | int | float | str):
            raise ExpressionError(f"{value!r} is not taken in an expression")
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
            for argument in arguments:
                _look(argument, names)
            return
        case ast.Name() | ast.Constant():
            return
        case ast.BinOp(op=operation) if type(operation) in _BINARY:
            pass
        case ast.UnaryOp(op=operation) if type(operation) in _UNARY:
            pass
        case ast.Compare(ops=operations) if all(type(one) in _COMPARE for one in operations):
            pass
        case ast.IfExp() | ast.BoolOp():
            pass
        case _:
            known = ", ".join(FUNCTIONS)
            raise ExpressionError(f"{ast.unparse(node)[:60]!r} is not taken: + - * / % **, comparisons, {known}")
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            _look(child, names)


def _plain(value: Any) -> Any:
    """Return a number as a float, anything else as it is. Raises OverflowError."""
    return float(value) if isinstance(value, int) and not isinstance(value, bool) else value


def _evaluate(node: ast.AST, names: Names) -> Any:
    match node:
        case ast.Constant(value=value):
            return _plain(value)
        case ast.Name(id=name):
            return _plain(names[name] if name in names else CONSTANTS[name])
        case ast.BinOp(left=left, op=operation, right=right):
            return _BINARY[type(operation)](float(_evaluate(left, names)), float(_evaluate(right, names)))
        case ast.UnaryOp(op=operation, operand=operand):
            return _UNARY[type(operation)](_evaluate(operand, names))
        case ast.IfExp(test=test, body=body, orelse=otherwise):
            return _evaluate(body if _evaluate(test, names) else otherwise, names)
        case ast.BoolOp(op=operation, values=values):
            held = [bool(_evaluate(value, names)) for value in values]
            return all(held) if isinstance(operation, ast.And) else any(held)
        case ast.Compare(left=left, ops=operations, comparators=others):
            values = [_evaluate(one, names) for one in (left, *others)]
            return all(
                _COMPARE[type(one)](low, high) for one, low, high in zip(operations, values, values[1:], strict=False)
            )
        case ast.Call(func=ast.Name(id=name), args=arguments):
            return FUNCTIONS[name](*(_evaluate(argument, names) for argument in arguments))
        case _:
            raise ExpressionError("it cannot be evaluated")
