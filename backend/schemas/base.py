"""What all schemas share: checked fields with units, and refusals of malformed requests."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, Tag
from pydantic.fields import FieldInfo

from backend.errors import QUANTITY_LABELS, InvalidValueError, Path, describe_out_of_range
from backend.units import AngleUnit, format_angles, get_display_unit
from plant import SinewError

# Base ----------------------------------------------------------------------------------------------
#
# What all schemas share: no unknown fields, finite numbers, a unit on each quantity.


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


class ErrorDetail(Schema):
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


class ErrorResponse(Schema):
    """Body of every answer that is not a success."""

    error: ErrorDetail


# Malformed -----------------------------------------------------------------------------------------
#
# What is said of a body or a query that does not even have the right form: of which value, in the
# operator's words.


SHOWN = 40
"""Characters of a refused text that are repeated."""

_ONE_OF = {"tensions_N": "tension", "identifications": "run", "entries": "entry", "runs": "run"}
"""What one thing of a list is called."""

_SENTENCES = {
    "missing": "it is missing",
    "extra_forbidden": "it is not known here, leave it out",
    "string_type": "it needs a text",
    "list_type": "it needs a list",
    "dict_type": "it needs named values",
    "model_type": "it needs named values",
    "model_attributes_type": "it needs named values",
    "string_pattern_mismatch": "it has characters that are not taken here",
    "int_parsing_size": "the number is too long",
}


@dataclass(frozen=True)
class _Declared:
    """What the interface declares of a value; ``unit`` is None where it has none."""

    words: str
    unit: str | None = None
    legal: tuple[str, ...] = ()


def form_error_body(error: Mapping[str, Any], body: Any, angles: AngleUnit) -> ErrorDetail:
    """Return the error body for the first error that pydantic found; ``body`` is the type of what was to be sent."""
    path: Path = tuple(part for part in error["loc"] if part not in ("body", "query", "path"))
    given, bounds = error.get("input"), error.get("ctx", {})
    kind = str(error["type"])
    if kind == "union_tag_invalid":
        path, given = (*path, "kind"), bounds["tag"]
    declared = _declared(body, path, known=kind != "extra_forbidden")
    minimum, maximum = (_number(bounds, *keys) for keys in (("ge", "gt"), ("le", "lt")))
    number = _read_number(given)
    if (minimum, maximum) != (None, None) and number is not None:
        said = "; ".join(describe_out_of_range(number, minimum, maximum, declared.unit or "1", angles))
    else:
        said = _said(kind, given, bounds, declared, angles)
    return ErrorDetail(
        code=kind,
        message=f"{declared.words}: {said or str(error['msg'])}",
        quantity=next((part for part in reversed(path) if isinstance(part, str)), "body"),
        words=declared.words,
        path=list(path) or None,
        value=given if isinstance(given, str | int | float | bool) else None,
        minimum=minimum,
        maximum=maximum,
        unit=declared.unit,
    )


def _read_number(given: object) -> float | None:
    """Return the number that was given, as one or, in an address, as text."""
    if isinstance(given, int | float):
        return given
    try:
        return float(given) if isinstance(given, str) else None
    except ValueError:
        return None


def _said(kind: str, given: object, bounds: Mapping[str, Any], declared: _Declared, angles: AngleUnit) -> str:
    """Return what is wrong and what is wanted; empty where nothing better is known than what pydantic says."""
    if kind == "value_error":
        return str(bounds["error"])
    if kind in _SENTENCES:
        return _SENTENCES[kind]
    if kind in ("literal_error", "enum", "union_tag_invalid"):
        legal = declared.legal or str(bounds.get("expected_tags", "")).replace("'", "").split(", ")
        return f"{_shown(given)} is refused; choose one of {', '.join(legal)}"
    if kind.startswith(("float", "int", "finite")):
        whole = "whole " if kind.startswith("int") else ""
        unit = "" if declared.unit in (None, "1") else f" in {get_display_unit(declared.unit, angles).unit}"
        if given is None or isinstance(given, list | dict):
            return f"a {whole}number is needed{unit}"
        return f"{_shown(given)} is no {whole}number; give one{unit}"
    if kind.startswith("bool"):
        return f"{_shown(given)} is neither true nor false"
    if kind.endswith(("too_long", "too_short")):
        return _wrong_length(given, bounds)
    return ""


def _wrong_length(given: object, bounds: Mapping[str, Any]) -> str:
    length = len(given) if isinstance(given, str | list | dict) else int(bounds.get("actual_length", 0))
    of = " characters" if isinstance(given, str) else ""
    if "max_length" in bounds:
        return f"{length}{of} are too many; {bounds['max_length']} at most"
    if length == 0 and isinstance(given, str):
        return "it must not be empty"
    return f"{length}{of} are too few; {bounds['min_length']} at least"


def _declared(body: Any, path: Path, *, known: bool) -> _Declared:
    """Follow ``path`` into the type: "entry 2, K of G_q"."""
    parts: list[str] = []
    here, field = _bare(body), None
    for place, part in enumerate(path):
        if isinstance(part, int):
            name = next((name for name in reversed(path[:place]) if isinstance(name, str)), "")
            parts[-1:] = [f"{_ONE_OF.get(name, name)} {part + 1}"]
            here = _bare(next(iter(get_args(here)), None))
        elif (member := _tagged(here, part)) is not None:
            here = member
        else:
            field = here.model_fields.get(part) if _is_model(here) else None
            parts.append(_words(part, field) if known or place < len(path) - 1 else f"“{part[:SHOWN]}”")
            here = _bare(field.annotation) if field else None
    unit = UNITS.get(str(path[-1]) if path else "") if body is None else _unit(field)
    legal = tuple(str(value.value if isinstance(value, Enum) else value) for value in _values(here))
    return _Declared(", ".join(parts) or "what was sent", unit, legal)


def _words(name: str, field: FieldInfo | None) -> str:
    """Return what the schema says of it before any further explanation, else what it is called elsewhere."""
    described = (field.description if field else None) or QUANTITY_LABELS.get(name) or name.replace("_", " ")
    return described.removesuffix(f" [{_unit(field)}]").partition("; ")[0]


def _unit(field: FieldInfo | None) -> str | None:
    extra = field.json_schema_extra if field else None
    return str(extra["unit"]) if isinstance(extra, dict) and "unit" in extra else None


def _bare(kind: Any) -> Any:
    """Return a type without its notes, and without None beside it."""
    while get_origin(kind) is Annotated:
        kind = get_args(kind)[0]
    if get_origin(kind) in (Union, UnionType):
        rest = [member for member in get_args(kind) if member is not type(None)]
        if len(rest) == 1:
            return _bare(rest[0])
    return kind


def _tagged(kind: Any, tag: str) -> Any:
    """Return the member of a union that goes by this tag; None where ``kind`` is none."""
    if get_origin(kind) not in (Union, UnionType):
        return None
    members = (member for member in get_args(kind) if Tag(tag) in getattr(member, "__metadata__", ()))
    return next(map(_bare, members), None)


def _is_model(kind: Any) -> bool:
    return isinstance(kind, type) and issubclass(kind, BaseModel)


def _values(kind: Any) -> tuple[Any, ...]:
    if isinstance(kind, type) and issubclass(kind, Enum):
        return tuple(kind)
    return get_args(kind) if get_origin(kind) is Literal else ()


def _number(bounds: Mapping[str, Any], *keys: str) -> float | None:
    return next((bounds[key] for key in keys if isinstance(bounds.get(key), int | float)), None)


def _shown(value: object) -> str:
    return f"“{value[:SHOWN]}”" if isinstance(value, str) else str(value)[:SHOWN]


# Problems ------------------------------------------------------------------------------------------
#
# What is said of a refused number, setting or experiment, and what of a refused value can be shown.


_LARGEST = 2**53
"""Numbers beyond are shown as text: a browser could not read them exactly, nor infinity at all."""


def error_message(error: SinewError, angles: AngleUnit = AngleUnit.DEGREES) -> ErrorDetail:
    """Return what is said of an error to somebody who reads angles in this unit."""
    fields = error.fields
    if "value" in fields:
        fields["value"] = printable_refused_value(fields["value"])
    message = (
        error.format_message(angles) if isinstance(error, InvalidValueError) else format_angles(str(error), angles)
    )
    return ErrorDetail(message=message, **fields)


def printable_refused_value(value: object) -> object:
    """Return what JSON can show of a refused value; a token or a large body is not repeated."""
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, int | float):
        return value if abs(value) <= _LARGEST else str(value)[:SHOWN]
    return value[:SHOWN] if isinstance(value, str) else None


def replace_unsendable(value: object) -> object:
    """Return ``value`` with nothing in its texts that cannot be sent: half a character becomes a question mark."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    if isinstance(value, list):
        return [replace_unsendable(item) for item in value]
    if isinstance(value, dict):
        return {name: replace_unsendable(item) for name, item in value.items()}
    return printable_refused_value(value)
