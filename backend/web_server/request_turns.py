"""One request after the other, so that STOP waits for the one under way and not for all of a crowd's.

The event loop goes through all that is ready before it looks at what has come. Two dozen busy pages at once make such a
round a tenth of a second long, and an answer takes several rounds.
"""

import asyncio
from collections import deque

from starlette.types import ASGIApp, Receive, Scope, Send

from backend.messages.session import Role
from backend.web_server.protocols import PLACE

PASSES_BY = "/api/stop"


class RequestTurns:
    """ASGI middleware that lets one request of operators and one of all others begin in each round.

    STOP begins at once. Among operators, as among the others, who came first begins first.
    """

    def __init__(self, app: ASGIApp) -> None:
        self._app = app
        self._operators: deque[asyncio.Future[None]] = deque()
        self._others: deque[asyncio.Future[None]] = deque()
        self._has_begun = False

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on in turn."""
        if scope["type"] in ("http", "websocket") and scope["path"] != PASSES_BY:
            await self._turn(self._operators if _is_operator(scope) else self._others)
        await self._app(scope, receive, send)

    async def _turn(self, line: deque[asyncio.Future[None]]) -> None:
        loop = asyncio.get_running_loop()
        if self._has_begun:
            turn = loop.create_future()
            line.append(turn)
            await turn
        else:
            self._has_begun = True
            loop.call_soon(self._next_round)

    def _next_round(self) -> None:
        self._has_begun = False
        for line in (self._operators, self._others):
            while line and not self._has_begun_with(line.popleft()):
                continue
        if self._has_begun:
            asyncio.get_running_loop().call_soon(self._next_round)

    def _has_begun_with(self, turn: asyncio.Future[None]) -> bool:
        if turn.done():  # cancelled: whoever waited is gone
            return False
        turn.set_result(None)
        self._has_begun = True
        return True


def _is_operator(scope: Scope) -> bool:
    place = scope.get("state", {}).get(PLACE)
    return place is not None and place.holder is not None and place.holder.role is Role.OPERATOR
