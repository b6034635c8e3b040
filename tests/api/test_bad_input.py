"""Values that nobody sends by accident: each is refused in a sentence, none is a failure of the service."""

import json
from collections.abc import Iterator

import httpx
import pytest
from fastapi import APIRouter, WebSocket
from websockets.exceptions import ConnectionClosedError
from websockets.sync.connection import Connection

from backend.api.app import create_app
from tests.api.conftest import PATIENCE_S, live, problem
from tests.api.serving import served
from tests.e2e.service import Service

WRITTEN_FOR = {"HALF": "\\ud800", "DIGITS": "9" * 400, "BEYOND": str(2**63), "DEEP": "[" * 100_000, "LONG": "9" * 5000}
"""What the words in the cases below stand for."""

NEW = '"scheme": "auto", "window_s": 20, "statistics": false, "solid": null, "toured": true, "angles": "deg"'
NEW += ', "solid_unaided": null, "camera": "Side"'
ENTRY = '"S_nominal": 10, "K_q": 1, "T_q": 1, "K_S": 1, "T_S": 1'
SEGMENT = r"\"duration_s\": 1, \"S_ref\": 10"

BODIES = [
    ("POST", "/api/session", '{"token": "HALF"}'),
    ("POST", "/api/session", '{"token": "x", "name": "HALF"}'),
    ("POST", "/api/session", '{"HALF": "x"}'),
    ("PATCH", "/api/runs/1", '{"note": "HALF"}'),
    ("PATCH", "/api/runs/1", r'{"note": "\u0000"}'),
    ("PUT", "/api/preferences", f'{{"colours": {{}}, "hidden": ["HALF"], {NEW}}}'),
    ("PUT", "/api/preferences", f'{{"colours": {{"HALF": "#000000"}}, "hidden": [], {NEW}}}'),
    ("POST", "/api/experiments/dry-run", '{"name": "HALF"}'),
    ("POST", "/api/experiments/dry-run", '{"name": "sequence", "settings": {"HALF": 1}}'),
    ("POST", "/api/experiments/dry-run", '{"name": "sequence", "settings": {"segments": "HALF"}}'),
    ("POST", "/api/experiments/dry-run", '{"name": "tracking", "settings": {"step_rad": DIGITS}}'),
    ("POST", "/api/experiments/dry-run", '{"name": "tracking", "settings": {"step_rad": Infinity}}'),
    ("POST", "/api/experiments/queue", '{"name": "tracking", "settings": {"step_rad": "DIGITS"}}'),
    ("POST", "/api/banks", '{"name": "b", "identifications": [BEYOND]}'),
    ("POST", "/api/banks", '{"name": "b", "identifications": [DIGITS]}'),
    ("POST", "/api/banks/file", f'{{"name": "b", "version": BEYOND, "entries": [{{{ENTRY}}}]}}'),
    ("POST", "/api/banks/file", f'{{"name": "b", "entries": [{{{ENTRY}, "tension_N": DIGITS}}]}}'),
    ("POST", "/api/identifications", '{"tension_N": DIGITS}'),
    ("POST", "/api/identifications", '{"periods": DIGITS}'),
    ("PUT", "/api/references", '{"q_ref": DIGITS, "S_ref": 10}'),
    ("PUT", "/api/references", '{"q_ref": NaN, "S_ref": 10}'),
    ("PUT", "/api/tuning", '{"lam_q": DIGITS}'),
    ("PUT", "/api/tuning", '{"lam_q": 1e308}'),
    ("POST", "/api/push", '{"F_push": DIGITS}'),
    ("POST", "/api/push", '{"F_push": LONG}'),
    ("POST", "/api/push", "DEEP"),
    ("POST", "/api/push", '\ufeff{"F_push": 0}'),
    ("POST", "/api/runs/1/replay", '{"t": DIGITS}'),
]
for segment in (
    f'{SEGMENT}, \\"q_ref\\": DIGITS',
    f'{SEGMENT}, \\"q_ref\\": 1eDIGITS',
    f'{SEGMENT}, \\"q_ref\\": -Infinity',
    f'{SEGMENT}, \\"q_ref\\": 0, \\"shape\\": \\"\\HALF\\"',
):
    BODIES.append(
        ("POST", "/api/experiments/dry-run", f'{{"name": "sequence", "settings": {{"segments": "[{{{segment}}}]"}}}}')
    )
ADDRESSES = [
    "/api/banks/1/difference?run=99999999999999999999999",
    "/api/banks/1/difference?other=DIGITS",
    "/api/runs/DIGITS",
    "/api/runs/BEYOND",
    "/api/runs/1/samples?from=1e308&to=1e309",
    "/api/runs/1/samples?to=DIGITS",
    "/api/runs/1/samples?signals=%ED%A0%80",
    "/api/runs?search=%00",
    "/api/runs?search=%ED%A0%80",
    "/api/runs?offset=DIGITS",
    "/api/tuning/preview?lam_q=DIGITS&lam_S=1",
    "/%00",
    "/api/%ED%A0%80",
]


def written(text: str) -> str:
    """Put in what the words stand for."""
    for word, meant in WRITTEN_FOR.items():
        text = text.replace(word, meant)
    return text


def ask(client: httpx.Client, method: str, path: str, body: str) -> httpx.Response:
    return client.request(method, path, content=written(body).encode(), headers={"Content-Type": "application/json"})


@pytest.mark.parametrize(("method", "path", "body"), BODIES)
def test_a_body_is_refused_in_a_sentence(operator: httpx.Client, method: str, path: str, body: str) -> None:
    answer = ask(operator, method, path, body)
    assert 400 <= answer.status_code < 500, answer.text
    assert problem(answer)["message"]


@pytest.mark.parametrize("path", ADDRESSES)
def test_an_address_is_no_failure(operator: httpx.Client, path: str) -> None:
    answer = operator.get(written(path))
    assert answer.status_code < 500, answer.text
    if answer.status_code >= 400:
        assert answer.headers["content-security-policy"]


@pytest.mark.parametrize("origin", ["http://[", "http://]", "[", "http://[::1", "\u00b2", "http://a:b:c"])
def test_an_origin_that_is_none_is_foreign(operator: httpx.Client, origin: str) -> None:
    refused = operator.post("/api/reset", headers={b"Origin": origin.encode("latin-1")})
    assert refused.status_code == 403
    assert problem(refused)["code"] == "foreign_origin"


@pytest.mark.parametrize("said", ['{"id": DIGITS}', '{"id": 1, "control": "short"}', '{"id": "HALF"}', "DEEP", "\x00"])
def test_what_is_no_ping_ends_the_stream(operator: httpx.Client, said: str) -> None:
    with live(operator) as watching:
        watching.send(written(said))
        with pytest.raises(ConnectionClosedError) as closed:
            read_on(watching)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1008


def read_on(watching: Connection) -> None:
    for _ in range(500):
        watching.recv(timeout=PATIENCE_S)


def test_nothing_of_all_this_left_a_traceback(service: Service, operator: httpx.Client) -> None:
    for method, path, body in BODIES:
        ask(operator, method, path, body)
    for path in ADDRESSES:
        operator.get(written(path))
    assert "Traceback" not in service.log.read_text()


@pytest.fixture(scope="module")
def failing() -> Iterator[str]:
    """The application with two routes that fail."""
    routes = APIRouter()

    @routes.get("/fails")
    async def fails() -> None:
        raise RuntimeError("\ud800")

    @routes.websocket("/fails")
    async def socket_fails(websocket: WebSocket) -> None:
        raise RuntimeError("before it was accepted")

    with served(create_app(further_routes=[routes])) as address:
        yield f"http://localhost:{address[1]}"


def test_a_failure_carries_the_policy_too(failing: str) -> None:
    answer = httpx.get(f"{failing}/fails", timeout=PATIENCE_S)  # a first answer loads what it is made with
    assert answer.status_code == 500
    assert problem(answer)["code"] == "internal_error"
    assert answer.headers["content-security-policy"].startswith("default-src 'self'")
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_refusal_is_readable_though_the_value_is_not(operator: httpx.Client) -> None:
    answer = ask(operator, *BODIES[-1])
    assert json.loads(answer.text)["error"]["path"] == ["segments"]
