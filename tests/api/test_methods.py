"""HEAD where GET is, refusals that name the methods of an address, and ends of connections with malformed requests."""

import socket
from urllib.parse import urlsplit

import httpx
import pytest

from tests.e2e.service import Service

PATIENCE_S = 20.0


@pytest.mark.parametrize("path", ["/", "/api/state", "/api/health", "/api/runs"])
def test_head_has_the_head_of_get_and_nothing_more(operator: httpx.Client, path: str) -> None:
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
def test_a_method_that_an_address_does_not_take_is_refused_with_those_that_it_takes(
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
def test_nothing_that_follows_a_malformed_request_is_obeyed(
    service: Service, operator: httpx.Client, lengths: bytes
) -> None:
    """A STOP hidden behind it reaches nobody, and its connection ends."""
    operator.post("/api/stop").raise_for_status()
    operator.post("/api/reset").raise_for_status()
    address = urlsplit(service.url)
    host = f"Host: {address.netloc}\r\n".encode()
    bearer = f"Authorization: {operator.headers['Authorization']}\r\n".encode()
    hidden = b"POST /api/stop HTTP/1.1\r\n" + host + bearer + b"Content-Length: 0\r\n\r\n"
    head = b"POST /api/session HTTP/1.1\r\n" + host + lengths + b"\r\n0\r\n\r\n"
    said = b""
    with socket.create_connection((str(address.hostname), address.port or 0), timeout=PATIENCE_S) as line:
        line.sendall(head + hidden)
        while part := line.recv(65536):  # until the service has closed it
            said += part
    assert said.count(b"HTTP/1.1 4") == said.count(b"HTTP/1.1 ") == 1
    assert operator.get("/api/state").json()["mode"] == "off"
