"""Base of all schemas: checked fields with units, and error responses."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from types import UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, Tag
from pydantic.fields import FieldInfo

from backend.errors import QUANTITY_LABELS, InvalidValueError, Path, describe_out_of_range
from backend.schemas import messages
from backend.units import AngleUnit, get_display_unit
from plant import Message, SinewError

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
        fault, remedy = describe_out_of_range(number, minimum, maximum, declared.unit or "1", angles)
        message = messages.value_out_of_range(label=declared.label, fault=fault, remedy=remedy)
    else:
        message = _build_message(error, value, declared, angles)
    return ErrorDetail(
        code=kind,
        message=message,
        message_code=message.code,
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


def _build_message(error: Mapping[str, Any], value: object, declared: _DeclaredValue, angles: AngleUnit) -> Message:
    """Return what is wrong with a value and what is expected; for other errors the message of pydantic."""
    kind, context, label = str(error["type"]), error.get("ctx", {}), declared.label
    if (message := _build_form_message(kind, label)) is not None:
        return message
    if kind in ("literal_error", "enum", "union_tag_invalid"):
        legal = declared.legal or str(context.get("expected_tags", "")).replace("'", "").split(", ")
        return messages.unknown_choice(label=label, value=_format_value(value), legal=", ".join(legal))
    if kind.startswith(("float", "int", "finite")):
        return _build_number_message(value, declared, angles, is_whole=kind.startswith("int"))
    if kind.startswith("bool"):
        return messages.not_a_boolean(label=label, value=_format_value(value))
    if kind.endswith(("too_long", "too_short")):
        return _build_length_message(value, context, label)
    reason = str(context["error"]) if kind == "value_error" else ""
    return messages.invalid_value(label=label, reason=reason or str(error["msg"]))


def _build_form_message(kind: str, label: str) -> Message | None:
    match kind:
        case "missing":
            return messages.value_missing(label=label)
        case "extra_forbidden":
            return messages.unknown_name(label=label)
        case "string_type":
            return messages.text_required(label=label)
        case "list_type":
            return messages.list_required(label=label)
        case "dict_type" | "model_type" | "model_attributes_type":
            return messages.object_required(label=label)
        case "string_pattern_mismatch":
            return messages.character_not_allowed(label=label)
        case "int_parsing_size":
            return messages.number_too_long(label=label)
        case _:
            return None


def _build_number_message(value: object, declared: _DeclaredValue, angles: AngleUnit, *, is_whole: bool) -> Message:
    label = declared.label
    unit = "" if declared.unit in (None, "1") else get_display_unit(declared.unit, angles).unit
    if value is None or isinstance(value, list | dict):
        if is_whole:
            return messages.whole_number_required(label=label, unit=unit)
        return messages.number_required(label=label, unit=unit)
    if is_whole:
        return messages.not_a_whole_number(label=label, value=_format_value(value), unit=unit)
    return messages.not_a_number(label=label, value=_format_value(value), unit=unit)


def _build_length_message(value: object, context: Mapping[str, Any], label: str) -> Message:
    length = len(value) if isinstance(value, str | list | dict) else int(context.get("actual_length", 0))
    if "max_length" in context:
        maximum = context["max_length"]
        if isinstance(value, str):
            return messages.too_many_characters(label=label, length=length, maximum=maximum)
        return messages.too_many_items(label=label, length=length, maximum=maximum)
    if length == 0 and isinstance(value, str):
        return messages.empty_text(label=label)
    minimum = context["min_length"]
    if isinstance(value, str):
        return messages.too_few_characters(label=label, length=length, minimum=minimum)
    return messages.too_few_items(label=label, length=length, minimum=minimum)


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
