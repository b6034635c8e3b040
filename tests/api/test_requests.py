"""Bodies, methods and values of requests to the running service."""

import json
import socket
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from fastapi import APIRouter, WebSocket
from websockets.exceptions import ConnectionClosedError
from websockets.sync.connection import Connection

from backend.api.app import create_app
from backend.server.security import MOST_LISTED, MOST_NAMES
from backend.services.background_work import MAX_SHEETS_PER_USER
from tests.api.conftest import PATIENCE_S, live, problem, until
from tests.api.serving import served
from tests.e2e.service import Service

# Bodies that the service reads, and from whom: raw requests to the running service.

MB = 1 << 20
CLOSED = ["/api/references", "/api/experiments/dry-run", "/api/banks/file", "/api/push"]


def exchange(service: Service, head: str, body: bytes = b"") -> tuple[int, int]:
    """Send a request; return the status of the answer and the bytes of ``body`` sent before it."""
    parts = urlsplit(service.url)
    sent = 0
    with socket.create_connection((str(parts.hostname), int(parts.port or 0)), 20) as connection:
        connection.sendall(f"{head}Host: {parts.netloc}\r\nContent-Type: application/json\r\n\r\n".encode())
        try:
            while sent < len(body):
                sent += connection.send(body[sent : sent + 65536])
        except OSError:
            pass  # the service reads no more
        try:
            answer = connection.recv(4096)
        except ConnectionResetError:
            return 0, sent
    return int(answer.split()[1]) if answer else 0, sent


def memory_MB(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096 / MB


def until_all_is_loaded(service: Service, operator: httpx.Client) -> None:
    """Wait for the libraries that are loaded after the start: they take memory too."""
    until(lambda: "/scipy/stats/" in Path(f"/proc/{service.pid}/maps").read_text(encoding="utf-8"))
    operator.get("/api/tuning/preview", params={"lam_q": 0.5, "lam_S": 0.42}).raise_for_status()  # needs the last


@pytest.mark.parametrize(("path", "token"), [("/api/session", ""), ("/api/push", "right"), ("/api/push", "")])
def test_a_body_with_two_lengths_is_rejected_and_not_read(
    service: Service, operator: httpx.Client, path: str, token: str
) -> None:
    sign = f"Authorization: {operator.headers['Authorization']}\r\n" if token else ""
    head = f"POST {path} HTTP/1.1\r\nTransfer-Encoding: chunked\r\nContent-Length: 5\r\n{sign}"
    chunk = b"10000\r\n" + b"x" * 65536 + b"\r\n"
    until_all_is_loaded(service, operator)
    before = memory_MB(service.pid)
    status, _ = exchange(service, head, chunk * 1600)
    assert status in (400, 0)  # 0: the connection was closed during the body
    assert memory_MB(service.pid) - before < 50.0
    status, _ = exchange(service, head, b"5\r\n12345\r\n0\r\n\r\n")
    assert status == 400


@pytest.mark.parametrize("path", CLOSED)
def test_anonymous_requests_are_answered_before_the_body(service: Service, path: str) -> None:
    status, _ = exchange(service, f"POST {path} HTTP/1.1\r\nContent-Length: 200000\r\n")
    assert status == 401


def test_anonymous_requests_get_no_100_continue(service: Service) -> None:
    status, _ = exchange(service, "POST /api/push HTTP/1.1\r\nContent-Length: 9\r\nExpect: 100-continue\r\n")
    assert status == 401


@pytest.mark.parametrize("body", ["", "{", "[]", "1", '{"token": 1}', "\ufeff"])
def test_anonymous_requests_get_no_validation_details(service: Service, body: str) -> None:
    answer = httpx.put(
        f"{service.url}/api/references", content=body.encode(), headers={"Content-Type": "application/json"}
    )
    assert answer.status_code in (401, 422)
    assert answer.status_code == 401 or not body


@pytest.mark.parametrize("length", ["²", "-1", "1 2", "9" * 30, "0x10"])
def test_an_invalid_content_length_is_rejected(service: Service, length: str) -> None:
    status, _ = exchange(service, f"POST /api/session HTTP/1.1\r\nContent-Length: {length}\r\n")
    assert status in (400, 413)


def begun(service: Service, token: str, length: int) -> socket.socket:
    """Send the head of a request for a chart sheet without its body."""
    parts = urlsplit(service.url)
    connection = socket.create_connection((str(parts.hostname), int(parts.port or 0)), 20)
    head = f"POST /api/chart-sheet.pdf HTTP/1.1\r\nHost: {parts.netloc}\r\nContent-Type: application/json\r\n"
    connection.sendall(f"{head}Authorization: {token}\r\nContent-Length: {length}\r\n\r\n".encode())
    return connection


def test_a_request_above_the_sheet_limit_is_rejected_before_its_body(service: Service, viewer: httpx.Client) -> None:
    token = viewer.headers["Authorization"]
    waiting = [begun(service, token, 1_000_000) for _ in range(MAX_SHEETS_PER_USER)]
    until(lambda: viewer.post("/api/chart-sheet.pdf", json={"svg": "x"}).status_code == 429)
    with begun(service, token, 1_000_000) as one_more:
        answer = one_more.recv(4096).lower()
    assert answer.split()[1] == b"429"
    assert b"retry-after: 1" in answer
    for connection in waiting:
        connection.close()
    until(lambda: viewer.post("/api/chart-sheet.pdf", json={"svg": "x"}).status_code == 422)


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/api/preferences", {f"a{number}": 1 for number in range(MOST_NAMES + 1)}),
        ("/api/preferences", {"layouts": [{f"a{number}": 1 for number in range(40)}] * 40}),
        ("/api/preferences", {"hidden": [0] * (MOST_LISTED + 1)}),
    ],
    ids=["names", "names in lists", "lists"],
)
def test_a_body_with_too_many_parts_is_rejected(operator: httpx.Client, path: str, body: dict[str, object]) -> None:
    refused = operator.put(path, json=body)
    assert (refused.status_code, refused.json()["error"]["code"]) == (422, "too_many_parts")


def test_a_body_at_the_limit_of_parts_is_validated(operator: httpx.Client) -> None:
    refused = operator.put("/api/preferences", json={f"a{number}": 1 for number in range(MOST_NAMES)})
    assert (refused.status_code, refused.json()["error"]["code"]) == (422, "missing")


# HEAD for GET, refusals with the supported methods, and the end of a connection after a malformed request.

PATIENCE_S_METHODS = 20.0


@pytest.mark.parametrize("path", ["/", "/api/state", "/api/health", "/api/runs"])
def test_head_returns_the_headers_of_get_without_a_body(operator: httpx.Client, path: str) -> None:
    read, head = operator.get(path), operator.head(path)
    assert (read.status_code, head.status_code) == (200, 200)
    assert head.headers["content-type"] == read.headers["content-type"]
    assert head.content == b""


@pytest.mark.parametrize(
    ("method", "path", "allowed"),
    [
        ("GET", "/api/stop", {"POST"}),
        ("PATCH", "/api/state", {"GET", "HEAD"}),
        ("POST", "/api/runs/1", {"GET", "HEAD", "PATCH"}),
        ("DELETE", "/index.html", {"GET", "HEAD"}),
    ],
)
def test_an_unsupported_method_is_rejected_with_the_supported_methods(
    operator: httpx.Client, method: str, path: str, allowed: set[str]
) -> None:
    answer = operator.request(method, path)
    assert answer.status_code == 405
    assert set(answer.headers["allow"].split(", ")) == allowed


@pytest.mark.parametrize(
    "lengths",
    [
        b"Content-Length: 4\r\nTransfer-Encoding: chunked\r\n",
        b"Transfer-Encoding: chunked\r\n",
        b"Content-Length: 4, 5\r\n",
        b"Content-Length: +4\r\n",
    ],
)
def test_a_request_after_a_malformed_request_is_not_executed(
    service: Service, operator: httpx.Client, lengths: bytes
) -> None:
    """A STOP behind it has no effect, and its connection ends."""
    operator.post("/api/stop").raise_for_status()
    operator.post("/api/reset").raise_for_status()
    address = urlsplit(service.url)
    host = f"Host: {address.netloc}\r\n".encode()
    bearer = f"Authorization: {operator.headers['Authorization']}\r\n".encode()
    hidden = b"POST /api/stop HTTP/1.1\r\n" + host + bearer + b"Content-Length: 0\r\n\r\n"
    head = b"POST /api/session HTTP/1.1\r\n" + host + lengths + b"\r\n0\r\n\r\n"
    received = b""
    with socket.create_connection((str(address.hostname), address.port or 0), timeout=PATIENCE_S_METHODS) as line:
        line.sendall(head + hidden)
        while part := line.recv(65536):  # until the service has closed it
            received += part
    assert received.count(b"HTTP/1.1 4") == received.count(b"HTTP/1.1 ") == 1
    assert operator.get("/api/state").json()["mode"] == "off"


# Invalid values: each is rejected with a message, none causes an internal error.

WRITTEN_FOR = {"HALF": "\\ud800", "DIGITS": "9" * 400, "BEYOND": str(2**63), "DEEP": "[" * 100_000, "LONG": "9" * 5000}
"""Values of the placeholders in the cases below."""

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
    """Replace the placeholders by their values."""
    for word, meant in WRITTEN_FOR.items():
        text = text.replace(word, meant)
    return text


def ask(client: httpx.Client, method: str, path: str, body: str) -> httpx.Response:
    return client.request(method, path, content=written(body).encode(), headers={"Content-Type": "application/json"})


@pytest.mark.parametrize(("method", "path", "body"), BODIES)
def test_an_invalid_body_is_rejected_with_a_message(operator: httpx.Client, method: str, path: str, body: str) -> None:
    answer = ask(operator, method, path, body)
    assert 400 <= answer.status_code < 500, answer.text
    assert problem(answer)["message"]


@pytest.mark.parametrize("path", ADDRESSES)
def test_an_invalid_address_causes_no_internal_error(operator: httpx.Client, path: str) -> None:
    answer = operator.get(written(path))
    assert answer.status_code < 500, answer.text
    if answer.status_code >= 400:
        assert answer.headers["content-security-policy"]


@pytest.mark.parametrize("origin", ["http://[", "http://]", "[", "http://[::1", "\u00b2", "http://a:b:c"])
def test_an_invalid_origin_is_rejected_as_foreign(operator: httpx.Client, origin: str) -> None:
    refused = operator.post("/api/reset", headers={b"Origin": origin.encode("latin-1")})
    assert refused.status_code == 403
    assert problem(refused)["code"] == "foreign_origin"


@pytest.mark.parametrize(
    "message", ['{"id": DIGITS}', '{"id": 1, "control": "short"}', '{"id": "HALF"}', "DEEP", "\x00"]
)
def test_an_invalid_ping_closes_the_stream(operator: httpx.Client, message: str) -> None:
    with live(operator) as watching:
        watching.send(written(message))
        with pytest.raises(ConnectionClosedError) as closed:
            read_on(watching)
    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1008


def read_on(watching: Connection) -> None:
    for _ in range(500):
        watching.recv(timeout=PATIENCE_S)


def test_invalid_requests_leave_no_traceback_in_the_log(service: Service, operator: httpx.Client) -> None:
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


def test_an_internal_error_has_the_security_headers(failing: str) -> None:
    answer = httpx.get(f"{failing}/fails", timeout=PATIENCE_S)  # the first answer loads libraries
    assert answer.status_code == 500
    assert problem(answer)["code"] == "internal_error"
    assert answer.headers["content-security-policy"].startswith("default-src 'self'")
    assert answer.headers["x-content-type-options"] == "nosniff"


def test_a_refusal_of_an_undecodable_value_is_valid_json(operator: httpx.Client) -> None:
    answer = ask(operator, *BODIES[-1])
    assert json.loads(answer.text)["error"]["path"] == ["segments"]
