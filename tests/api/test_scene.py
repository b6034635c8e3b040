"""The 3D view of the running service: access, and the effect of messages of its clients."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager, suppress

import httpx
import msgspec
import pytest
import viser
from viser.infra import _messages
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.typing import Subprotocol

from tests.api.patient import connect
from tests.api.processes import descendants, listening
from tests.e2e.service import Service

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")
TIMEOUT_S = 20.0
SCENES = pytest.mark.parametrize("path", ["/scene", "/replay"])


@asynccontextmanager
async def open_scene(
    service: Service, client: httpx.Client, path: str = "/scene", protocol: Subprotocol = PROTOCOL
) -> AsyncIterator[ClientConnection]:
    headers = {"Authorization": client.headers["Authorization"], "Origin": service.url}
    address = service.url.replace("http", "ws") + path
    # The receive buffer has no bound: behind messages that a test does not read a pong would never arrive.
    async with connect(address, additional_headers=headers, subprotocols=[protocol], max_queue=None) as socket:
        yield socket


async def receive(socket: ClientConnection) -> bytes:
    message = await asyncio.wait_for(socket.recv(), TIMEOUT_S)
    assert isinstance(message, bytes)
    return message


async def closed_with(socket: ClientConnection) -> int | None:
    """Read until the other side closes; return its code."""
    try:
        while True:
            await receive(socket)
    except ConnectionClosed:
        return socket.close_code


def test_the_page_of_the_scene_has_its_own_policy(operator: httpx.Client) -> None:
    page = operator.get("/scene/")
    assert page.status_code == 200
    assert "wasm-unsafe-eval" in page.headers["content-security-policy"]
    assert "frame-ancestors 'self'" in page.headers["content-security-policy"]
    assert "/scene/?darkMode" in operator.get("/scene?darkMode").headers["location"]


@pytest.mark.parametrize("path", ["/scene", "/scene/", "/replay", "/replay/"])
def test_messages_of_the_scene_arrive_in_its_own_protocol(service: Service, operator: httpx.Client, path: str) -> None:
    async def session() -> None:
        async with open_scene(service, operator, path) as socket:
            assert socket.subprotocol == PROTOCOL
            assert len(await receive(socket)) > 10_000

    asyncio.run(session())


def test_the_scene_requires_a_session(service: Service) -> None:
    async def session() -> int:
        with pytest.raises(InvalidStatus) as error:
            async with connect(service.url.replace("http", "ws") + "/scene", subprotocols=[PROTOCOL]):
                pass
        return int(error.value.response.status_code)

    assert httpx.get(service.url + "/scene/").status_code == 401
    assert asyncio.run(session()) in (401, 403)


def test_the_service_listens_on_one_address_only(service: Service, operator: httpx.Client) -> None:
    port = httpx.URL(service.url).port
    assert listening(service.pid) == [f"listening tcp 0100007F:{port:04X}"]
    for child in descendants(service.pid):
        assert listening(child) == []


@SCENES
def test_messages_of_a_viewer_change_nothing_in_the_scene(service: Service, viewer: httpx.Client, path: str) -> None:
    """Above all not the publication of the scene: viser's own server would fork and call a remote server."""
    kinds = sorted(kind.__name__ for kind in _messages.Message.get_subclasses())
    upload = {"source_component_uuid": "a", "transfer_uuid": "b", "filename": "c", "mime_type": "d"}
    sent = [
        {"type": "ShareUrlRequest"},
        {"type": "FileTransferStartUpload", "part_count": 2, "size_bytes": 1 << 40, **upload},
        *({"type": kind} for kind in kinds),
    ]

    async def session() -> None:
        async with open_scene(service, viewer, path) as socket:
            await receive(socket)
            before = descendants(service.pid)
            await socket.send(msgspec.msgpack.encode(sent[0]))
            await asyncio.sleep(0.5)  # an event that must not happen cannot be awaited
            assert descendants(service.pid) == before
            for message in sent[1:]:
                await socket.send(msgspec.msgpack.encode(message))
            await (await socket.ping())
            assert descendants(service.pid) == before

    asyncio.run(session())


@SCENES
@pytest.mark.parametrize(
    ("sent", "count", "code"),
    [
        ("text", 1, 1008),
        ("\x00" * 100_000, 1, 1008),
        (b"\xff" * 5_000, 1, 1009),
        (b"\x00" * (1 << 20), 1, 1009),
        (b"", 2_000, 1008),
        (b"\xc1\xff junk", 2_000, 1008),
    ],
    ids=["text", "long text", "too large", "a megabyte", "nothing, often", "junk, often"],
)
def test_unknown_messages_close_the_connection(
    service: Service, viewer: httpx.Client, path: str, sent: str | bytes, count: int, code: int
) -> None:
    async def session() -> None:
        async with open_scene(service, viewer, path) as socket:
            try:
                for _ in range(count):
                    await socket.send(sent)
            except ConnectionClosed:
                assert count > 1
            assert await closed_with(socket) == code

    asyncio.run(session())


def test_junk_leaves_no_traceback_and_few_lines_in_the_log(service: Service, viewer: httpx.Client) -> None:
    async def one(junk: str | bytes) -> None:
        async with open_scene(service, viewer) as socket:
            await socket.send(junk)
            socket.transport.abort()

    async def session() -> None:
        for turn in range(60):
            await one(("junk", b"junk", b"\x93", b"\x00" * 9_000)[turn % 4])

    before = service.log.stat().st_size
    asyncio.run(session())
    viewer.get("/api/state").raise_for_status()
    written = service.log.read_bytes()[before:].decode()
    assert "Traceback" not in written
    assert len(written.splitlines()) <= 10


@pytest.mark.parametrize(("protocol", "answer"), [("viser-v0.2.7", 1002), ("junk", 403), ("viser-vx", 403)])
def test_other_page_versions_and_protocols_are_rejected(
    service: Service, viewer: httpx.Client, protocol: str, answer: int
) -> None:
    async def session() -> int | None:
        try:
            async with open_scene(service, viewer, protocol=Subprotocol(protocol)) as socket:
                return await closed_with(socket)
        except InvalidStatus as error:
            return int(error.response.status_code)

    assert asyncio.run(session()) == answer


def test_the_scene_limits_its_connections(service: Service, viewer: httpx.Client) -> None:
    async def session() -> None:
        async with AsyncExitStack() as stack:
            for _ in range(32):
                await receive(await stack.enter_async_context(open_scene(service, viewer, "/replay")))
            async with open_scene(service, viewer, "/replay") as late:
                assert await closed_with(late) == 1013
        while True:  # the service removes disconnected clients shortly afterwards
            async with open_scene(service, viewer, "/replay") as socket:
                with suppress(ConnectionClosed):
                    await receive(socket)
                    return

    asyncio.run(asyncio.wait_for(session(), TIMEOUT_S))
