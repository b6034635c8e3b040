"""Formulas of derived signals: an expression of the experiment language over signals, as the steps that compute it."""

import ast
import re

from backend.experiments.composing.expressions import CONSTANTS, FUNCTIONS, ExpressionError, parsed
from backend.recording.derived_signals import Derived, Step
from backend.sample import COMBINED_BY_NAME, UNIT_OF, nearest

_NAME = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,19}")
_TAKEN = {*UNIT_OF, *FUNCTIONS, *CONSTANTS, "and", "or", "not", "if", "else", "tick", "t"}
KNOWN = tuple(name for name in UNIT_OF if name.isidentifier())
"""Signals that a formula may name; differences are written as such."""

_BINARY = {ast.Add: "add", ast.Sub: "sub", ast.Mult: "mul", ast.Div: "div", ast.Mod: "mod", ast.Pow: "pow"}
_COMPARE = {ast.Lt: "lt", ast.LtE: "le", ast.Gt: "gt", ast.GtE: "ge", ast.Eq: "eq", ast.NotEq: "ne"}
_ARGUMENTS = {"min": (2, 50), "max": (2, 50), "abs": (1, 1), "sqrt": (1, 1), "round": (1, 2)}


def derived_of(name: str, unit: str, expression: str) -> Derived:
    """Return the derived signal of a formula. Raises ExpressionError."""
    if not _NAME.fullmatch(name) or name in _TAKEN:
        raise ExpressionError(
            f"{name!r} cannot name a formula: take 1 to 20 letters, digits and _, a letter first, "
            "and no name of a signal or function"
        )
    steps: list[Step] = []
    _lay(parsed(expression).body, steps)
    found = Derived(name, unit, tuple(steps))
    if not found.signals:
        raise ExpressionError(f"{expression!r} speaks of no signal; a formula is made of {', '.join(KNOWN)}")
    return found


def _lay(node: ast.AST, steps: list[Step]) -> None:
    """Append the steps of a part of an expression."""
    match node:
        case ast.Constant(value=bool() | int() | float() as value):
            try:
                steps.append(Step("number", value=float(value)))
            except OverflowError:
                raise ExpressionError("a number has more than 308 digits") from None
        case ast.Name(id=name):
            _lay_name(name, steps)
        case ast.BinOp(left=left, op=operation, right=right) if type(operation) in _BINARY:
            _apply(_BINARY[type(operation)], [left, right], steps)
        case ast.UnaryOp(op=ast.UAdd(), operand=operand):
            _lay(operand, steps)
        case ast.UnaryOp(op=ast.USub(), operand=operand):
            _apply("neg", [operand], steps)
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            _apply("not", [operand], steps)
        case ast.IfExp(test=test, body=body, orelse=otherwise):
            _apply("if", [test, body, otherwise], steps)
        case ast.BoolOp(op=operation, values=values):
            _apply("and" if isinstance(operation, ast.And) else "or", values, steps)
        case ast.Compare(left=left, ops=operations, comparators=others) if all(type(o) in _COMPARE for o in operations):
            pairs = list(zip([left, *others], operations, others, strict=False))
            for one, sign, other in pairs:
                _apply(_COMPARE[type(sign)], [one, other], steps)
            if len(pairs) > 1:
                steps.append(Step("and", len(pairs)))
        case ast.Call(func=ast.Name(id=name), args=arguments, keywords=[]) if name in FUNCTIONS:
            least, most = _ARGUMENTS[name]
            if not least <= len(arguments) <= most:
                told = f"{least}" if least == most else f"{least} to {most}"
                raise ExpressionError(f"{name} takes {told} values, here are {len(arguments)}")
            _apply(name, arguments, steps)
        case _:
            known = ", ".join(FUNCTIONS)
            raise ExpressionError(
                f"{ast.unparse(node)[:60]!r} is not taken: + - * / % **, comparisons, and, or, not, if else, {known}"
            )


def _apply(operation: str, operands: list[ast.expr], steps: list[Step]) -> None:
    for operand in operands:
        _lay(operand, steps)
    steps.append(Step(operation, len(operands)))  # type: ignore[arg-type]  # the tables hold operations only


def _lay_name(name: str, steps: list[Step]) -> None:
    if name in CONSTANTS:
        steps.append(Step("number", value=CONSTANTS[name]))
    elif name in COMBINED_BY_NAME:
        for number, term in enumerate(COMBINED_BY_NAME[name].terms):
            steps.append(Step("signal", name=term.column))
            if term.length:
                steps += [Step("length", name=term.length), Step("mul", 2)]
            if term.sign < 0:
                steps.append(Step("neg", 1))
            if number:
                steps.append(Step("add", 2))
    elif name in KNOWN:
        steps.append(Step("signal", name=name))
    else:
        raise ExpressionError(f"there is no signal {name!r}: the nearest is {nearest(name, KNOWN)}")
