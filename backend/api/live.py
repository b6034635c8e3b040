"""The websocket /api/live: sends what the live stream has; who reads nothing or says nothing for long is dropped."""

import asyncio
import logging
from collections.abc import Callable, Iterable
from contextlib import suppress

from fastapi import WebSocket, WebSocketDisconnect
from pydantic import ValidationError

from backend.operating.live_stream import Client, LiveStream
from backend.schemas.state import Ping, Pong

PATIENCE_S = 20.0
SILENT_S = 75.0
"""A page, which pings every second, is gone when it has said nothing for so long: its laptop was closed, say.

One that is hidden for minutes is let speak by its browser once a minute only, and is there all the same.
"""

_log = logging.getLogger(__name__)


async def serve(stream: LiveStream, websocket: WebSocket, heard: Callable[[Ping], None] = lambda _ping: None) -> None:
    """Serve one accepted websocket until either side ends it; ``heard`` gets each ping."""
    with stream.attending() as (client, first):
        receiving = asyncio.create_task(_receive(websocket, client, heard))
        tasks = receiving, asyncio.create_task(_send(websocket, client, first))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            for ended in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(ended, Exception):
                    _log.error("a live stream to a page failed; the page connects again", exc_info=ended)
    if not receiving.cancelled() and receiving.exception() is None and receiving.result():
        await _send_away(websocket)


async def _send_away(websocket: WebSocket) -> None:
    """Close with the reason; when nothing else is sent any more, which would find the connection half closed."""
    with suppress(TimeoutError, RuntimeError, WebSocketDisconnect):
        async with asyncio.timeout(PATIENCE_S):
            await websocket.close(1008, "only pings are understood here, and they have to come")


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


async def _receive(websocket: WebSocket, client: Client, heard: Callable[[Ping], None]) -> bool:
    """Hear pings, and return whether the page is to be sent away; it may also have left by itself."""
    with suppress(RuntimeError, WebSocketDisconnect):
        patience_s = None  # who never pings is a script, of which the server itself sees whether it is there
        while (ping := await _ping(websocket, patience_s)) is not None:
            patience_s = SILENT_S
            heard(ping)
            client.offer_text(Pong(id=ping.id).model_dump_json())
        return True
    return False


async def _ping(websocket: WebSocket, patience_s: float | None) -> Ping | None:
    """Return the next ping; None for anything else, and for nothing in all that time."""
    try:
        async with asyncio.timeout(patience_s):
            return Ping.model_validate_json(await websocket.receive_text())
    except (ValidationError, KeyError, TimeoutError):
        return None
