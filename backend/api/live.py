"""The websocket /api/live: sends what the live stream has; who reads nothing for ``PATIENCE_S`` is dropped."""

import asyncio
import logging
from collections.abc import Callable, Iterable
from contextlib import suppress

from fastapi import WebSocket, WebSocketDisconnect
from pydantic import ValidationError

from backend.messages.live import Ping, Pong
from backend.operating.live_stream import Client, LiveStream

PATIENCE_S = 20.0

_log = logging.getLogger(__name__)


async def serve(stream: LiveStream, websocket: WebSocket, heard: Callable[[Ping], None] = lambda _ping: None) -> None:
    """Serve one accepted websocket until either side ends it; ``heard`` gets each ping."""
    with stream.attending() as (client, first):
        tasks = {
            asyncio.create_task(_receive(websocket, client, heard)),
            asyncio.create_task(_send(websocket, client, first)),
        }
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            for ended in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(ended, Exception):
                    _log.error("a live stream to a page failed; the page connects again", exc_info=ended)


async def _send(websocket: WebSocket, client: Client, first: Iterable[str | bytes]) -> None:
    try:
        for message in first:
            await _send_one(websocket, message)
        while True:
            await _send_one(websocket, await client.next())
    except (TimeoutError, RuntimeError, WebSocketDisconnect):
        return


async def _send_one(websocket: WebSocket, message: str | bytes) -> None:
    async with asyncio.timeout(PATIENCE_S):
        await (websocket.send_text(message) if isinstance(message, str) else websocket.send_bytes(message))


async def _receive(websocket: WebSocket, client: Client, heard: Callable[[Ping], None]) -> None:
    with suppress(RuntimeError, WebSocketDisconnect):  # the page has left, if need be before it is told why
        while (ping := await _ping(websocket)) is not None:
            heard(ping)
            client.offer_text(Pong(id=ping.id).model_dump_json())
        await websocket.close(1008, "only pings are understood here")


async def _ping(websocket: WebSocket) -> Ping | None:
    """Return the next ping; None for anything else."""
    try:
        return Ping.model_validate_json(await websocket.receive_text())
    except (ValidationError, KeyError):
        return None
