"""Base of all schemas: checked fields with units, and error responses."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, Tag
from pydantic.fields import FieldInfo

from backend.errors import QUANTITY_LABELS, InvalidValueError, Path, describe_out_of_range
from backend.units import AngleUnit, get_display_unit
from plant import SinewError

# Base ----------------------------------------------------------------------------------------------


HUGE = 1e12
"""Bound of every quantity in any unit; services check the real bounds."""

Finite = Annotated[float, Field(allow_inf_nan=False, ge=-HUGE, le=HUGE)]
"""A finite number that no computation can overflow."""

RowNumber = Annotated[int, Field(ge=1, le=2**53)]
"""Number of a stored record; JavaScript represents integers exactly up to 2^53."""

ANY_SIZE = {"ge": -HUGE, "le": HUGE}
"""Constraints of a quantity whose real bounds depend on the plant."""

UNITS: dict[str, str] = {}
"""Unit of each quantity by its name, for error messages; a name has the same unit in all schemas."""


class Schema(BaseModel):
    """Base class that rejects unknown fields and numbers that are not finite."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False, ser_json_inf_nan="null")

    @classmethod
    def __pydantic_init_subclass__(cls, **kwargs: Any) -> None:
        super().__pydantic_init_subclass__(**kwargs)
        for name, field in cls.model_fields.items():
            if isinstance(field.json_schema_extra, dict) and "unit" in field.json_schema_extra:
                UNITS[name] = str(field.json_schema_extra["unit"])


def quantity(unit: str, meaning: str, **constraints: Any) -> Any:
    """Return a pydantic field with an SI unit for JSON schema and error messages."""
    return Field(description=f"{meaning} [{unit}]", json_schema_extra={"unit": unit}, **constraints)


class ErrorDetail(Schema):
    """Why a request was rejected, and what would be accepted. Numbers are in SI."""

    code: str
    message: str = Field(description="complete message, with angles in the display unit of the reader")
    message_code: str | None = Field(default=None, description="code of the message, null for a message without one")
    quantity: str | None = Field(default=None, description="name of the rejected value in the interface")
    words: str | None = Field(default=None, description="label of the rejected value")
    path: list[str | int] | None = Field(
        default=None, description="path of the value in the request: names, and indices of lists from 0"
    )
    line: int | None = Field(default=None, description="line of a text in the request, from 1")
    value: Any = None
    minimum: float | None = None
    maximum: float | None = None
    unit: str | None = None
    legal: list[str] | None = None


class ErrorResponse(Schema):
    """Body of every response that is not a success."""

    error: ErrorDetail


# Malformed requests --------------------------------------------------------------------------------


MAX_SHOWN_CHARACTERS = 40
"""Number of characters of a rejected text in an error message."""

_ITEM_NAMES = {"tensions_N": "tension", "identifications": "run", "entries": "entry", "runs": "run"}
"""Name of one item of a list, by the name of the field."""

_MESSAGES = {
    "missing": "it is missing",
    "extra_forbidden": "this name is unknown: remove it",
    "string_type": "a text is required",
    "list_type": "a list is required",
    "dict_type": "an object with named values is required",
    "model_type": "an object with named values is required",
    "model_attributes_type": "an object with named values is required",
    "string_pattern_mismatch": "it contains characters that are not allowed",
    "int_parsing_size": "the number is too long",
}


@dataclass(frozen=True)
class _DeclaredValue:
    """Declaration of a value in the schemas: label, unit and choices."""

    label: str
    unit: str | None = None
    legal: tuple[str, ...] = ()


def build_request_error(error: Mapping[str, Any], body: Any, angles: AngleUnit) -> ErrorDetail:
    """Return the error response for the first error of pydantic.

    ``body`` is the type of the request body.
    """
    path: Path = tuple(part for part in error["loc"] if part not in ("body", "query", "path"))
    value, context = error.get("input"), error.get("ctx", {})
    kind = str(error["type"])
    if kind == "union_tag_invalid":
        path, value = (*path, "kind"), context["tag"]
    declared = _find_declared(body, path, known=kind != "extra_forbidden")
    minimum, maximum = (_find_bound(context, *keys) for keys in (("ge", "gt"), ("le", "lt")))
    number = _parse_number(value)
    if (minimum, maximum) != (None, None) and number is not None:
        problem = "; ".join(describe_out_of_range(number, minimum, maximum, declared.unit or "1", angles))
    else:
        problem = _describe_problem(kind, value, context, declared, angles)
    return ErrorDetail(
        code=kind,
        message=f"{declared.label}: {problem or str(error['msg'])}",
        quantity=next((part for part in reversed(path) if isinstance(part, str)), "body"),
        words=declared.label,
        path=list(path) or None,
        value=value if isinstance(value, str | int | float | bool) else None,
        minimum=minimum,
        maximum=maximum,
        unit=declared.unit,
    )


def _parse_number(value: object) -> float | None:
    """Return a number, which is a text in a URL; None for any other value."""
    if isinstance(value, int | float):
        return value
    try:
        return float(value) if isinstance(value, str) else None
    except ValueError:
        return None


def _describe_problem(
    kind: str, value: object, context: Mapping[str, Any], declared: _DeclaredValue, angles: AngleUnit
) -> str:
    """Return what is wrong and what is expected.

    An empty text stands for the message of pydantic.
    """
    if kind == "value_error":
        return str(context["error"])
    if kind in _MESSAGES:
        return _MESSAGES[kind]
    if kind in ("literal_error", "enum", "union_tag_invalid"):
        legal = declared.legal or str(context.get("expected_tags", "")).replace("'", "").split(", ")
        return f"{_format_value(value)} is not allowed; choose one of {', '.join(legal)}"
    if kind.startswith(("float", "int", "finite")):
        whole = "whole " if kind.startswith("int") else ""
        unit = "" if declared.unit in (None, "1") else f" in {get_display_unit(declared.unit, angles).unit}"
        if value is None or isinstance(value, list | dict):
            return f"a {whole}number is needed{unit}"
        return f"{_format_value(value)} is not a {whole}number; give one{unit}"
    if kind.startswith("bool"):
        return f"{_format_value(value)} is neither true nor false"
    if kind.endswith(("too_long", "too_short")):
        return _describe_length(value, context)
    return ""


def _describe_length(value: object, context: Mapping[str, Any]) -> str:
    length = len(value) if isinstance(value, str | list | dict) else int(context.get("actual_length", 0))
    items = " characters" if isinstance(value, str) else ""
    if "max_length" in context:
        return f"{length}{items} are too many; {context['max_length']} at most"
    if length == 0 and isinstance(value, str):
        return "it must not be empty"
    return f"{length}{items} are too few; {context['min_length']} at least"


def _find_declared(body: Any, path: Path, *, known: bool) -> _DeclaredValue:
    """Return the declaration of the value at ``path`` in a type.

    Its label is, for example, "entry 2, K of G_q". The last part of the path is quoted as it is unless it is ``known``.
    """
    labels: list[str] = []
    current, field = _unwrap_type(body), None
    for position, part in enumerate(path):
        if isinstance(part, int):
            name = next((name for name in reversed(path[:position]) if isinstance(name, str)), "")
            labels[-1:] = [f"{_ITEM_NAMES.get(name, name)} {part + 1}"]
            current = _unwrap_type(next(iter(get_args(current)), None))
        elif (member := _find_union_member(current, part)) is not None:
            current = member
        else:
            field = current.model_fields.get(part) if _is_model(current) else None
            is_shown_as_sent = not known and position == len(path) - 1
            labels.append(f"“{part[:MAX_SHOWN_CHARACTERS]}”" if is_shown_as_sent else _build_label(part, field))
            current = _unwrap_type(field.annotation) if field else None
    unit = UNITS.get(str(path[-1]) if path else "") if body is None else _find_unit(field)
    legal = tuple(str(value.value if isinstance(value, Enum) else value) for value in _list_choices(current))
    return _DeclaredValue(", ".join(labels) or "the request", unit, legal)


def _build_label(name: str, field: FieldInfo | None) -> str:
    """Return the description of a field up to a semicolon, else its known label."""
    described = (field.description if field else None) or QUANTITY_LABELS.get(name) or name.replace("_", " ")
    return described.removesuffix(f" [{_find_unit(field)}]").partition("; ")[0]


def _find_unit(field: FieldInfo | None) -> str | None:
    extra = field.json_schema_extra if field else None
    return str(extra["unit"]) if isinstance(extra, dict) and "unit" in extra else None


def _unwrap_type(annotation: Any) -> Any:
    """Return a type without ``Annotated`` and without an alternative None."""
    while get_origin(annotation) is Annotated:
        annotation = get_args(annotation)[0]
    if get_origin(annotation) in (Union, UnionType):
        members = [member for member in get_args(annotation) if member is not type(None)]
        if len(members) == 1:
            return _unwrap_type(members[0])
    return annotation


def _find_union_member(annotation: Any, tag: str) -> Any:
    """Return the member of a union with this tag, None without one."""
    if get_origin(annotation) not in (Union, UnionType):
        return None
    members = (member for member in get_args(annotation) if Tag(tag) in getattr(member, "__metadata__", ()))
    return next(map(_unwrap_type, members), None)


def _is_model(annotation: Any) -> bool:
    return isinstance(annotation, type) and issubclass(annotation, BaseModel)


def _list_choices(annotation: Any) -> tuple[Any, ...]:
    if isinstance(annotation, type) and issubclass(annotation, Enum):
        return tuple(annotation)
    return get_args(annotation) if get_origin(annotation) is Literal else ()


def _find_bound(context: Mapping[str, Any], *keys: str) -> float | None:
    return next((context[key] for key in keys if isinstance(context.get(key), int | float)), None)


def _format_value(value: object) -> str:
    return f"“{value[:MAX_SHOWN_CHARACTERS]}”" if isinstance(value, str) else str(value)[:MAX_SHOWN_CHARACTERS]


# Errors of services --------------------------------------------------------------------------------


_MAX_EXACT_INTEGER = 2**53
"""Larger numbers are sent as text: JavaScript could not represent them exactly, and JSON has no infinity."""


def build_error_detail(error: SinewError, angles: AngleUnit = AngleUnit.DEGREES) -> ErrorDetail:
    """Return the error response for an error.

    ``angles`` is the reader's unit of angles.
    """
    fields = error.fields
    if "value" in fields:
        fields["value"] = limit_rejected_value(fields["value"])
    message = error.format_message(angles) if isinstance(error, InvalidValueError) else str(error)
    return ErrorDetail(message=message, message_code=error.message.code or None, **fields)


def limit_rejected_value(value: object) -> object:
    """Return a rejected value as JSON can represent it, shortened.

    The result is None for a body that is not a plain value.
    """
    if isinstance(value, bool) or value is None:
        return value
    if isinstance(value, int | float):
        return value if abs(value) <= _MAX_EXACT_INTEGER else str(value)[:MAX_SHOWN_CHARACTERS]
    return value[:MAX_SHOWN_CHARACTERS] if isinstance(value, str) else None


def replace_invalid_text(value: object) -> object:
    """Return ``value`` with question marks for characters that UTF-8 cannot encode."""
    if isinstance(value, str):
        return value.encode("utf-8", "replace").decode()
    if isinstance(value, list):
        return [replace_invalid_text(item) for item in value]
    if isinstance(value, dict):
        return {name: replace_invalid_text(item) for name, item in value.items()}
    return limit_rejected_value(value)
