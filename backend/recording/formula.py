"""A derived signal: the steps of a formula over signals, evaluated for many samples at once.

Steps are an expression tree in postfix order; the page evaluates the same steps (frontend/src/samples/formula.ts), and
a test compares the two. What has no finite value is nan, and whatever is made of nan is nan: a gap stays a gap.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Literal

import numpy as np
from numpy.typing import NDArray

Column = NDArray[np.float64]
MAX_DIGITS = 15
"""Most digits that a number is rounded to, before or after its point."""

Operation = Literal[
    "number", "signal", "length", "neg", "not", "add", "sub", "mul", "div", "mod", "pow",
    "lt", "le", "gt", "ge", "eq", "ne", "and", "or", "if", "min", "max", "abs", "sqrt", "round",
]  # fmt: skip


@dataclass(frozen=True)
class Step:
    """One step: ``op`` takes the last ``of`` values and leaves one.

    ``number`` leaves ``value``, ``signal`` the column ``name``, ``length`` the length ``name`` of the geometry.
    """

    op: Operation
    of: int = 0
    value: float = 0.0
    name: str = ""


@dataclass(frozen=True)
class Derived:
    """A signal that follows from others: ``unit`` and ``meaning`` are as its writer says."""

    name: str
    unit: str
    steps: tuple[Step, ...]
    meaning: str = ""

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """The columns that it is made of."""
        return tuple(dict.fromkeys(step.name for step in self.steps if step.op == "signal"))

    @cached_property
    def lengths(self) -> frozenset[str]:
        """The lengths of the geometry that it is made of."""
        return frozenset(step.name for step in self.steps if step.op == "length")

    def values(self, columns: Mapping[str, Column], lengths: Mapping[str, float], count: int) -> Column:
        """Return its ``count`` values; a column that is not there is nan."""
        nothing = np.full(count, np.nan)
        stack: list[Column] = []
        with np.errstate(all="ignore"):
            for step in self.steps:
                match step.op:
                    case "number":
                        stack.append(np.full(count, step.value))
                    case "signal":
                        stack.append(np.asarray(columns.get(step.name, nothing), np.float64))
                    case "length":
                        stack.append(np.full(count, lengths.get(step.name, np.nan)))
                    case "if":
                        test, body, otherwise = stack[-3:]
                        del stack[-3:]
                        stack.append(np.where(np.isnan(test), np.nan, np.where(test != 0.0, body, otherwise)))
                    case _:
                        taken = stack[-step.of :]
                        del stack[-step.of :]
                        stack.append(_finite(_OPERATIONS[step.op](taken).copy(), taken))
        return stack[0]


def _finite(values: Column, made_of: Sequence[Column]) -> Column:
    known = np.isfinite(values)
    for one in made_of:
        known &= ~np.isnan(one)
    values[~known] = np.nan
    return values


def _pair(of: Callable[[Column, Column], Column]) -> Callable[[Sequence[Column]], Column]:
    return lambda taken: np.asarray(of(taken[0], taken[1]), np.float64)


def _all(of: Callable[[Column, Column], Column]) -> Callable[[Sequence[Column]], Column]:
    return lambda taken: np.asarray(reduce(of, taken), np.float64)


def _holds(one: Column) -> Column:
    return np.asarray(one != 0.0, np.float64)


def _divided(a: Column, b: Column) -> Column:
    return np.where(b == 0.0, np.nan, a / b)


def _remainder(a: Column, b: Column) -> Column:
    return np.where(b == 0.0, np.nan, np.mod(a, b))


def _rounded(taken: Sequence[Column]) -> Column:
    digits = taken[1] if len(taken) > 1 else np.zeros_like(taken[0])
    scale = np.power(10.0, digits)
    allowed = (np.abs(digits) <= MAX_DIGITS) & (digits == np.rint(digits))
    return np.where(allowed, np.rint(taken[0] * scale) / scale, np.nan)


_OPERATIONS: dict[str, Callable[[Sequence[Column]], Column]] = {
    "neg": lambda taken: -taken[0],
    "not": lambda taken: 1.0 - _holds(taken[0]),
    "add": _pair(np.add),
    "sub": _pair(np.subtract),
    "mul": _pair(np.multiply),
    "div": _pair(_divided),
    "mod": _pair(_remainder),
    "pow": _pair(np.power),
    "lt": _pair(np.less),
    "le": _pair(np.less_equal),
    "gt": _pair(np.greater),
    "ge": _pair(np.greater_equal),
    "eq": _pair(np.equal),
    "ne": _pair(np.not_equal),
    "and": lambda taken: np.min([_holds(one) for one in taken], axis=0),
    "or": lambda taken: np.max([_holds(one) for one in taken], axis=0),
    "min": _all(np.minimum),
    "max": _all(np.maximum),
    "abs": lambda taken: np.abs(taken[0]),
    "sqrt": lambda taken: np.sqrt(taken[0]),
    "round": _rounded,
}
