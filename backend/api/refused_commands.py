"""Refused commands go into the log: those of requests that need control, with whoever made them and what for."""

import json

from starlette.requests import HTTPConnection

from backend.api.service import service_of
from backend.schemas.base import UNITS
from backend.units import in_digits

_MOST_VALUES = 6
_LONGEST_VALUE = 40


def tell_refused(request: HTTPConnection, reason: str) -> None:
    """Keep a refusal where the request was a command of an operator; ``reason`` has angles in SI."""
    commanding = getattr(request.state, "commanding", None)
    if commanding is None:
        return
    person, body = commanding
    name = str(getattr(request.scope.get("route"), "name", "command")).replace("_", " ")
    values = values_in(body)
    service_of(request).refusals.note(f"{name} ({values})" if values else name, reason, person.name)


def values_in(body: bytes) -> str:
    """Return the values of a command in words, with units: "q_ref 0.5 rad, S_ref 9 N·m/rad"; of a long text nothing."""
    try:
        asked = json.loads(body) if body else None
    except (ValueError, RecursionError):
        return ""
    if not isinstance(asked, dict):
        return ""
    told = [_told(name, value) for name, value in asked.items()]
    return ", ".join([one for one in told if one][:_MOST_VALUES])


def _told(name: str, value: object) -> str:
    """Return a value with its name and unit, "" for one that is none: nested, nothing, or a text."""
    if not (name.isascii() and name.isidentifier() and len(name) <= _LONGEST_VALUE):
        return ""
    if isinstance(value, bool):
        return f"{name} {'yes' if value else 'no'}"
    if isinstance(value, int | float):
        unit = UNITS.get(name, "1")
        return f"{name} {in_digits(value)}" + ("" if unit == "1" else f" {unit}")
    if isinstance(value, str) and value.isprintable() and 0 < len(value) <= _LONGEST_VALUE:
        return f"{name} {value}"
    return ""
