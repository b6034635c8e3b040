"""Foxglove's bridge by itself: its clients, and what it publishes."""

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

# The door by itself: clients that say nothing hold up nobody, and who comes late is looked at again.

Stream = tuple[asyncio.StreamReader, asyncio.StreamWriter]


async def vendor(client: ServerConnection) -> None:
    async for _ in client:
        pass


@asynccontextmanager
async def opened() -> AsyncIterator[tuple[Gateway, int]]:
    async with serve(vendor, HOST, 0, subprotocols=[VENDORS]) as server:
        door = Gateway(next(iter(server.sockets)).getsockname()[1], MessageSlots())
        async with door.open(0) as port:
            await door.accept_key("old")
            yield door, port


async def silent(port: int) -> Stream:
    """Shake hands, and say and hear nothing from then on."""
    reader, writer = await asyncio.open_connection(HOST, port)
    head = ("GET /?token=old HTTP/1.1", f"Host: {HOST}", "Upgrade: websocket", "Connection: Upgrade")
    key = base64.b64encode(os.urandom(16)).decode()
    rest = ("Sec-WebSocket-Version: 13", f"Sec-WebSocket-Protocol: {VENDORS}", f"Sec-WebSocket-Key: {key}", "", "")
    writer.write("\r\n".join((*head, *rest)).encode())
    await reader.readuntil(b"\r\n\r\n")
    return reader, writer


async def until_inside(door: Gateway, count: int) -> None:
    while len(door._clients) != count:
        await asyncio.sleep(0.01)


def test_clients_that_do_not_answer_hold_nobody_up() -> None:
    async def go() -> float:
        async with opened() as (door, port):
            kept = [await silent(port) for _ in range(4)]
            await until_inside(door, 4)
            begun = time.monotonic()
            await door.accept_key("new")
            lasted = time.monotonic() - begun
            for reader, writer in kept:
                await reader.read()  # to the end: they are cut off
                writer.close()
            return lasted

    assert asyncio.run(go()) < 3.0 * FAREWELL_S


def test_no_more_than_the_most_are_inside_however_they_come() -> None:
    async def go() -> int:
        async with opened() as (door, _):
            door._check_request = lambda *_: None  # type: ignore[method-assign]  # all are looked at before any is inside
            async with door.open(0) as port:
                kept = [await silent(port) for _ in range(MOST_CLIENTS + 2)]
                await until_inside(door, MOST_CLIENTS)
                last, _ = kept[-1]
                assert messages.too_many_clients(maximum=MOST_CLIENTS).encode() in await last.read()
                for _, writer in kept:
                    writer.close()
                return len(door._clients)

    assert asyncio.run(go()) == MOST_CLIENTS


def test_a_key_that_was_replaced_during_the_handshake_does_not_open() -> None:
    async def go() -> tuple[int | None, int]:
        async with opened() as (door, _):
            asked = door._check_request

            def replaced(connection: ServerConnection, request: object) -> object:
                answer = asked(connection, request)  # type: ignore[arg-type]  # as it came
                door._key = "new"
                return answer

            door._check_request = replaced  # type: ignore[assignment,method-assign]  # between look and entry
            async with (
                door.open(0) as other,
                connect(f"ws://{HOST}:{other}/?token=old", subprotocols=[VENDORS]) as client,
            ):
                await client.wait_closed()
                return client.close_code, len(door._clients)

    assert asyncio.run(go()) == (1008, 0)


# What goes to the vendor's server, and what a client is given for it.


def frame(content: bytes) -> bytes:
    return struct.pack("<BIQ", 1, 7, 123) + content


def test_a_ticket_is_turned_into_its_message_and_nothing_else_is() -> None:
    tickets = MessageSlots(count=3)
    given = [tickets.ticket_for(words) for words in (b"one", b"two", b"three", b"four")]
    assert [tickets.redeem(frame(ticket)) for ticket in given] == [None, *map(frame, (b"two", b"three", b"four"))]
    assert tickets.redeem(frame(struct.pack("<Q", 9))) is None  # none was ever given
    assert tickets.redeem(frame(b"{}")) is None
    assert tickets.redeem(b"\x02rest") == b"\x02rest"  # of another kind, as the time


def test_a_service_of_another_version_is_refused() -> None:
    publisher = Publisher("test", MessageSlots())
    try:
        told = build_layout()
        publisher.publish(told.model_dump_json())
        with refused(OtherVersionError, "service_of_another_version"):
            publisher.publish(told.model_copy(update={"fields": told.fields[1:]}).model_dump_json())
        with pytest.raises(OtherVersionError):
            publisher.publish(told.model_copy(update={"period_s": 0.002}).model_dump_json())
    finally:
        publisher.close()
