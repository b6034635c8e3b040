"""Small expressions of settings, "2 * hold_s": numbers, names, arithmetic, comparison, choice. Pure; nothing is run."""

import ast
import math
import operator
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

Names = Mapping[str, bool | int | float | str]
FUNCTIONS: dict[str, Callable[..., Any]] = {"min": min, "max": max, "abs": abs, "sqrt": math.sqrt, "round": round}
CONSTANTS = {"pi": math.pi}
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
        _look(_tree(expression).body, names)


def names_in(expression: str) -> set[str]:
    """Return the names that an expression speaks of. Raises ExpressionError."""
    return {node.id for node in ast.walk(_tree(expression)) if isinstance(node, ast.Name)}


class Compared(NamedTuple):
    """A name that is compared with a bound, both as numbers; ``below``: it has to stay below it."""

    name: str
    value: float
    bound: float
    below: bool


def bound_of(expression: str, names: Names) -> Compared | None:
    """Return what a comparison such as "S_low < S_high" says of its first name; None where it is less plain."""
    match _tree(expression).body:
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
        return expression
    tree = _tree(expression)
    _look(tree.body, names)
    try:
        return _evaluate(tree.body, names)
    except (ArithmeticError, ValueError, TypeError) as error:
        raise ExpressionError(f"{expression!r} has no value: {error}") from None


def _tree(expression: str) -> ast.Expression:
    try:
        return ast.parse(expression.strip(), mode="eval")
    except (SyntaxError, ValueError, MemoryError, RecursionError):
        raise ExpressionError(f"{expression!r} is no expression") from None


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


def _evaluate(node: ast.AST, names: Names) -> Any:
    match node:
        case ast.Constant(value=value):
            return value
        case ast.Name(id=name):
            return names[name] if name in names else CONSTANTS[name]
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
