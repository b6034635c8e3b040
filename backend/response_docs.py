"""Documents, in the OpenAPI schema, dataclasses that routes return unchanged.

Pydantic reads the metadata of a dataclass's fields and its ``__pydantic_config__`` only where the interface serializes
it. Domain modules can thus describe their fields without importing pydantic or copying them into a schema.
"""

from dataclasses import fields
from typing import Any, Final

HIDDEN_FIELD: Final = {"exclude": True}
"""Metadata of a field that is not sent."""


def describe_field(meaning: str, unit: str | None = None) -> dict[str, Any]:
    """Return the metadata of a field: its meaning and, for a quantity, its SI unit."""
    if unit is None:
        return {"description": meaning}
    return {"description": f"{meaning} [{unit}]", "json_schema_extra": {"unit": unit}}


def _remove_hidden_fields(schema: dict[str, Any], form: Any) -> None:
    """Remove the hidden fields of a dataclass from its JSON schema."""
    for item in fields(form):
        if item.metadata.get("exclude"):
            schema["properties"].pop(item.name, None)
    schema["required"] = [name for name in schema["required"] if name in schema["properties"]]
    schema["additionalProperties"] = False


def _require_all_fields(schema: dict[str, Any], form: Any) -> None:
    """Mark all sent fields as required, also those with a default."""
    for part in schema["properties"].values():
        part.pop("default", None)
    schema["required"] = list(schema["properties"])
    _remove_hidden_fields(schema, form)


RESPONSE_CONFIG: Final[dict[str, Any]] = {"json_schema_extra": _remove_hidden_fields}
"""``__pydantic_config__`` of a dataclass with hidden fields."""

COMPLETE_RESPONSE_CONFIG: Final[dict[str, Any]] = {"json_schema_extra": _require_all_fields}
"""``__pydantic_config__`` of a dataclass with defaults: all fields are sent."""
