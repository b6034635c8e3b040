"""uvicorn's server with a reception in front, and what it is told."""

import asyncio
import socket
from collections.abc import Callable

import uvicorn
from starlette.types import ASGIApp

from backend.api.door import RESERVE, Door, Place, Room, descriptor_limit, open_descriptors
from backend.api.protocols import LONGEST_HEAD, HttpProtocol, SocketProtocol
from backend.api.reception import Reception
from backend.ending import Ending, EndingServer

GRACE_S = 3


class Server(EndingServer):
    """Serves on the sockets given. ``ready`` is called when it answers, not when it begins to start."""

    def __init__(self, app: ASGIApp, ready: Callable[[], None], ending: Ending) -> None:
        super().__init__(
            uvicorn.Config(
                app,
                http=HttpProtocol,
                ws=SocketProtocol,
                h11_max_incomplete_event_size=LONGEST_HEAD,
                log_config=None,  # the service's own handler writes, and limits, all there is to say
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
        self._receptions: list[Reception] = []

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the application, then open the door."""
        await super().startup([])  # no socket for asyncio to accept on
        if not self.started:
            return
        limit = descriptor_limit()
        door = Door(Room.within(limit, open_descriptors()))

        def protocol(place: Place) -> asyncio.Protocol:
            return HttpProtocol(door, place, self.config, self.server_state)

        highest = limit - RESERVE // 2
        self._receptions = [Reception(listening, door, protocol, highest) for listening in sockets or []]
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Shut the door, then let those inside finish."""
        for reception in self._receptions:
            reception.close()
        await super().shutdown(sockets)
