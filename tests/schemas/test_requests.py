"""Schemas of requests: bounds, refusals of wrong values, and defaults of forms."""

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
from backend.errors import OutOfRangeError
from backend.experiments.library import IDENTIFICATIONS
from backend.models.settings import describe_settings
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
from tests.api.test_operate import CODE_NAME, SYMBOL

# Nothing is taken in without a bound: every number, text, list and set of names of every request.

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


# What is said of a value that does not even have the right form: which one it is, in the operator's words.

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

REFUSED: list[tuple[str, Any, list[str | int] | None, str]] = [
    ("trial", {"duration_s": 0.2}, ["duration_s"], "duration of the trial: 0.2 s is less than 1 s; choose 1 s at"),
    (
        "trial",
        {"duration_s": "0.2"},
        ["duration_s"],
        "duration of the trial: 0.2 s is less than 1 s; choose 1 s at",
    ),
    ("build", {"name": "n", "identifications": ["9" * 5000]}, ["identifications", 0], "run 1: the number is too long"),
    (
        "preferences",
        {**DEFAULT_PREFERENCES.model_dump(mode="json"), "camera": "from above"},
        ["camera"],
        "name of the camera of the 3D view: it contains characters that are not allowed",
    ),
    ("trial", {"duration_s": "x"}, ["duration_s"], "duration of the trial: “x” is not a number; give one in s"),
    (
        "trial",
        {"duration_s": 5, "interpolate": "maybe"},
        ["interpolate"],
        "whether gains are interpolated between bank entries instead of switched: “may",
    ),
    ("push", {"F_push": 1, "duration_s": None}, ["duration_s"], "time after which the loop releases the joint: a numb"),
    ("references", {"q_ref": 1}, ["S_ref"], "joint stiffness reference: it is missing"),
    (
        "references",
        {"q_ref": "1 turn", "S_ref": 9},
        ["q_ref"],
        "joint position reference: “1 turn” is not a number; give o",
    ),
    ("bank", [1], None, "the request: an object with named values is required"),
    ("bank", {"entries": [ENTRY]}, ["name"], "name of the bank: it is missing"),
    (
        "bank",
        {"name": "n" * 61, "entries": [ENTRY]},
        ["name"],
        "name of the bank: 61 characters are too many; 60 at mo",
    ),
    ("bank", {"name": "", "entries": [ENTRY]}, ["name"], "name of the bank: it must not be empty"),
    ("bank", {"name": "n", "entries": []}, ["entries"], "entries: 0 are too few; 1 at least"),
    ("bank", {"name": "n", "entries": [ENTRY] * 21}, ["entries"], "entries: 21 are too many; 20 at most"),
    (
        "bank",
        {"name": "n", "entries": [ENTRY, ENTRY | {"K_q": "a"}]},
        ["entries", 1, "K_q"],
        "entry 2, K of G_q: “a” is",
    ),
    ("bank", {"name": "n", "entries": [{"S_nominal": 10}]}, ["entries", 0, "K_q"], "entry 1, K of G_q: it is missing"),
    ("bank", {"name": "n", "entries": [ENTRY | {"q": 2}]}, ["entries", 0, "q"], "entry 1, “q”: this name is unknown"),
    (
        "build",
        {"name": "n", "identifications": [0]},
        ["identifications", 0],
        "run 1: 0 is less than 1; choose 1 at least",
    ),
    ("note", {"note": "x" * 4001}, ["note"], "note: 4001 characters are too many; 4000 at most"),
    (
        "table",
        {"name": "a", "table": "x" * 400_001},
        ["table"],
        "table of the file: 400001 characters are too many; 400000 at most",
    ),
    ("identification", {"tensions_N": [10, "a"]}, ["tensions_N", 1], "tension 2: “a” is not a number; give one in N"),
    (
        "identification",
        {"tensions_N": []},
        ["tensions_N"],
        "tensions of several consecutive runs: 0 are too few; 1 at le",
    ),
    (
        "identification",
        {"estimator": "foo"},
        ["estimator"],
        "method that estimates the models from the recording: “foo” is not allowed; c",
    ),
    ("identification", {"bits": 7.5}, ["bits"], "length of the shift register: 7.5 is not a whole number; give"),
    ("identification", {"kind": "x"}, ["kind"], "kind: “x” is not allowed; choose one of actuator, motor, spring"),
]


def answers(path: str, body: Any) -> dict[str, Any]:
    """Return what the interface's own handlers answer to a body."""
    app = FastAPI()

    async def degrees(_connection: HTTPConnection) -> AngleUnit:
        return AngleUnit.DEGREES

    install_handlers(app, degrees)
    for name, schema in BODIES.items():

        async def take(body: Any) -> None:
            raise AssertionError(f"{body} was taken")

        take.__annotations__["body"] = schema
        app.post(f"/{name}")(take)

    async def ask() -> httpx.Response:
        async with httpx.AsyncClient(transport=httpx.ASGITransport(app), base_url="http://sinew") as client:
            return await client.post(f"/{path}", json=body)

    answer = asyncio.run(ask())
    assert answer.status_code == 422, answer.text
    return dict(answer.json()["error"])


@pytest.mark.parametrize(("path", "body", "place", "said"), REFUSED)
def test_it_is_told_in_words_and_at_its_place(path: str, body: Any, place: list[str | int] | None, said: str) -> None:
    """No name of the code, no word of a parser, no unit of another quantity of the same name."""
    refusal = answers(path, body)
    message = refusal["message"]
    assert message.startswith(said), message
    assert refusal.get("path", [])[-len(place or []) :] == (place or []), refusal
    assert not CODE_NAME.search(SYMBOL.sub("", message).replace("G_q", "").replace("G_S", "")), message
    assert not re.search(r"input|string|valid|extra|tag\b|<|field", message, re.IGNORECASE), message


def test_the_tension_that_is_refused_is_told_among_several() -> None:
    with pytest.raises(OutOfRangeError) as refused:
        build_plans(ActuatorRequest(tensions_N=[10.0, 4000.0]))
    assert refused.value.path == ("tensions_N", 1)
    assert refused.value.format_message(AngleUnit.DEGREES).startswith("tension 2: 4000 N is ")
    with pytest.raises(OutOfRangeError) as refused:
        build_plans(
            ActuatorRequest(tensions_N=[10.0], amplitude_rad=math.pi / 2).model_copy(update={"amplitude_rad": 9.0})
        )
    assert refused.value.path == ("amplitude_rad",), "what all of them share is not laid to one tension"


# The declarations that forms are made from: what is left at its default, and where a field ends, is the service's too.
#
# What the forms of the page show, send and leave behind is looked at in the browser: ``tests/e2e/test_forms.py``.


@pytest.mark.parametrize(
    ("name", "request_type"), [("actuator", ActuatorRequest), ("motor", MotorRequest), ("spring", SpringRequest)]
)
def test_the_boxes_of_an_identification_are_those_of_its_order(
    name: str, request_type: type[ActuatorRequest | MotorRequest | SpringRequest]
) -> None:
    """What the page leaves at its default is the default of the service too, and no box is missing on either side."""
    boxes = {box.name: box.default for box in describe_settings(IDENTIFICATIONS[name].plan)}
    assert request_type.model_validate({"kind": name}).model_dump(exclude={"kind", "tensions_N"}) == boxes
