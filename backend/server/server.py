"""The web server: its address, uvicorn's configuration, start and shutdown."""

import asyncio
import socket
from collections.abc import Callable

import uvicorn
from starlette.types import ASGIApp

from backend.server.connections import (
    RESERVE,
    ConnectionAcceptor,
    ConnectionBudget,
    ConnectionLimiter,
    ConnectionSlot,
    HttpProtocol,
    ReadScheduler,
    SocketProtocol,
)
from backend.server.descriptors import descriptor_limit, open_descriptors
from backend.server.listening import Ending, EndingServer
from backend.server.security import LONGEST_HEAD

# First request -------------------------------------------------------------------------------------
# First request to an application, before any client's.


async def prepare_routes(app: ASGIApp) -> None:
    """Send the application its first request.

    FastAPI prepares its routes only then, which takes a third of a second.
    """
    request = {
        "type": "http",
        "method": "GET",
        "path": "/api/docs",
        "query_string": b"",
        "headers": [(b"host", b"localhost")],
    }

    async def receive() -> dict[str, object]:
        return {"type": "http.request", "body": b""}

    async def send(_message: object) -> None:
        return None

    await app(request, receive, send)


# Server --------------------------------------------------------------------------------------------
# uvicorn's server with an own connection acceptor, and its configuration.


GRACE_S = 3


class Server(EndingServer):
    """Serves on the given sockets. ``ready`` is called once it responds."""

    def __init__(self, app: ASGIApp, ready: Callable[[], None], ending: Ending) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                http=HttpProtocol,
                ws=SocketProtocol,
                h11_max_incomplete_event_size=LONGEST_HEAD,
                log_config=None,  # the service's own handler writes, and limits, all records
                log_level="warning",
                access_log=False,  # it would write the token of the sign-in link
                server_header=False,
                ws_per_message_deflate=False,
                ws_max_size=1 << 20,
                timeout_graceful_shutdown=GRACE_S,
            ),
            ending,
        )
        self._ready = ready
        self._listeners: list[ConnectionAcceptor] = []

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the application, then accept connections."""
        await super().startup([])  # no socket for asyncio to accept on
        if not self.started:
            return
        limit = descriptor_limit()
        limiter = ConnectionLimiter(ConnectionBudget.within(limit, open_descriptors()))
        reading = ReadScheduler()

        def protocol(slot: ConnectionSlot) -> asyncio.Protocol:
            return HttpProtocol(limiter, slot, reading, self.config, self.server_state)

        highest = limit - RESERVE // 2
        self._listeners = [ConnectionAcceptor(listening, limiter, protocol, highest) for listening in sockets or []]
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop accepting, then let active connections finish."""
        for listener in self._listeners:
            listener.close()
        await super().shutdown(sockets)
