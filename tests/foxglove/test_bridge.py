"""The gateway to Foxglove without a service: clients and messages."""

import asyncio
import base64
import os
import struct
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest
from websockets.asyncio.client import connect
from websockets.asyncio.server import ServerConnection, serve

from backend.foxglove import messages
from backend.foxglove.bridge import (
    FAREWELL_S,
    HOST,
    MOST_CLIENTS,
    VENDORS,
    Gateway,
    MessageSlots,
    OtherVersionError,
    Publisher,
)
from backend.services.live_stream import build_layout
from tests.refusals import refused

# The gateway: unresponsive clients, the maximum number of clients, and key changes.

Stream = tuple[asyncio.StreamReader, asyncio.StreamWriter]


async def foxglove_server(client: ServerConnection) -> None:
    async for _ in client:
        pass


@asynccontextmanager
async def open_gateway() -> AsyncIterator[tuple[Gateway, int]]:
    async with serve(foxglove_server, HOST, 0, subprotocols=[VENDORS]) as server:
        gateway = Gateway(next(iter(server.sockets)).getsockname()[1], MessageSlots())
        async with gateway.open(0) as port:
            await gateway.accept_key("old")
            yield gateway, port


async def connect_silently(port: int) -> Stream:
    """Complete the handshake, then neither send nor read."""
    reader, writer = await asyncio.open_connection(HOST, port)
    head = ("GET /?token=old HTTP/1.1", f"Host: {HOST}", "Upgrade: websocket", "Connection: Upgrade")
    key = base64.b64encode(os.urandom(16)).decode()
    rest = ("Sec-WebSocket-Version: 13", f"Sec-WebSocket-Protocol: {VENDORS}", f"Sec-WebSocket-Key: {key}", "", "")
    writer.write("\r\n".join((*head, *rest)).encode())
    await reader.readuntil(b"\r\n\r\n")
    return reader, writer


async def wait_for_clients(gateway: Gateway, count: int) -> None:
    while len(gateway._clients) != count:
        await asyncio.sleep(0.01)


def test_unresponsive_clients_do_not_delay_a_token_change() -> None:
    async def session() -> float:
        async with open_gateway() as (gateway, port):
            connections = [await connect_silently(port) for _ in range(4)]
            await wait_for_clients(gateway, 4)
            start = time.monotonic()
            await gateway.accept_key("new")
            duration = time.monotonic() - start
            for reader, writer in connections:
                await reader.read()  # until the gateway closes the connection
                writer.close()
            return duration

    assert asyncio.run(session()) < 3.0 * FAREWELL_S


def test_concurrent_clients_cannot_exceed_the_maximum() -> None:
    async def session() -> int:
        async with open_gateway() as (gateway, _):
            gateway._check_request = lambda *_: None  # type: ignore[method-assign]  # all are checked before any is admitted
            async with gateway.open(0) as port:
                connections = [await connect_silently(port) for _ in range(MOST_CLIENTS + 2)]
                await wait_for_clients(gateway, MOST_CLIENTS)
                last, _ = connections[-1]
                assert messages.too_many_clients(maximum=MOST_CLIENTS).encode() in await last.read()
                for _, writer in connections:
                    writer.close()
                return len(gateway._clients)

    assert asyncio.run(session()) == MOST_CLIENTS


def test_a_key_that_changes_during_the_handshake_is_rejected() -> None:
    async def session() -> tuple[int | None, int]:
        async with open_gateway() as (gateway, _):
            check_request = gateway._check_request

            def replaced(connection: ServerConnection, request: object) -> object:
                answer = check_request(connection, request)  # type: ignore[arg-type]  # passed on unchanged
                gateway._key = "new"
                return answer

            gateway._check_request = replaced  # type: ignore[assignment,method-assign]  # between check and admission
            async with (
                gateway.open(0) as other,
                connect(f"ws://{HOST}:{other}/?token=old", subprotocols=[VENDORS]) as client,
            ):
                await client.wait_closed()
                return client.close_code, len(gateway._clients)

    assert asyncio.run(session()) == (1008, 0)


# Messages to the Foxglove server, and their tickets.


def frame(content: bytes) -> bytes:
    return struct.pack("<BIQ", 1, 7, 123) + content


def test_only_issued_tickets_are_redeemed() -> None:
    tickets = MessageSlots(count=3)
    issued = [tickets.ticket_for(words) for words in (b"one", b"two", b"three", b"four")]
    assert [tickets.redeem(frame(ticket)) for ticket in issued] == [None, *map(frame, (b"two", b"three", b"four"))]
    assert tickets.redeem(frame(struct.pack("<Q", 9))) is None  # never issued
    assert tickets.redeem(frame(b"{}")) is None
    assert tickets.redeem(b"\x02rest") == b"\x02rest"  # another type of message, such as the time


def test_a_service_of_another_version_is_rejected() -> None:
    publisher = Publisher("test", MessageSlots())
    try:
        layout = build_layout()
        publisher.publish(layout.model_dump_json())
        with refused(OtherVersionError, "service_of_another_version"):
            publisher.publish(layout.model_copy(update={"fields": layout.fields[1:]}).model_dump_json())
        with pytest.raises(OtherVersionError):
            publisher.publish(layout.model_copy(update={"period_s": 0.002}).model_dump_json())
    finally:
        publisher.close()
