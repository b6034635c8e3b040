"""What all schemas share: no unknown fields, finite numbers, a unit on each quantity."""

from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field

HUGE = 1e12
"""Beyond every quantity here, in whatever unit; what a quantity really may be is for the parts below to say."""

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-HUGE, le=HUGE)]
"""A number that is neither nan nor infinite, nor so large that reckoning with it would fail."""

RowNumber = Annotated[int, Field(ge=1, le=2**53)]
"""Number of something stored; a browser knows whole numbers up to 2^53."""

ANY_SIZE = {"ge": -HUGE, "le": HUGE}
"""Constraints of a quantity whose real bounds depend on the plant."""

UNITS: dict[str, str] = {}
"""Unit of each quantity by its name, for refusals; a name has one unit everywhere."""


class Schema(BaseModel):
    """A body that refuses unknown fields and numbers that are not finite."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, ser_json_inf_nan="null")

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        for name, field in cls.model_fields.items():
            if isinstance(field.json_schema_extra, dict) and "unit" in field.json_schema_extra:
                UNITS[name] = str(field.json_schema_extra["unit"])


def quantity(unit: str, meaning: str, **constraints: Any) -> Any:
    """Return a pydantic field that carries its SI unit into the schema and into refusals."""
    return Field(description=f"{meaning} [{unit}]", json_schema_extra={"unit": unit}, **constraints)


class Problem(Schema):
    """Why a request was refused, and what would be accepted. Numbers are in SI."""

    code: str
    message: str = Field(description="the whole of it in words, angles as the person who asked reads them")
    quantity: str | None = Field(default=None, description="name of the refused value in the interface")
    words: str | None = Field(default=None, description="the same in the operator's words")
    path: list[str | int] | None = Field(
        default=None, description="where the value stands in what was asked for: names, and places in lists from 0"
    )
    line: int | None = Field(default=None, description="of a text that was asked for, from 1")
    value: Any = None
    minimum: float | None = None
    maximum: float | None = None
    unit: str | None = None
    legal: list[str] | None = None


class Refusal(Schema):
    """Body of every answer that is not a success."""

    error: Problem
