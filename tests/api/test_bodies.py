"""What of a body is taken, and from whom: raw requests to the running service."""

import socket
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from backend.server.security import MOST_LISTED, MOST_NAMES
from backend.services.background_work import MAX_SHEETS_PER_USER
from tests.api.conftest import until
from tests.e2e.service import Service

MB = 1 << 20
CLOSED = ["/api/references", "/api/experiments/dry-run", "/api/banks/file", "/api/push"]


def exchange(service: Service, head: str, body: bytes = b"") -> tuple[int, int]:
    """Send a request; returns the status of the answer and how many bytes of ``body`` could be sent before it."""
    parts = urlsplit(service.url)
    sent = 0
    with socket.create_connection((str(parts.hostname), int(parts.port or 0)), 20) as connection:
        connection.sendall(f"{head}Host: {parts.netloc}\r\nContent-Type: application/json\r\n\r\n".encode())
        try:
            while sent < len(body):
                sent += connection.send(body[sent : sent + 65536])
        except OSError:
            pass  # the service takes no more
        try:
            answer = connection.recv(4096)
        except ConnectionResetError:
            return 0, sent
    return int(answer.split()[1]) if answer else 0, sent


def memory_MB(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * 4096 / MB


def until_all_is_loaded(service: Service, operator: httpx.Client) -> None:
    """Wait for the libraries that a start loads behind the first curve: they take memory too."""
    until(lambda: "/scipy/stats/" in Path(f"/proc/{service.pid}/maps").read_text(encoding="utf-8"))
    operator.get("/api/tuning/preview", params={"lam_q": 0.5, "lam_S": 0.42}).raise_for_status()  # needs the last


@pytest.mark.parametrize(("path", "token"), [("/api/session", ""), ("/api/push", "right"), ("/api/push", "")])
def test_a_body_of_two_lengths_is_refused_and_not_taken(
    service: Service, operator: httpx.Client, path: str, token: str
) -> None:
    sign = f"Authorization: {operator.headers['Authorization']}\r\n" if token else ""
    head = f"POST {path} HTTP/1.1\r\nTransfer-Encoding: chunked\r\nContent-Length: 5\r\n{sign}"
    chunk = b"10000\r\n" + b"x" * 65536 + b"\r\n"
    until_all_is_loaded(service, operator)
    before = memory_MB(service.pid)
    status, _ = exchange(service, head, chunk * 1600)
    assert status in (400, 0)  # 0: the connection was closed while the body still came
    assert memory_MB(service.pid) - before < 50.0
    status, _ = exchange(service, head, b"5\r\n12345\r\n0\r\n\r\n")
    assert status == 400


@pytest.mark.parametrize("path", CLOSED)
def test_who_is_not_signed_in_is_answered_before_the_body_comes(service: Service, path: str) -> None:
    status, _ = exchange(service, f"POST {path} HTTP/1.1\r\nContent-Length: 200000\r\n")
    assert status == 401


def test_nor_does_the_service_ask_for_such_a_body(service: Service) -> None:
    status, _ = exchange(service, "POST /api/push HTTP/1.1\r\nContent-Length: 9\r\nExpect: 100-continue\r\n")
    assert status == 401


@pytest.mark.parametrize("body", ["", "{", "[]", "1", '{"token": 1}', "\ufeff"])
def test_who_is_not_signed_in_learns_nothing_of_what_a_body_needs(service: Service, body: str) -> None:
    answer = httpx.put(
        f"{service.url}/api/references", content=body.encode(), headers={"Content-Type": "application/json"}
    )
    assert answer.status_code in (401, 422)
    assert answer.status_code == 401 or not body


@pytest.mark.parametrize("length", ["²", "-1", "1 2", "9" * 30, "0x10"])
def test_a_length_that_is_none_is_refused(service: Service, length: str) -> None:
    status, _ = exchange(service, f"POST /api/session HTTP/1.1\r\nContent-Length: {length}\r\n")
    assert status in (400, 413)


def begun(service: Service, token: str, length: int) -> socket.socket:
    """Send the head of a sheet of charts, and nothing of its body."""
    parts = urlsplit(service.url)
    connection = socket.create_connection((str(parts.hostname), int(parts.port or 0)), 20)
    head = f"POST /api/chart-sheet.pdf HTTP/1.1\r\nHost: {parts.netloc}\r\nContent-Type: application/json\r\n"
    connection.sendall(f"{head}Authorization: {token}\r\nContent-Length: {length}\r\n\r\n".encode())
    return connection


def test_where_no_place_is_free_a_body_is_not_waited_for(service: Service, viewer: httpx.Client) -> None:
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
def test_a_body_of_more_parts_than_any_request_has_is_refused(
    operator: httpx.Client, path: str, body: dict[str, object]
) -> None:
    refused = operator.put(path, json=body)
    assert (refused.status_code, refused.json()["error"]["code"]) == (422, "too_many_parts")


def test_a_body_of_the_most_parts_is_told_what_is_wrong_with_it(operator: httpx.Client) -> None:
    refused = operator.put("/api/preferences", json={f"a{number}": 1 for number in range(MOST_NAMES)})
    assert (refused.status_code, refused.json()["error"]["code"]) == (422, "missing")
