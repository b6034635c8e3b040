"""viser server without a network: it draws for local viewers and receives nothing.

viser's own server listens on a TCP port without authentication or origin check, serves files there, and accepts
messages from any client; one of them makes it fork and request an address from a public tunnel. None of that can be
disabled. It is therefore given no network: in place of a listening socket it gets an ``_InProcessTransport``, which
opens nothing and stores viser's connection handler; in place of a websocket that handler gets a ``_Viewer``, which
accepts viser's messages and never sends one. Alternatives: docs/decisions/0015-viser-without-a-port.md.
"""

import asyncio
import threading
from collections.abc import Awaitable, Callable, Coroutine, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, TypeAlias

import rich
import viser
import websockets.datastructures
import websockets.exceptions
from viser.infra import _infra

from backend.scene import messages
from plant import SinewError

PROTOCOL = f"viser-v{viser.__version__}"
"""Subprotocol of the websocket: viser's page and its messages change with each version."""

Send: TypeAlias = Callable[[bytes], Awaitable[None]]
_CLEAR_UP_S = 5.0
_one_at_a_time = threading.RLock()


class SceneEndedError(SinewError):
    """The server of viser is not running."""


class PortlessServer(viser.ViserServer):
    """A ``ViserServer`` without a socket and without handlers for browser messages.

    Raises RuntimeError if this version of viser listens in another way: no 3D view is better than an open port.
    """

    def __init__(self) -> None:
        self._transport = transport = _InProcessTransport()
        with _suppress_output():
            vars(_infra)["websockets"] = SimpleNamespace(
                asyncio=SimpleNamespace(server=SimpleNamespace(serve=transport.serve)),
                datastructures=websockets.datastructures,
                exceptions=websockets.exceptions,
            )
            super().__init__(host="nowhere", port=0, verbose=False)
        if not transport.is_open:
            self.stop()
            raise RuntimeError(messages.viewer_opens_port(version=viser.__version__))
        # The remaining handlers are the requests to publish the scene and the browser's file uploads.
        self._websock_server._incoming_handlers.clear()

    @property
    def viewers(self) -> int:
        """Number of viewers of the scene."""
        return len(self._transport.viewers)

    @property
    def is_alive(self) -> bool:
        """Whether viser's thread still serves."""
        return self._transport.is_open

    async def show(self, send: Send) -> None:
        """Stream the scene and its changes to ``send`` until cancelled.

        Runs in the caller's event loop. The next message waits until the last is sent; changes meanwhile are merged.
        Raises SceneEndedError, and errors of ``send``.
        """
        await self._transport.show(send)

    def request_share_url(self, verbose: bool = True) -> str | None:
        """Do nothing: viser's own method would fork to publish the scene."""
        return None

    def disconnect_share_url(self) -> None:
        """Do nothing: the scene is never published."""

    def stop(self) -> None:
        """Disconnect all viewers and end viser's thread."""
        with _suppress_output():
            super().stop()

    def clear_up(self) -> None:
        """Clean up after the death of viser's thread: disconnect its viewers."""
        self.stop()
        loop = self._event_loop
        if loop.is_running() or loop.is_closed():
            return
        tasks = asyncio.all_tasks(loop)
        for task in tasks:
            task.cancel()
        loop.run_until_complete(asyncio.wait_for(asyncio.gather(*tasks, return_exceptions=True), _CLEAR_UP_S))
        loop.close()


@contextmanager
def _suppress_output() -> Iterator[None]:
    """Suppress viser's output, which prints an address that does not exist."""
    with _one_at_a_time:
        original_print = rich.print
        vars(rich)["print"] = lambda *_words, **_how: None
        try:
            yield
        finally:
            vars(rich)["print"] = original_print


class _InProcessTransport:
    """Replacement of ``websockets.asyncio.server.serve``, used in viser's event loop."""

    def __init__(self) -> None:
        self.viewers: set[asyncio.Task[None]] = set()
        self._handler: Callable[[_Viewer], Coroutine[Any, Any, None]] | None = None
        self._loop: asyncio.AbstractEventLoop | None = None

    @property
    def is_open(self) -> bool:
        return self._loop is not None and self._loop.is_running()

    def serve(
        self, handler: Callable[["_Viewer"], Coroutine[Any, Any, None]], *_address: object, **_options: object
    ) -> "_InProcessTransport":
        self._handler = handler
        return self

    async def __aenter__(self) -> SimpleNamespace:
        self._loop = asyncio.get_running_loop()
        return SimpleNamespace(server=SimpleNamespace(sockets=()))

    async def __aexit__(self, *_error: object) -> None:
        self._loop = None
        viewers = list(self.viewers)
        for viewer in viewers:
            viewer.cancel()
        await asyncio.gather(*viewers, return_exceptions=True)

    async def show(self, send: Send) -> None:
        loop = self._loop
        if loop is None:
            raise SceneEndedError(messages.view_ended())
        shown = asyncio.run_coroutine_threadsafe(self._serve(_Viewer(send, asyncio.get_running_loop())), loop)
        await asyncio.wrap_future(shown)

    async def _serve(self, viewer: "_Viewer") -> None:
        if self._loop is None or self._handler is None:
            raise SceneEndedError(messages.view_ended())
        task = self._loop.create_task(self._handler(viewer))
        self.viewers.add(task)
        task.add_done_callback(self.viewers.discard)
        await task


class _Viewer:
    """Replacement of a browser's websocket for viser; it never receives a message.

    It sends in the service's event loop.
    """

    subprotocol = PROTOCOL

    def __init__(self, send: Send, service: asyncio.AbstractEventLoop) -> None:
        self._send = send
        self._service = service

    async def send(self, message: bytes) -> None:
        await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(self._pass_on(message), self._service))

    async def recv(self) -> bytes:
        never: asyncio.Future[bytes] = asyncio.get_running_loop().create_future()
        return await never

    async def close(self, code: int = 1000, reason: str = "") -> None:
        return None

    async def _pass_on(self, message: bytes) -> None:
        await self._send(message)
