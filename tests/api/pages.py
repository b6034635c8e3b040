"""A signed-in page of the running service, with cookie, key and sequence number as in a browser."""

import asyncio
import itertools
import json
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress

import httpx
from websockets.sync.connection import Connection

from backend.auth.control_lease import CONTROL_HEADER
from tests.api.conftest import PATIENCE_S, live
from tests.api.patient import connect
from tests.e2e.service import Service

PING_S = 0.2
"""Interval between two pings of an open page [s]."""


class Page:
    """One page; ``take`` takes the control lease and stores its key."""

    def __init__(self, service: Service, name: str, role: str = "token") -> None:
        self.browser = httpx.Client(base_url=service.url, timeout=PATIENCE_S)
        token = (service.data / role).read_text().strip()
        self.browser.post("/api/session", json={"token": token, "name": name}).raise_for_status()
        self.socket_url = service.url.replace("http", "ws") + "/api/live"
        self._numbers = itertools.count(1)
        self.key = "a" * 16

    def take(self, take_over: bool = False) -> httpx.Response:
        answer = self.browser.post("/api/control", json={"take_over": take_over})
        if answer.is_success:
            self.key, self._numbers = answer.json()["page"], itertools.count(1)
        return answer

    def command(self, method: str, path: str, body: object = None) -> httpx.Response:
        return self.browser.request(method, path, json=body, headers=self.stamp())

    def stamp(self) -> dict[str, str]:
        return {CONTROL_HEADER: f"{self.key}.{next(self._numbers)}"}

    def ping(self) -> dict[str, object]:
        async def once() -> dict[str, object]:
            cookies = "; ".join(f"{name}={value}" for name, value in self.browser.cookies.items())
            async with connect(self.socket_url, additional_headers={"Cookie": cookies}) as socket:
                await socket.send(self._ping())
                while True:
                    message = await asyncio.wait_for(socket.recv(), PATIENCE_S)
                    if isinstance(message, str) and '"pong"' in message:
                        return dict(json.loads(message))

        return asyncio.run(once())

    @contextmanager
    def staying(self) -> Iterator[None]:
        """Send pings from a thread during the block, because a request may take longer than the ping timeout."""
        over = threading.Event()

        def ping_until_over(socket: Connection) -> None:
            due = 0.0
            while not over.is_set():
                if (now := time.monotonic()) >= due:
                    socket.send(self._ping())
                    due = now + PING_S
                with suppress(TimeoutError):
                    socket.recv(timeout=PING_S)

        with live(self.browser) as socket, ThreadPoolExecutor(1) as threads:
            pinging = threads.submit(ping_until_over, socket)
            try:
                yield
            finally:
                over.set()
                pinging.result()

    def _ping(self) -> str:
        return json.dumps({"type": "ping", "id": 1, "control": self.key})


@contextmanager
def pages(service: Service, *names: str) -> Iterator[list[Page]]:
    opened = [Page(service, name) for name in names]
    try:
        yield opened
    finally:
        for page in opened:
            page.command("DELETE", "/api/control")
            page.browser.close()
