"""STOP while others hold all the connections they can: the running service with few descriptors."""

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
"""Without a descriptor for it, STOP is never answered. The soak test of floods measures the 0.3 s that are promised."""

HEAD = b"GET /api/state HTTP/1.1\r\nHost: localhost\r\n"
SLOW_BODY = (
    b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 99\r\n\r\n{"
)


@pytest.fixture(scope="module")
def crowded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("door"), params="ideal", descriptors=DESCRIPTORS) as running:
        yield running


@pytest.fixture(scope="module")
def address(crowded: Service) -> tuple[str, int]:
    parts = urlsplit(crowded.url)
    return str(parts.hostname), int(parts.port or 0)


def press_stop(client: httpx.Client) -> None:
    client.post("/api/stop", timeout=LATE_S).raise_for_status()


@pytest.mark.parametrize("said", [b"", HEAD, SLOW_BODY], ids=["nothing", "half a head", "half a body"])
def test_stop_comes_through_however_many_hold_connections(
    crowded: Service, address: tuple[str, int], said: bytes
) -> None:
    with client_with(crowded, "token") as kept:
        kept.post("/api/stop").raise_for_status()
        before = len(crowded.log.read_bytes())
        with many(address, 2 * DESCRIPTORS, said):
            for _ in range(5):
                press_stop(kept)
            for _ in range(5):
                with client_with(crowded, "token") as new:
                    press_stop(new)
        assert len(crowded.log.read_bytes()) - before < 20_000


def test_who_is_signed_in_is_not_sent_away(crowded: Service, address: tuple[str, int]) -> None:
    with client_with(crowded, "viewer-token") as viewer, live(viewer) as watching:
        with many(address, 2 * DESCRIPTORS) as guests:
            newest = guests[-1]
            assert viewer.get("/api/state").status_code == 200
            for guest in guests[:DESCRIPTORS]:  # in turn: the service takes them from the kernel as it finds time
                until(lambda guest=guest: is_closed(guest))  # type: ignore[misc] # the default binds the loop's name
            assert not is_closed(newest)
        for _ in range(100):
            watching.recv(timeout=PATIENCE_S)


def test_viewers_leave_room_for_an_operator(crowded: Service) -> None:
    with client_with(crowded, "viewer-token") as viewer, client_with(crowded, "token") as operator:
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


def test_a_low_limit_of_descriptors_is_told(crowded: Service) -> None:
    assert f"only {DESCRIPTORS} files" in crowded.log.read_text()


def test_the_limit_is_raised_as_far_as_it_may_be(crowded: Service) -> None:
    assert resource.prlimit(crowded.pid, resource.RLIMIT_NOFILE) == (DESCRIPTORS, DESCRIPTORS)


def test_a_websocket_of_nobody_is_refused_with_every_header(crowded: Service, address: tuple[str, int]) -> None:
    with socket.create_connection(address, 30) as nobody:
        nobody.sendall(
            b"GET /api/live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: upgrade\r\n"
            b"Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        )
        answer = nobody.recv(4096)
    assert answer.startswith(b"HTTP/1.1 401 ")
    assert b"content-security-policy: default-src" in answer.lower()
