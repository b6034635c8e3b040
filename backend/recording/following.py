"""Signals that nobody stores, but that follow from the columns: combined ones, and those of the station's formulas."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from backend.documents.edge import UnreadableDocumentError
from backend.recording.formula import Derived, Step
from backend.sample import COMBINED_BY_NAME, STORED, UNIT_OF, Combined, Field, Term
from backend.storage import Session, formulas, runs
from backend.storage.formulas import Formula

Following = Combined | Derived


def following(session: Session, names: Iterable[str]) -> dict[str, Following]:
    """Return those of ``names`` that follow from others, by name."""
    asked = list(dict.fromkeys(names))
    found: dict[str, Following] = {name: COMBINED_BY_NAME[name] for name in asked if name in COMBINED_BY_NAME}
    if any(name not in UNIT_OF for name in asked):
        derived = {one.name: one for one in map(derived_from, formulas.find(session))}
        found |= {name: derived[name] for name in asked if name in derived}
    return found


def told_of(session: Session, names: Iterable[str]) -> dict[str, Field | Following]:
    """Return unit and meaning of those of ``names`` that are known, by name."""
    asked = list(names)
    return {one.name: one for one in STORED if one.name in asked} | following(session, asked)


def derived_from(formula: Formula) -> Derived:
    """Return the derived signal of a stored formula."""
    meaning = f"{formula.meaning}, {formula.expression}" if formula.meaning else formula.expression
    return Derived(formula.name, formula.unit, tuple(Step(**step) for step in formula.steps), meaning)


def columns_of(wanted: Iterable[Following]) -> list[str]:
    """Return the columns that these signals follow from, each once."""
    parts = (one.signals if isinstance(one, Derived) else [term.column for term in one.terms] for one in wanted)
    return list(dict.fromkeys(name for part in parts for name in part))


def computed(
    one: Following, columns: Mapping[str, NDArray[np.float64]], lengths: Mapping[str, float], count: int
) -> NDArray[np.float64]:
    """Return ``count`` values of a signal; nan where one of its columns is not there."""
    if isinstance(one, Derived):
        return one.values(columns, lengths, count)
    nothing = np.full(count, np.nan)
    return sum_of(((columns.get(term.column, nothing), term) for term in one.terms), lengths)


def sum_of(parts: Iterable[tuple[NDArray[np.float64], Term]], lengths: Mapping[str, float]) -> NDArray[np.float64]:
    """Return the sum of columns, each by its term; ``lengths`` are those of the geometry [m], by name."""
    total: NDArray[np.float64] = np.sum(
        [term.sign * (lengths[term.length] if term.length else 1.0) * column for column, term in parts], axis=0
    )
    return total


def lengths_of(session: Session, run_id: int, wanted: Sequence[Following]) -> dict[str, float]:
    """Return the lengths of the geometry [m] that these signals need, by name; nan where the run has none."""
    names = {name for one in wanted for name in _lengths(one)}
    return {name: _length(session, run_id, name) for name in names}


def _lengths(one: Following) -> Iterable[str]:
    return one.lengths if isinstance(one, Derived) else {str(term.length) for term in one.terms} - {""}


def _length(session: Session, run_id: int, name: str) -> float:
    try:
        return runs.get(session, run_id).number("geometry", name)
    except UnreadableDocumentError:  # an imported run may have come without
        return np.nan
