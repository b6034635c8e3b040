"""What the HTTP interface documents of a dataclass that it answers with as it is; knows no pydantic.

Pydantic reads the metadata of a dataclass's fields and its ``__pydantic_config__`` only where the interface serialises
it, so that a domain object need not be copied into a schema with the same fields.
"""

from dataclasses import fields
from typing import Any, Final

HIDDEN: Final = {"exclude": True}
"""Metadata of a field that is not sent."""


def described(meaning: str, unit: str | None = None) -> dict[str, Any]:
    """Return the metadata of a field: its meaning and, for a quantity, its SI unit."""
    if unit is None:
        return {"description": meaning}
    return {"description": f"{meaning} [{unit}]", "json_schema_extra": {"unit": unit}}


def _leave_out_hidden(schema: dict[str, Any], form: Any) -> None:
    """Document an answer without its hidden fields."""
    for item in fields(form):
        if item.metadata.get("exclude"):
            schema["properties"].pop(item.name, None)
    schema["required"] = [name for name in schema["required"] if name in schema["properties"]]
    schema["additionalProperties"] = False


def _require_all(schema: dict[str, Any], form: Any) -> None:
    """Document that an answer has each field, also one that has a default where it is constructed."""
    for part in schema["properties"].values():
        part.pop("default", None)
    schema["required"] = list(schema["properties"])
    _leave_out_hidden(schema, form)


ANSWER: Final[dict[str, Any]] = {"json_schema_extra": _leave_out_hidden}
"""``__pydantic_config__`` of a dataclass with hidden fields."""

COMPLETE_ANSWER: Final[dict[str, Any]] = {"json_schema_extra": _require_all}
"""``__pydantic_config__`` of a dataclass with defaults, all of whose fields are documented as required."""
