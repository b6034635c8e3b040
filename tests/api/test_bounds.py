"""Nothing is taken in without a bound: every number, text, list and set of names of every request."""

from collections.abc import Iterator
from typing import Any

from backend.api.export import build_openapi_schema
from backend.schemas.state import Ping

HTTP_METHODS = {"get", "put", "post", "patch", "delete"}
NEEDED = {
    "integer": [{"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"}],
    "number": [{"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"}],
    "string": [{"maxLength"}],
    "array": [{"maxItems"}],
}


def unbounded(schema: dict[str, Any], where: str, components: dict[str, Any], seen: set[str]) -> Iterator[str]:
    """Yield what in ``schema`` has no bound."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        if name not in seen:
            seen.add(name)
            yield from unbounded(components[name], name, components, seen)
        return
    for choice in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("allOf", ())):
        yield from unbounded(choice, where, components, seen)
    if "enum" in schema or "const" in schema:
        return
    for alternatives in NEEDED.get(str(schema.get("type")), ()):
        if not alternatives & set(schema):
            yield f"{where} lacks {' or '.join(sorted(alternatives))}"
    if "items" in schema:
        yield from unbounded(schema["items"], f"{where}[]", components, seen)
    for name, part in schema.get("properties", {}).items():
        yield from unbounded(part, f"{where}.{name}", components, seen)
    if schema.get("type") == "object":
        yield from _unbounded_names(schema, where, components, seen)


def _unbounded_names(schema: dict[str, Any], where: str, components: dict[str, Any], seen: set[str]) -> Iterator[str]:
    further = schema.get("additionalProperties", True)
    if further is False:
        return
    if "maxProperties" not in schema:
        yield f"{where} may have any number of names"
    if not {"propertyNames", "patternProperties"} & set(schema):
        yield f"{where} may have names of any length"
    for part in (further, *schema.get("patternProperties", {}).values()):
        if isinstance(part, dict):
            yield from unbounded(part, f"{where}{{}}", components, seen)


def test_every_value_of_every_request_is_bounded() -> None:
    described = build_openapi_schema()
    components, seen, found, looked_at = described["components"]["schemas"], set[str](), list[str](), 0
    for path, operations in described["paths"].items():
        for method in HTTP_METHODS & set(operations):
            operation = operations[method]
            for parameter in operation.get("parameters", ()):
                looked_at += 1
                found += unbounded(parameter["schema"], f"{method} {path} {parameter['name']}", components, seen)
            for content in operation.get("requestBody", {}).get("content", {}).values():
                looked_at += 1
                found += unbounded(content["schema"], f"{method} {path}", components, seen)
    assert looked_at > 30
    assert found == []


def test_every_value_of_a_ping_is_bounded() -> None:
    assert list(unbounded(Ping.model_json_schema(), "Ping", {}, set())) == []
