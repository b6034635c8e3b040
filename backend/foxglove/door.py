"""The port that Foxglove connects to: lets in who shows the key in the address, and hears subscriptions only.

``ws://127.0.0.1:8765/?token=KEY``: a program that shows data can be told an address, and nothing else.
"""

import asyncio
import json
import secrets
from collections.abc import AsyncIterator, Coroutine, Sequence
from contextlib import asynccontextmanager, suppress
from http import HTTPStatus
from typing import Any, cast
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.http11 import Request, Response
from websockets.typing import Subprotocol

from backend.foxglove.tickets import Tickets

VENDORS = Subprotocol("foxglove.sdk.v1")
SPOKEN = (VENDORS, Subprotocol("foxglove.websocket.v1"))
"""What clients call this protocol; the second is the older word, which the vendor's server does not take."""

HOST = "127.0.0.1"
HEARD = ("subscribe", "unsubscribe")
MOST_CLIENTS = 8
MOST_BYTES = 64 * 1024
POLICY_VIOLATION, FAILED = 1008, 1011
FAREWELL_S = 1.0


class Door:
    """Relays between who was let in and the vendor's server on ``port``; nobody is, before there is a key."""

    def __init__(self, port: int, tickets: Tickets) -> None:
        self._port, self._tickets = port, tickets
        self._key: str | None = None
        self._inside: set[ServerConnection] = set()

    @asynccontextmanager
    async def open(self, port: int) -> AsyncIterator[int]:
        """Listen on a port of this machine for the block, which gets its number; 0 is any free one. Raises OSError."""
        async with serve(
            self._relay,
            HOST,
            port,
            process_request=self._look_at,
            select_subprotocol=_agreed,
            compression=None,
            max_size=MOST_BYTES,
            server_header=None,
        ) as server:
            yield _port_of(server)

    async def let_in(self, key: str) -> None:
        """Let in who shows ``key``, and nobody with the one of before: who came in with that is sent away."""
        if key != self._key:
            self._key = key
            why = "the token was replaced: take the new address"
            await asyncio.gather(*(_send_away(client, POLICY_VIOLATION, why) for client in tuple(self._inside)))

    def _look_at(self, connection: ServerConnection, request: Request) -> Response | None:
        refused = self._refused(request)
        return connection.respond(refused[0], f"{refused[1]}\n") if refused else None

    def _refused(self, request: Request) -> tuple[HTTPStatus, str] | None:
        shown = parse_qs(urlsplit(request.path).query, errors="replace").get("token", [""])[-1]
        if self._key is None or not secrets.compare_digest(shown.encode(errors="replace"), self._key.encode()):
            return (
                HTTPStatus.UNAUTHORIZED,
                "the address needs ?token= with the viewer's token, as sinew foxglove prints it",
            )
        if len(self._inside) >= MOST_CLIENTS:
            return HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_CLIENTS} are connected already"
        return None

    async def _relay(self, client: ServerConnection) -> None:
        assert client.request is not None  # it was looked at
        if refused := self._refused(client.request):  # since: by another key, or others who were faster
            await _send_away(client, POLICY_VIOLATION, refused[1])
            return
        self._inside.add(client)
        try:
            async with connect(
                f"ws://{HOST}:{self._port}", subprotocols=[VENDORS], compression=None, max_size=None, proxy=None
            ) as server:
                await _first_of(self._show(server, client), _hear(client, server))
        except (OSError, InvalidHandshake):
            await _send_away(client, FAILED, "the vendor's server has ended: start sinew foxglove again")
        finally:
            self._inside.discard(client)

    async def _show(self, server: ClientConnection, client: ServerConnection) -> None:
        async for said in server:
            if isinstance(said, str):
                await client.send(said)
            elif (frame := self._tickets.redeemed(said)) is not None:
                await client.send(frame)


async def _hear(client: ServerConnection, server: ClientConnection) -> None:
    """Pass on what is asked to be shown; anything else is for servers that can be commanded."""
    async for said in client:
        try:
            asked = json.loads(said) if isinstance(said, str) else {}
        except (ValueError, RecursionError):
            await _send_away(client, POLICY_VIOLATION, "this is not JSON")
            return
        if isinstance(asked, dict) and asked.get("op") in HEARD:
            await server.send(said)


async def _send_away(client: ServerConnection, code: int, why: str) -> None:
    """Close a connection, also to one who does not answer, or does not even read."""
    try:
        async with asyncio.timeout(FAREWELL_S):
            await client.close(code, why)
    except TimeoutError:
        client.transport.abort()


async def _first_of(*works: Coroutine[Any, Any, None]) -> None:
    """Run until the first has ended; then end the others."""
    tasks = [asyncio.create_task(work) for work in works]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            with suppress(ConnectionClosed):
                task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _agreed(_connection: ServerConnection, offered: Sequence[Subprotocol]) -> Subprotocol | None:
    """Return the word for the protocol that a client knows; it ends the connection itself where there is none."""
    return next((word for word in SPOKEN if word in offered), None)


def _port_of(server: Server) -> int:
    return cast(int, next(iter(server.sockets)).getsockname()[1])
