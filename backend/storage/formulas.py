"""Derived signals of a station by name; each change is a new row."""

from dataclasses import dataclass
from datetime import UTC, datetime

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from backend.storage import messages
from backend.storage.orm import Document, FormulaRow, UnknownRecordError, to_record
from backend.storage.stations import session_station


@dataclass(frozen=True)
class Formula:
    """An active formula; ``unit`` and ``meaning`` are its author's.

    ``steps`` compute it.
    """

    name: str
    expression: str
    steps: list[Document]
    unit: str
    meaning: str
    who: str
    at: datetime


def save(
    session: Session, name: str, expression: str, steps: list[Document], unit: str, meaning: str, who: str
) -> Formula:
    """Store a formula, or change the one of this name."""
    return to_record(
        Formula,
        _add(
            session=session,
            name=name,
            expression=expression,
            steps=steps,
            unit=unit,
            meaning=meaning,
            who=who,
            removed=False,
        ),
    )


def remove(session: Session, name: str, who: str) -> None:
    """Remove the formula of this name. Raises UnknownRecordError."""
    found = next((one for one in find(session) if one.name == name), None)
    if found is None:
        raise UnknownRecordError(messages.formula_not_found(name=name))
    _add(
        session=session,
        name=name,
        expression=found.expression,
        steps=found.steps,
        unit=found.unit,
        meaning=found.meaning,
        who=who,
        removed=True,
    )


def find(session: Session) -> list[Formula]:
    """Return the formulas of the station, by name."""
    own = FormulaRow.station == session_station(session)
    newest = select(func.max(FormulaRow.id)).where(own).group_by(FormulaRow.name)
    rows = select(FormulaRow).where(FormulaRow.id.in_(newest), FormulaRow.removed.is_(False))
    return [to_record(Formula, row) for row in session.scalars(rows.order_by(FormulaRow.name))]


def ever(session: Session) -> set[str]:
    """Return the names of all current and removed formulas of the station."""
    return set(
        session.scalars(select(FormulaRow.name).where(FormulaRow.station == session_station(session)).distinct())
    )


def _add(
    session: Session,
    name: str,
    expression: str,
    steps: list[Document],
    unit: str,
    meaning: str,
    who: str,
    *,
    removed: bool,
) -> FormulaRow:
    row = FormulaRow(
        name=name,
        expression=expression,
        steps=steps,
        unit=unit,
        meaning=meaning,
        removed=removed,
        who=who,
        at=datetime.now(UTC),
        station=session_station(session),
    )
    session.add(row)
    session.flush()
    return row
