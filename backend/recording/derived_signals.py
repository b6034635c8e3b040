"""Derived signals: combinations of columns, and formulas of the station."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, reduce
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from backend.models import UnreadableDocumentError
from backend.response_docs import COMPLETE_RESPONSE_CONFIG, describe_field
from backend.sample import COMBINED_SIGNAL_BY_NAME, STORED, UNIT_BY_SIGNAL, CombinedSignal, Field, Term
from backend.storage import Formula, Session, formulas, runs

# Formula -------------------------------------------------------------------------------------------
# A derived signal: the steps of a formula over signals, evaluated for many samples together.
#
# Steps are an expression tree in postfix order; the page evaluates the same steps (frontend/src/samples/formula.ts),
# and a test compares both. Results that are not finite become NaN, and NaN propagates: a gap stays a gap.


Column = NDArray[np.float64]
MAX_DIGITS = 15
"""Largest number of digits for rounding, before or after the decimal point."""

Operation = Literal[
    "number", "signal", "length", "neg", "not", "add", "sub", "mul", "div", "mod", "pow",
    "lt", "le", "gt", "ge", "eq", "ne", "and", "or", "if", "min", "max", "abs", "sqrt", "round",
]  # fmt: skip


@dataclass(frozen=True)
class FormulaStep:
    """One step: ``op`` replaces the last ``of`` values by one.

    ``number`` adds ``value``, ``signal`` the column ``name``, ``length`` the length ``name`` of the geometry.
    """

    __pydantic_config__ = COMPLETE_RESPONSE_CONFIG

    op: Operation
    of: int = 0
    value: float = field(default=0.0, metadata=describe_field("value of a number"))
    name: str = field(default="", metadata=describe_field("name of a signal, or of a length of the geometry"))


@dataclass(frozen=True)
class Derived:
    """A signal computed from others; ``unit`` and ``meaning`` are set by its author."""

    name: str
    unit: str
    steps: tuple[FormulaStep, ...]
    meaning: str = ""

    @cached_property
    def signals(self) -> tuple[str, ...]:
        """Columns that it uses."""
        return tuple(dict.fromkeys(step.name for step in self.steps if step.op == "signal"))

    @cached_property
    def lengths(self) -> frozenset[str]:
        """Lengths of the geometry that it uses."""
        return frozenset(step.name for step in self.steps if step.op == "length")

    def values(self, columns: Mapping[str, Column], lengths: Mapping[str, float], count: int) -> Column:
        """Return ``count`` values; a missing column is NaN."""
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


def _divide(a: Column, b: Column) -> Column:
    return np.where(b == 0.0, np.nan, a / b)


def _remainder(a: Column, b: Column) -> Column:
    return np.where(b == 0.0, np.nan, np.mod(a, b))


def _round(operands: Sequence[Column]) -> Column:
    digits = operands[1] if len(operands) > 1 else np.zeros_like(operands[0])
    scale = np.power(10.0, digits)
    allowed = (np.abs(digits) <= MAX_DIGITS) & (digits == np.rint(digits))
    return np.where(allowed, np.rint(operands[0] * scale) / scale, np.nan)


_OPERATIONS: dict[str, Callable[[Sequence[Column]], Column]] = {
    "neg": lambda taken: -taken[0],
    "not": lambda taken: 1.0 - _holds(taken[0]),
    "add": _pair(np.add),
    "sub": _pair(np.subtract),
    "mul": _pair(np.multiply),
    "div": _pair(_divide),
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
    "round": _round,
}


# Computed signals ----------------------------------------------------------------------------------
# Signals that are not stored but computed from columns: combined signals, and formulas of the station.


ComputedSignal = CombinedSignal | Derived


def select_derived(session: Session, names: Iterable[str]) -> dict[str, ComputedSignal]:
    """Return the computed signals among ``names``, by name."""
    asked = list(dict.fromkeys(names))
    found: dict[str, ComputedSignal] = {
        name: COMBINED_SIGNAL_BY_NAME[name] for name in asked if name in COMBINED_SIGNAL_BY_NAME
    }
    if any(name not in UNIT_BY_SIGNAL for name in asked):
        derived = {one.name: one for one in map(build_derived_signal, formulas.find(session))}
        found |= {name: derived[name] for name in asked if name in derived}
    return found


def describe_signals(session: Session, names: Iterable[str]) -> dict[str, Field | ComputedSignal]:
    """Return the known signals among ``names`` with unit and meaning, by name."""
    asked = list(names)
    return {one.name: one for one in STORED if one.name in asked} | select_derived(session, asked)


def build_derived_signal(formula: Formula) -> Derived:
    """Return the derived signal of a stored formula."""
    meaning = f"{formula.meaning}, {formula.expression}" if formula.meaning else formula.expression
    return Derived(formula.name, formula.unit, tuple(FormulaStep(**step) for step in formula.steps), meaning)


def find_source_columns(wanted: Iterable[ComputedSignal]) -> list[str]:
    """Return the columns that these signals use, without duplicates."""
    parts = (one.signals if isinstance(one, Derived) else [term.column for term in one.terms] for one in wanted)
    return list(dict.fromkeys(name for part in parts for name in part))


def compute_signal(
    one: ComputedSignal, columns: Mapping[str, NDArray[np.float64]], lengths: Mapping[str, float], count: int
) -> NDArray[np.float64]:
    """Return ``count`` values of a signal; NaN if one of its columns is missing."""
    if isinstance(one, Derived):
        return one.values(columns, lengths, count)
    nothing = np.full(count, np.nan)
    return compute_sum(((columns.get(term.column, nothing), term) for term in one.terms), lengths)


def compute_sum(parts: Iterable[tuple[NDArray[np.float64], Term]], lengths: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the sum of columns, each weighted by its term.

    ``lengths`` are those of the geometry [m], by name.
    """
    total: NDArray[np.float64] = np.sum(
        [term.sign * (lengths[term.length] if term.length else 1.0) * column for column, term in parts], axis=0
    )
    return total


def load_geometry_lengths(session: Session, run_id: int, wanted: Sequence[ComputedSignal]) -> dict[str, float]:
    """Return the lengths of the geometry [m] that these signals need, by name.

    NaN if the run has none.
    """
    names = {name for one in wanted for name in _lengths(one)}
    return {name: _length(session, run_id, name) for name in names}


def _lengths(one: ComputedSignal) -> Iterable[str]:
    return one.lengths if isinstance(one, Derived) else {str(term.length) for term in one.terms} - {""}


def _length(session: Session, run_id: int, name: str) -> float:
    try:
        return runs.get(session, run_id).number("geometry", name)
    except UnreadableDocumentError:  # imported runs may lack parameters
        return np.nan
