"""Schemas of requests: bounds, messages for invalid values, and defaults of forms."""

import asyncio
import math
import re
from collections.abc import Iterator
from typing import Any

import httpx
import pytest
from fastapi import FastAPI
from starlette.requests import HTTPConnection

from backend.api.errors import install_handlers
from backend.api.export import build_openapi_schema
from backend.errors import OutOfRangeError, describe_out_of_range
from backend.experiments.library import IDENTIFICATIONS
from backend.models.settings import describe_settings
from backend.schemas import messages
from backend.schemas.identification import (
    ActuatorRequest,
    IdentificationRequest,
    MotorRequest,
    SpringRequest,
    SpringTableRequest,
)
from backend.schemas.preferences import DEFAULT_PREFERENCES, Preferences
from backend.schemas.run import NoteRequest
from backend.schemas.state import Ping, PushRequest, References
from backend.schemas.tuning import BankFile, BankRequest, TrialRequest
from backend.services.jobs import build_plans
from backend.units import AngleUnit
from plant import Message
from tests.api.test_operate import CODE_NAME, SYMBOL

# Every number, text, list and mapping of every request has bounds.

HTTP_METHODS = {"get", "put", "post", "patch", "delete"}
NEEDED = {
    "integer": [{"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"}],
    "number": [{"minimum", "exclusiveMinimum"}, {"maximum", "exclusiveMaximum"}],
    "string": [{"maxLength"}],
    "array": [{"maxItems"}],
}


def unbounded(schema: dict[str, Any], path: str, components: dict[str, Any], seen: set[str]) -> Iterator[str]:
    """Yield the parts of ``schema`` that have no bound."""
    if "$ref" in schema:
        name = schema["$ref"].rpartition("/")[2]
        if name not in seen:
            seen.add(name)
            yield from unbounded(components[name], name, components, seen)
        return
    for choice in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *schema.get("allOf", ())):
        yield from unbounded(choice, path, components, seen)
    if "enum" in schema or "const" in schema:
        return
    for alternatives in NEEDED.get(str(schema.get("type")), ()):
        if not alternatives & set(schema):
            yield f"{path} lacks {' or '.join(sorted(alternatives))}"
    if "items" in schema:
        yield from unbounded(schema["items"], f"{path}[]", components, seen)
    for name, part in schema.get("properties", {}).items():
        yield from unbounded(part, f"{path}.{name}", components, seen)
    if schema.get("type") == "object":
        yield from _unbounded_names(schema, path, components, seen)


def _unbounded_names(schema: dict[str, Any], path: str, components: dict[str, Any], seen: set[str]) -> Iterator[str]:
    additional = schema.get("additionalProperties", True)
    if additional is False:
        return
    if "maxProperties" not in schema:
        yield f"{path} may have any number of names"
    if not {"propertyNames", "patternProperties"} & set(schema):
        yield f"{path} may have names of any length"
    for part in (additional, *schema.get("patternProperties", {}).values()):
        if isinstance(part, dict):
            yield from unbounded(part, f"{path}{{}}", components, seen)


def test_every_value_of_every_request_is_bounded() -> None:
    described = build_openapi_schema()
    components, seen, found, checked = described["components"]["schemas"], set[str](), list[str](), 0
    for path, operations in described["paths"].items():
        for method in HTTP_METHODS & set(operations):
            operation = operations[method]
            for parameter in operation.get("parameters", ()):
                checked += 1
                found += unbounded(parameter["schema"], f"{method} {path} {parameter['name']}", components, seen)
            for content in operation.get("requestBody", {}).get("content", {}).values():
                checked += 1
                found += unbounded(content["schema"], f"{method} {path}", components, seen)
    assert checked > 30
    assert found == []


def test_every_value_of_a_ping_is_bounded() -> None:
    assert list(unbounded(Ping.model_json_schema(), "Ping", {}, set())) == []


# Messages for values of the wrong type name the value by its label.

ENTRY = {"S_nominal": 10, "K_q": 1, "T_q": 0.1, "K_S": 1, "T_S": 0.1}
BODIES = {
    "trial": TrialRequest,
    "push": PushRequest,
    "references": References,
    "bank": BankFile,
    "build": BankRequest,
    "note": NoteRequest,
    "table": SpringTableRequest,
    "identification": IdentificationRequest,
    "preferences": Preferences,
}


def too_small(label: str, value: float, minimum: float, unit: str = "1") -> Message:
    fault, remedy = describe_out_of_range(value, minimum, None, unit, AngleUnit.DEGREES)
    return messages.value_out_of_range(label=label, fault=fault, remedy=remedy)


TRIAL_TIME = "duration of the trial"
INTERPOLATE = str(TrialRequest.model_fields["interpolate"].description)
CAMERA = {**DEFAULT_PREFERENCES.model_dump(mode="json"), "camera": "from above"}

REFUSED: list[tuple[str, Any, list[str | int] | None, Message]] = [
    ("trial", {"duration_s": 0.2}, ["duration_s"], too_small(TRIAL_TIME, 0.2, 1.0, "s")),
    ("trial", {"duration_s": "0.2"}, ["duration_s"], too_small(TRIAL_TIME, 0.2, 1.0, "s")),
    (
        "build",
        {"name": "n", "identifications": ["9" * 5000]},
        ["identifications", 0],
        messages.number_too_long(label="run 1"),
    ),
    ("preferences", CAMERA, ["camera"], messages.character_not_allowed(label="name of the camera of the 3D view")),
    ("trial", {"duration_s": "x"}, ["duration_s"], messages.not_a_number(label=TRIAL_TIME, value="“x”", unit="s")),
    (
        "trial",
        {"duration_s": 5, "interpolate": "maybe"},
        ["interpolate"],
        messages.not_a_boolean(label=INTERPOLATE, value="“maybe”"),
    ),
    (
        "push",
        {"F_push": 1, "duration_s": None},
        ["duration_s"],
        messages.number_required(label="time after which the control loop ends the push", unit="s"),
    ),
    ("references", {"q_ref": 1}, ["S_ref"], messages.value_missing(label="joint stiffness reference")),
    (
        "references",
        {"q_ref": "1 turn", "S_ref": 9},
        ["q_ref"],
        messages.not_a_number(label="joint position reference", value="“1 turn”", unit="°"),
    ),
    ("bank", [1], None, messages.object_required(label="the request")),
    ("bank", {"entries": [ENTRY]}, ["name"], messages.value_missing(label="name of the bank")),
    (
        "bank",
        {"name": "n" * 61, "entries": [ENTRY]},
        ["name"],
        messages.too_many_characters(label="name of the bank", length=61, maximum=60),
    ),
    ("bank", {"name": "", "entries": [ENTRY]}, ["name"], messages.empty_text(label="name of the bank")),
    (
        "bank",
        {"name": "n", "entries": []},
        ["entries"],
        messages.too_few_items(label="entries", length=0, minimum=1),
    ),
    (
        "bank",
        {"name": "n", "entries": [ENTRY] * 21},
        ["entries"],
        messages.too_many_items(label="entries", length=21, maximum=20),
    ),
    (
        "bank",
        {"name": "n", "entries": [ENTRY, ENTRY | {"K_q": "a"}]},
        ["entries", 1, "K_q"],
        messages.not_a_number(label="entry 2, K of G_q", value="“a”", unit=""),
    ),
    (
        "bank",
        {"name": "n", "entries": [{"S_nominal": 10}]},
        ["entries", 0, "K_q"],
        messages.value_missing(label="entry 1, K of G_q"),
    ),
    (
        "bank",
        {"name": "n", "entries": [ENTRY | {"q": 2}]},
        ["entries", 0, "q"],
        messages.unknown_name(label="entry 1, “q”"),
    ),
    ("build", {"name": "n", "identifications": [0]}, ["identifications", 0], too_small("run 1", 0, 1)),
    (
        "note",
        {"note": "x" * 4001},
        ["note"],
        messages.too_many_characters(label="note", length=4001, maximum=4000),
    ),
    (
        "table",
        {"name": "a", "table": "x" * 400_001},
        ["table"],
        messages.too_many_characters(label="table of the file", length=400_001, maximum=400_000),
    ),
    (
        "identification",
        {"tensions_N": [10, "a"]},
        ["tensions_N", 1],
        messages.not_a_number(label="tension 2", value="“a”", unit="N"),
    ),
    (
        "identification",
        {"tensions_N": []},
        ["tensions_N"],
        messages.too_few_items(label="tensions of several consecutive runs", length=0, minimum=1),
    ),
    (
        "identification",
        {"estimator": "foo"},
        ["estimator"],
        messages.unknown_choice(
            label="method that estimates the models from the recording", value="“foo”", legal="default, arx"
        ),
    ),
    (
        "identification",
        {"bits": 7.5},
        ["bits"],
        messages.not_a_whole_number(label="length of the shift register", value="7.5", unit=""),
    ),
    (
        "identification",
        {"kind": "x"},
        ["kind"],
        messages.unknown_choice(label="kind", value="“x”", legal="actuator, motor, spring"),
    ),
]


def post(path: str, body: Any) -> dict[str, Any]:
    """Return the error that the handlers of the interface return for a body."""
    app = FastAPI()

    async def degrees(_connection: HTTPConnection) -> AngleUnit:
        return AngleUnit.DEGREES

    install_handlers(app, degrees)
    for name, schema in BODIES.items():

        async def accept(body: Any) -> None:
            raise AssertionError(f"{body} was taken")

        accept.__annotations__["body"] = schema
        app.post(f"/{name}")(accept)

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://sinew") as client:
            return await client.post(f"/{path}", json=body)

    answer = asyncio.run(ask())
    assert answer.status_code == 422, answer.text
    return dict(answer.json()["error"])


@pytest.mark.parametrize(("path", "body", "path_end", "expected"), REFUSED)
def test_invalid_values_are_reported_with_label_and_path(
    path: str, body: Any, path_end: list[str | int] | None, expected: Message
) -> None:
    """The message contains no code name, parser text or unit of another quantity."""
    error = post(path, body)
    message = error["message"]
    assert (error["message_code"], message) == (expected.code, expected)
    assert error["words"] == expected.values["label"]
    assert error.get("path", [])[-len(path_end or []) :] == (path_end or []), error
    assert not CODE_NAME.search(SYMBOL.sub("", message).replace("G_q", "").replace("G_S", "")), message
    assert not re.search(r"input|string|valid|extra|tag\b|<|field", message, re.IGNORECASE), message


def test_a_rejected_tension_is_identified_among_several() -> None:
    with pytest.raises(OutOfRangeError) as refused:
        build_plans(ActuatorRequest(tensions_N=[10.0, 4000.0]))
    assert refused.value.path == ("tensions_N", 1)
    assert refused.value.format_message(AngleUnit.DEGREES).startswith("tension 2: 4000 N is ")
    with pytest.raises(OutOfRangeError) as refused:
        build_plans(
            ActuatorRequest(tensions_N=[10.0], amplitude_rad=math.pi / 2).model_copy(update={"amplitude_rad": 9.0})
        )
    assert refused.value.path == ("amplitude_rad",), "what all of them share is not laid to one tension"


# The declarations of the forms have the defaults and bounds of the service.
#
# ``tests/e2e/test_forms.py`` tests the forms in the browser.


@pytest.mark.parametrize(
    ("name", "request_type"), [("actuator", ActuatorRequest), ("motor", MotorRequest), ("spring", SpringRequest)]
)
def test_form_fields_and_defaults_of_an_identification_match_its_request(
    name: str, request_type: type[ActuatorRequest | MotorRequest | SpringRequest]
) -> None:
    form_defaults = {setting.name: setting.default for setting in describe_settings(IDENTIFICATIONS[name].plan)}
    assert request_type.model_validate({"kind": name}).model_dump(exclude={"kind", "tensions_N"}) == form_defaults
