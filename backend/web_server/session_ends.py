"""Ends websockets when the session that opened them ends: a page is recognised when it opens one, and only then."""

import asyncio
from contextlib import suppress

from starlette.requests import HTTPConnection
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from backend.errors import RefusalError
from backend.web_server.cookies import authentication_of, shown_by

LIVE = "/api/live"
OVER = 1008
"""The code of the close frame: policy violation, as the standard calls it."""


class SessionEnds:
    """ASGI middleware around all websockets, of the live stream and of the 3D views alike."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, and say goodbye for the other side when the session is over."""
        if scope["type"] != "websocket":
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        authentication = authentication_of(connection)
        person = None
        with suppress(RefusalError):
            person = authentication.recognise(shown_by(connection))
        if person is None:
            await self._app(scope, receive, send)
            return
        with authentication.people.attending(person, is_page=scope["path"].rstrip("/") == LIVE) as over:
            await self._app(scope, _until(over, receive, send), send)


def _until(over: asyncio.Event, receive: Receive, send: Send) -> Receive:
    async def receive_or_end() -> Message:
        message, ended = asyncio.ensure_future(receive()), asyncio.ensure_future(over.wait())
        try:
            await asyncio.wait((message, ended), return_when=asyncio.FIRST_COMPLETED)
        finally:
            ended.cancel()
            if not message.done():
                message.cancel()
        if message.done() and not message.cancelled():
            return message.result()
        with suppress(RuntimeError):
            await send({"type": "websocket.close", "code": OVER, "reason": "signed out"})
        return {"type": "websocket.disconnect", "code": OVER}

    return receive_or_end
