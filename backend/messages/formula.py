"""Derived signals by formula: as written, and as the steps that compute them."""

from datetime import datetime
from typing import Annotated

from pydantic import Field

from backend.experiments.parser import MAX_LENGTH
from backend.messages.base import Schema
from backend.plain_text import ONE_LINE
from backend.recording.derived_signals import Operation

FormulaName = Annotated[str, Field(min_length=1, max_length=20, pattern="^[A-Za-z][A-Za-z0-9_]*$")]


class FormulaText(Schema):
    """What a person writes."""

    expression: Annotated[str, Field(min_length=1, max_length=MAX_LENGTH), ONE_LINE] = Field(
        description="expression over signals in SI, as in experiments: + - * / % **, comparisons, min, max, abs, sqrt, "
        "round, if else"
    )
    unit: Annotated[str, Field(min_length=1, max_length=20), ONE_LINE] = Field(
        description="SI unit of the result, as the writer says; 1 for a plain number"
    )
    meaning: Annotated[str, Field(max_length=100), ONE_LINE] = Field(default="", description="what it is, in words")


class StepView(Schema):
    """One step of a formula in postfix order: it takes the last ``of`` values and leaves one."""

    op: Operation
    of: int
    value: float = Field(description="of a number")
    name: str = Field(description="of a signal, or of a length of the geometry")


class FormulaView(FormulaText):
    """A formula as it is in force."""

    name: str
    who: str
    at: datetime
    signals: list[str] = Field(description="the signals that it is made of")
    steps: list[StepView]


class FormulaList(Schema):
    """The formulas of the station, by name."""

    formulas: list[FormulaView]
