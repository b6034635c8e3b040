"""The web server: its address, uvicorn's configuration, its first request, its end."""

import asyncio
import ipaddress
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

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
    descriptor_limit,
    open_descriptors,
)
from backend.server.security import LONGEST_HEAD

# Ending --------------------------------------------------------------------------------------------
#
# How the service is told to end, and by what it was.


KILLED_BY = 128
"""Exit status of what a signal ended, less the number of the signal."""


class Ending:
    """Why the service ends, for those parts that put it on record."""

    cause = "service ended"


class EndingServer(uvicorn.Server):
    """A web server that ends in order by any signal that means so, and leaves in ``ending`` which one it was."""

    def __init__(self, config: uvicorn.Config, ending: Ending) -> None:
        super().__init__(config)
        self._ending = ending

    @contextmanager
    def capture_signals(self) -> Iterator[None]:
        """End in order on SIGHUP too: a terminal that is closed, or a connection that is cut, sends it.

        Whoever started the service with nohup has it ignored, and that stays. Uvicorn raises the signal once more at
        the end: by default that kills, and what is released at the end of an interpreter would be told as leaked.
        """
        _leave_in_order_by(signal.SIGTERM, signal.SIGHUP)
        with super().capture_signals():
            before = signal.getsignal(signal.SIGHUP)
            if before is signal.SIG_IGN or threading.current_thread() is not threading.main_thread():
                yield
                return
            signal.signal(signal.SIGHUP, self.handle_exit)
            try:
                yield
            finally:
                signal.signal(signal.SIGHUP, before)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Begin to end."""
        if not self.should_exit:
            self._ending.cause = f"service ended by {signal.Signals(sig).name}"
        super().handle_exit(sig, frame)


def _leave_in_order_by(*numbers: signal.Signals) -> None:
    """Let signals that would kill this process end its interpreter, with the status that a shell gives for them."""
    if threading.current_thread() is not threading.main_thread():
        return
    for number in numbers:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _leave)


def _leave(number: int, _frame: FrameType | None) -> None:
    raise SystemExit(KILLED_BY + number)


def address_on(host: str, port: int) -> str:
    """Return where a browser of this machine reaches a service that listens on ``host``."""
    reached = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(host, host)
    return f"http://[{reached}]:{port}" if ":" in reached else f"http://{reached}:{port}"


# First request -------------------------------------------------------------------------------------
#
# The request that an application gets before anybody asks.


async def put_routes_together(app: ASGIApp) -> None:
    """Send the application its first request: FastAPI prepares its routes only then, for a third of a second."""
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


# Listening -----------------------------------------------------------------------------------------
#
# The address that the service listens on.


class CannotListenError(Exception):
    """The address cannot be listened on."""


@contextmanager
def listening_on(host: str, port: int) -> Iterator[socket.socket]:
    """Hold the socket that is listened on. Raises CannotListenError."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        listening = socket.create_server((host, port), family=family, dualstack_ipv6=_serves_both(host))
    except OSError as error:
        reason = error.strerror or error
        raise CannotListenError(
            f"cannot listen on {host} port {port}: {reason}; choose another --host or --port"
        ) from None
    with listening:
        yield listening


def served_by(host: str) -> str:
    """Return which addresses a service on ``host`` serves, where that is not plain from it; "" elsewhere."""
    if not _is_any(host):
        return ""
    if ":" not in host:
        return "It listens on every IPv4 address of this machine, not over IPv6; --host :: serves both."
    if _serves_both(host):
        return "It listens on every address of this machine, over IPv6 and IPv4."
    return "It listens on every IPv6 address of this machine, not over IPv4: this system cannot serve both."


def _serves_both(host: str) -> bool:
    return ":" in host and _is_any(host) and socket.has_dualstack_ipv6()


def _is_any(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_unspecified
    except ValueError:
        return False


# Server --------------------------------------------------------------------------------------------
#
# uvicorn's server with a listener of our own in front, and what it is told.


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
        self._listeners: list[ConnectionAcceptor] = []

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start the application, then let connections in."""
        await super().startup([])  # no socket for asyncio to accept on
        if not self.started:
            return
        limit = descriptor_limit()
        places = ConnectionLimiter(ConnectionBudget.within(limit, open_descriptors()))
        reading = ReadScheduler()

        def protocol(place: ConnectionSlot) -> asyncio.Protocol:
            return HttpProtocol(places, place, reading, self.config, self.server_state)

        highest = limit - RESERVE // 2
        self._listeners = [ConnectionAcceptor(listening, places, protocol, highest) for listening in sockets or []]
        self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Let nobody in any more, then let those inside finish."""
        for listener in self._listeners:
            listener.close()
        await super().shutdown(sockets)
