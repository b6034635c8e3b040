"""The server of the service with a small application, on a real port, in a thread of the test process."""

import asyncio
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from starlette.types import ASGIApp

from backend.server.listening import Ending
from backend.server.server import Server


@contextmanager
def served(app: ASGIApp) -> Iterator[tuple[str, int]]:
    """Serve ``app`` on a free port of this machine; yields host and port."""
    ready = threading.Event()
    listening = socket.create_server(("127.0.0.1", 0))
    server = Server(app, ready.set, Ending())
    thread = threading.Thread(target=lambda: asyncio.run(server.serve([listening])))
    thread.start()
    try:
        assert ready.wait(30)
        yield listening.getsockname()
    finally:
        server.should_exit = True
        thread.join(30)
