"""Derived signals of the station as the page writes them: checked and stored."""

import asyncio
from dataclasses import asdict

from backend.errors import Because, RefusalError
from backend.experiments.parser import ExpressionError, derived_of
from backend.recording.derived_signals import derived_from
from backend.schemas.state import FormulaList, FormulaText, FormulaView, StepView
from backend.storage import formulas
from backend.storage.database import Database
from backend.storage.formulas import Formula

MOST = 50
"""So many formulas a station may have."""


class Formulas:
    """Reads and writes the formulas of a station in threads."""

    def __init__(self, database: Database) -> None:
        self._database = database

    async def all(self) -> FormulaList:
        """Return the formulas, by name."""
        return await asyncio.to_thread(self._all)

    async def put(self, name: str, text: FormulaText, who: str) -> FormulaView:
        """Write a formula, or change the one of this name. Raises RefusalError."""
        return await asyncio.to_thread(self._put, name, text, who)

    async def remove(self, name: str, who: str) -> None:
        """Remove a formula. Raises UnknownRecordError."""
        await asyncio.to_thread(self._remove, name, who)

    def _all(self) -> FormulaList:
        with self._database.reading() as session:
            return FormulaList(formulas=[_view(one) for one in formulas.find(session)])

    def _put(self, name: str, text: FormulaText, who: str) -> FormulaView:
        try:
            derived = derived_of(name, text.unit, text.expression)
        except ExpressionError as error:
            raise RefusalError(Because.BAD_VALUE, str(error), code="bad_formula") from None
        with self._database.session() as session:
            others = [one.name for one in formulas.find(session) if one.name != name]
            if len(others) >= MOST:
                raise RefusalError(Because.BAD_VALUE, f"a station has {MOST} formulas at most: remove one first")
            alike = next((one for one in others if one.lower() == name.lower()), None)
            if alike is not None:
                raise RefusalError(
                    Because.BAD_VALUE, f"{name!r} differs from {alike!r} by case only", code="bad_formula"
                )
            steps = [asdict(step) for step in derived.steps]
            return _view(formulas.put(session, name, text.expression, steps, text.unit, text.meaning, who))

    def _remove(self, name: str, who: str) -> None:
        with self._database.session() as session:
            formulas.remove(session, name, who)


def _view(one: Formula) -> FormulaView:
    derived = derived_from(one)
    return FormulaView(
        name=one.name,
        expression=one.expression,
        unit=one.unit,
        meaning=one.meaning,
        who=one.who,
        at=one.at,
        signals=list(derived.signals),
        steps=[StepView(**asdict(step)) for step in derived.steps],
    )
