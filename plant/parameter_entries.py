"""Reading one section of a parameter file: each number with unit and source, refused by name when out of bounds."""

import math
from dataclasses import MISSING, Field, field, fields
from typing import Any

Value = float | tuple[float, ...] | tuple[tuple[float, ...], ...]


class ParameterError(ValueError):
    """A parameter file is missing, incomplete or out of bounds; the message names the entry and the remedy."""


def quantity(unit: str, minimum: float = -math.inf, maximum: float = math.inf) -> Any:
    """Field of a section: a number, or a list of numbers, with its unit and bounds."""
    return field(metadata={"unit": unit, "minimum": minimum, "maximum": maximum, "optional": False, "width": None})


def zero_if_left_out(unit: str, minimum: float, maximum: float) -> Any:
    """Field of a section: a number with its unit and bounds, or left out."""
    metadata = {"unit": unit, "minimum": minimum, "maximum": maximum, "optional": True, "width": None}
    return field(default=0.0, metadata=metadata)


def alternative(unit: str, width: int | None = None) -> Any:
    """Field of a section that may be left out: a list of numbers, or of rows of ``width`` numbers."""
    return field(metadata={"unit": unit, "minimum": -math.inf, "maximum": math.inf, "optional": True, "width": width})


def read_section(file: str, section: str, kind: type, table: Any) -> tuple[dict[str, Value], dict[str, str]]:
    """Return what the table of a section gives: values and sources by entry. Raises ParameterError."""
    known = {entry.name: entry for entry in fields(kind)}
    if not isinstance(table, dict):
        raise ParameterError(f"{file}: {section} = {table!r} must be a section: [{section}]")
    values: dict[str, Value] = {}
    sources: dict[str, str] = {}
    for name, given in table.items():
        if name not in known:
            raise ParameterError(f"{file}: unknown entry {section}.{name}; known are {', '.join(known)}")
        label, entry = f"{file}: {section}.{name}", known[name]
        if not isinstance(given, dict) or set(given) != {"value", "unit", "source"}:
            raise ParameterError(_wanted(label, entry))
        if given["unit"] != entry.metadata["unit"]:
            raise ParameterError(f"{label} is in {given['unit']!r}: give it in {entry.metadata['unit']!r}")
        values[name] = _value(label, given["value"], entry)
        sources[name] = str(given["source"])
    return values, sources


def completed(file: str, section: str, kind: type, values: dict[str, Value]) -> dict[str, Value]:
    """Return all entries of a section, those left out that may be as () or their default. Raises ParameterError."""
    for entry in fields(kind):
        if entry.name not in values and not entry.metadata["optional"]:
            raise ParameterError(_wanted(f"{file}: {section}.{entry.name}", entry))
    defaults: dict[str, Value] = {item.name: () if item.default is MISSING else item.default for item in fields(kind)}
    return defaults | values


def _wanted(label: str, entry: "Field[Any]") -> str:
    return f'{label} must read {{ value = ..., unit = "{entry.metadata["unit"]}", source = "..." }}'


def _value(label: str, value: Any, entry: "Field[Any]") -> Value:
    if entry.type is float:
        return _number(label, value, entry)
    width = entry.metadata["width"]
    if not isinstance(value, list) or not value:
        raise ParameterError(f"{label} = {value!r} must be a list of {'numbers' if width is None else 'rows'}")
    if width is None:
        return tuple(_number(label, item, entry) for item in value)
    for row in value:
        if not isinstance(row, list) or len(row) != width:
            raise ParameterError(f"{label}: row {row!r} must hold {width} numbers [{entry.metadata['unit']}]")
    return tuple(tuple(_number(label, item, entry) for item in row) for row in value)


def _number(label: str, value: Any, entry: "Field[Any]") -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ParameterError(f"{label} = {value!r} is not a finite number")
    low, high, unit = entry.metadata["minimum"], entry.metadata["maximum"], entry.metadata["unit"]
    if not low <= value <= high:
        raise ParameterError(f"{label} = {value:g} {unit} is outside {low:g} to {high:g} {unit}")
    return float(value)
