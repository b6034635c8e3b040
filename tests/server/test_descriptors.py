"""STOP while clients hold all connections of a service with few descriptors."""

import resource
import socket
from collections.abc import Iterator
from urllib.parse import urlsplit

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection

from tests.api.conftest import PATIENCE_S, client_with, live, until
from tests.api.sockets import is_closed, many
from tests.e2e.service import Service, running_service

DESCRIPTORS = 256
LATE_S = 20.0
"""Timeout for STOP, which gets no response without a descriptor. The soak test of floods measures the 0.3 s limit."""

HEAD = b"GET /api/state HTTP/1.1\r\nHost: localhost\r\n"
SLOW_BODY = (
    b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 99\r\n\r\n{"
)


@pytest.fixture(scope="module")
def limited_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("door"), params="ideal", descriptors=DESCRIPTORS) as running:
        yield running


@pytest.fixture(scope="module")
def address(limited_service: Service) -> tuple[str, int]:
    parts = urlsplit(limited_service.url)
    return str(parts.hostname), int(parts.port or 0)


def press_stop(client: httpx.Client) -> None:
    client.post("/api/stop", timeout=LATE_S).raise_for_status()


@pytest.mark.parametrize("sent_bytes", [b"", HEAD, SLOW_BODY], ids=["nothing", "half a head", "half a body"])
def test_stop_is_executed_while_clients_hold_all_connections(
    limited_service: Service, address: tuple[str, int], sent_bytes: bytes
) -> None:
    with client_with(limited_service, "token") as operator:
        operator.post("/api/stop").raise_for_status()
        before = len(limited_service.log.read_bytes())
        with many(address, 2 * DESCRIPTORS, sent_bytes):
            for _ in range(5):
                press_stop(operator)
            for _ in range(5):
                with client_with(limited_service, "token") as new:
                    press_stop(new)
        assert len(limited_service.log.read_bytes()) - before < 20_000


def test_authenticated_connections_stay_open_under_a_flood(limited_service: Service, address: tuple[str, int]) -> None:
    with client_with(limited_service, "viewer-token") as viewer, live(viewer) as watching:
        with many(address, 2 * DESCRIPTORS) as connections:
            newest = connections[-1]
            assert viewer.get("/api/state").status_code == 200
            for connection in connections[
                :DESCRIPTORS
            ]:  # in order: the service accepts them from the kernel when it has time
                until(lambda connection=connection: is_closed(connection))  # type: ignore[misc] # the default binds the loop's name
            assert not is_closed(newest)
        for _ in range(100):
            watching.recv(timeout=PATIENCE_S)


def test_viewers_leave_connections_for_an_operator(limited_service: Service) -> None:
    with client_with(limited_service, "viewer-token") as viewer, client_with(limited_service, "token") as operator:
        watching: list[ClientConnection] = []
        with pytest.raises(InvalidStatus, match="503"):
            watching.extend(live(viewer) for _ in range(DESCRIPTORS))
        assert viewer.get("/api/state").status_code == 200
        with live(operator) as mine:
            mine.recv(timeout=PATIENCE_S)
        for one in watching:
            one.close()
        with live(viewer) as again:
            again.recv(timeout=PATIENCE_S)


def test_a_low_descriptor_limit_is_logged(limited_service: Service) -> None:
    assert f"only {DESCRIPTORS} files" in limited_service.log.read_text()


def test_the_descriptor_limit_is_raised_to_the_hard_limit(limited_service: Service) -> None:
    assert resource.prlimit(limited_service.pid, resource.RLIMIT_NOFILE) == (DESCRIPTORS, DESCRIPTORS)


def test_the_rejection_of_an_anonymous_websocket_has_the_security_headers(
    limited_service: Service, address: tuple[str, int]
) -> None:
    with socket.create_connection(address, 30) as anonymous:
        anonymous.sendall(
            b"GET /api/live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: upgrade\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        answer = anonymous.recv(4096)
    assert answer.startswith(b"HTTP/1.1 401 ")
    assert b"content-security-policy: default-src" in answer.lower()
