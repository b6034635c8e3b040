"""A TCP relay between browser and service that can interrupt some or all connections."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

import httpx

from tests.e2e.service import Service


@dataclass
class _Line:
    request: bytes
    ends: tuple[asyncio.StreamWriter, asyncio.StreamWriter]


class Relay:
    """Forwards connections from its own port of 127.0.0.1, in its own thread."""

    def __init__(self, port: int) -> None:
        self._to = port
        self._lines: list[_Line] = []
        self._free = asyncio.Event()
        self._free.set()
        self._moving = asyncio.Event()
        self._moving.set()
        self._held = ""
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        begin = asyncio.start_server(self._pass_on, "127.0.0.1", 0)
        self._server = asyncio.run_coroutine_threadsafe(begin, self._loop).result()
        self.port = int(self._server.sockets[0].getsockname()[1])

    def count(self, path: str) -> int:
        """Return the number of connections that requested exactly ``path``."""
        return sum(line.request.startswith(f"GET {path} ".encode()) for line in self._lines)

    def cut(self, path: str) -> None:
        """Close the connections that requested ``path``."""
        for line in self._lines:
            if line.request.startswith(f"GET {path} ".encode()):
                for end in line.ends:
                    self._loop.call_soon_threadsafe(end.transport.abort)

    def hold(self, path: str) -> None:
        """Close these connections, and delay new ones until ``release``."""
        self._held = path
        self._loop.call_soon_threadsafe(self._free.clear)
        self.cut(path)

    def release(self) -> None:
        """Let the delayed connections continue."""
        self._loop.call_soon_threadsafe(self._free.set)

    def freeze(self) -> None:
        """Stop forwarding without closing connections, as a suspended laptop does."""
        self._loop.call_soon_threadsafe(self._moving.clear)

    def thaw(self) -> None:
        """Forward the delayed and all further data."""
        self._loop.call_soon_threadsafe(self._moving.set)

    def close(self) -> None:
        """Close all connections and stop the relay."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        self._moving.set()
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _pass_on(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._to)
        first = await reader.read(65536)
        self._lines.append(_Line(first, (writer, far_writer)))
        if first.startswith(f"GET {self._held} ".encode()):
            await self._free.wait()
        await self._moving.wait()
        far_writer.write(first)
        await asyncio.gather(self._pump(reader, far_writer), self._pump(far_reader, writer), return_exceptions=True)

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            while data := await reader.read(65536):
                await self._moving.wait()
                writer.write(data)
                await writer.drain()
        finally:
            await self._moving.wait()
            writer.transport.abort()


@contextmanager
def relayed(service: Service) -> Iterator[tuple[Service, Relay]]:
    """Yield the service as seen through a relay."""
    relay = Relay(httpx.URL(service.url).port or 0)
    url = f"http://127.0.0.1:{relay.port}"
    try:
        yield replace(service, url=url, link=service.link.replace(service.url, url)), relay
    finally:
        relay.close()
