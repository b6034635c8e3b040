"""The 3D view on the dashboard's own port: viser's page and its websocket, behind the same sign-in.

viser listens on a loopback port without sign-in or origin check: nothing but this proxy is meant to reach it, and the
scene holds no control that could command anything.
"""

import asyncio
from collections.abc import Callable
from contextlib import suppress

from fastapi import APIRouter, Request, WebSocket
from fastapi.responses import HTMLResponse, RedirectResponse
from starlette.requests import HTTPConnection
from starlette.websockets import WebSocketDisconnect
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed, InvalidHandshake
from websockets.typing import Subprotocol

from backend.scene.page import POLICY, page


def router(authorise: Callable[[HTTPConnection], object], port: int, path: str = "/scene") -> APIRouter:
    """Return the routes under ``path``. ``authorise`` raises for who is not signed in; ``port`` is viser's."""
    routes = APIRouter(include_in_schema=False)
    html = page()

    @routes.get(path)
    def redirect(request: Request) -> RedirectResponse:
        query = f"?{request.url.query}" if request.url.query else ""
        return RedirectResponse(f"{path}/{query}", status_code=307)

    @routes.get(f"{path}/")
    def client(request: Request) -> HTMLResponse:
        authorise(request)
        return HTMLResponse(html, headers={"Content-Security-Policy": POLICY, "Cache-Control": "private, max-age=3600"})

    @routes.websocket(path)
    @routes.websocket(f"{path}/")
    async def messages(websocket: WebSocket) -> None:
        authorise(websocket)
        await _forward(websocket, port)

    return routes


async def _forward(websocket: WebSocket, port: int) -> None:
    offered = [Subprotocol(name) for name in websocket.scope.get("subprotocols", [])]
    try:
        upstream = await connect(
            f"ws://127.0.0.1:{port}",
            subprotocols=offered,
            max_size=None,
            compression=None,
            ping_interval=None,
            proxy=None,
        )
    except (OSError, InvalidHandshake):
        await websocket.close(1013)
        return
    async with upstream:
        await websocket.accept(subprotocol=upstream.subprotocol)
        pumps = {asyncio.create_task(_up(websocket, upstream)), asyncio.create_task(_down(upstream, websocket))}
        try:
            await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for pump in pumps:
                pump.cancel()
            await asyncio.gather(*pumps, return_exceptions=True)
        with suppress(RuntimeError, WebSocketDisconnect):
            await websocket.close()


async def _up(websocket: WebSocket, upstream: ClientConnection) -> None:
    with suppress(WebSocketDisconnect, ConnectionClosed):
        while True:
            await upstream.send(await websocket.receive_bytes())


async def _down(upstream: ClientConnection, websocket: WebSocket) -> None:
    with suppress(WebSocketDisconnect, ConnectionClosed, RuntimeError):
        async for message in upstream:
            await websocket.send_bytes(message if isinstance(message, bytes) else message.encode())
