"""The 3D view on the dashboard's own port, behind the same authentication."""

import asyncio
import logging
import re
import time
from collections.abc import Callable
from contextlib import suppress
from importlib.resources import files

from fastapi import APIRouter, Request, WebSocket
from fastapi.responses import HTMLResponse, RedirectResponse
from starlette.requests import HTTPConnection
from starlette.websockets import WebSocketDisconnect, WebSocketDisconnected

from backend.scene import messages
from backend.scene.model import SceneMirror
from backend.scene.server import PROTOCOL, SceneEndedError
from plant import SinewError

# Client page ---------------------------------------------------------------------------------------
# viser's client page, adapted to a frame of the dashboard.


POLICY = (
    "default-src 'none'; script-src 'unsafe-inline' 'wasm-unsafe-eval' blob:; style-src 'unsafe-inline'; "
    "img-src data: blob:; font-src data:; connect-src 'self' blob: data:; worker-src blob:; frame-ancestors 'self'"
)
"""Content-Security-Policy of the scene's page: one self-contained file with inline scripts."""

# In a frame the client would reconnect only while the frame has the focus. Control panel and notices are the
# dashboard's, and the dashboard's background is visible through the scene, so the client follows its colour scheme: it
# reads that once from its address, like the camera view that the dashboard requests.
_HEAD = """<head>
<script>
  document.hasFocus = () => true
  const dashboard = parent.document.documentElement, scheme = "data-mantine-color-scheme"
  const dark = () => dashboard.getAttribute(scheme) === "dark"
  const camera = [...new URLSearchParams(location.search)].filter(([name]) => name.startsWith("initialCamera"))
  const asked = camera.map(([name, value]) => `&${name}=${value}`).join("")
  history.replaceState(null, "", (dark() ? "?hideViserLogo&darkMode" : "?hideViserLogo") + asked)
  if (parent !== window) new MutationObserver(() => location.reload()).observe(dashboard, { attributeFilter: [scheme] })
</script>
<style>
  .mantine-Paper-root, .mantine-Notifications-root { display: none !important }
  html, body, #root div { background-color: transparent !important }
</style>"""

# The dashboard shows the loading progress of the view, so the page publishes its stage and each change of it
# (frontend/src/components/SceneFrame.tsx). The websocket of the client is in a worker; its messages are read too. A
# connection alone is no stage, as the service may have no free slot: the scene exists with its first message. It is
# shown in the frame after one in which one of its meshes was drawn: the client draws some frames without meshes before.
# Late messages of a worker on a closed connection are ignored.
_STAGES = """
<script>{
  const root = document.documentElement
  const tell = (stage) => {
    if (root.dataset.stage === stage) return
    root.dataset.stage = stage
    parent.postMessage("stage", location.origin)
  }
  const nextFrame = window.requestAnimationFrame.bind(window)
  const gl = WebGL2RenderingContext.prototype, draw = gl.drawElements
  const sizes = new Set()
  const look = function (mode, count, ...rest) {
    if (sizes.has(count)) {
      gl.drawElements = draw
      nextFrame(() => { if (root.dataset.stage === "drawing") tell("shown") })
    }
    draw.call(this, mode, count, ...rest)
  }
  const tellWhenDrawn = () => { tell("drawing"); gl.drawElements = look }
  let open = false
  const heard = {
    connected: () => { open = true },
    message_batch: ({ messages }) => {
      if (!open) return
      for (const { props } of messages) if (props?.faces) sizes.add(props.faces.length)
      if (["connecting", "lost"].includes(root.dataset.stage)) tellWhenDrawn()
    },
    closed: () => { open = false; if (root.dataset.stage !== "connecting") tell("lost") },
  }
  window.Worker = class extends Worker {
    constructor(...given) {
      super(...given)
      this.addEventListener("message", ({ data }) => heard[data?.type]?.(data))
    }
  }
  addEventListener("webglcontextlost", () => tell("dropped"), true)
  addEventListener("webglcontextrestored", () => open ? tellWhenDrawn() : tell("lost"), true)
  tell("connecting")
}</script>"""


def page() -> str:
    """Return the client's page."""
    html = (files("viser") / "client" / "build" / "index.html").read_text(encoding="utf-8")
    before, head, after = html.partition("<head>")
    if not head:
        raise RuntimeError(messages.client_without_head())
    return before + _HEAD + _STAGES + after


# Proxy ---------------------------------------------------------------------------------------------
# The 3D view on the dashboard's own port: viser's page and its websocket, behind the same authentication.
#
# Data flows to the browser only. Messages of a browser are counted and discarded unread, as the scene accepts no
# commands and viser needs no input (its page publishes the camera position).


MOST_VIEWERS = 32
"""Most viewers of one scene: each costs about a hundredth of a core."""

OPENING_S = 0.1
"""Pause between initial transmissions of the scene, a megabyte each [s], so that STOP is handled in between."""

MOST_BYTES = 4096
MOST_PER_S = 100.0
MOST_AT_ONCE = 300.0
"""Limits of messages from a browser. viser's page sends its camera position, in 300 bytes, at most 50 times a
second."""

SEND_TIMEOUT_S = 20.0
"""Time after which a browser that receives nothing is disconnected [s]."""

VERSION = re.compile(r"viser-v[0-9.]{1,20}")

POLICY_VIOLATION, TOO_BIG, WRONG_VERSION, FAILED, LATER = 1008, 1009, 1002, 1011, 1013
_LOG = logging.getLogger(__name__)


class DisconnectError(SinewError):
    """A browser sent a message that viser's page never sends."""

    def __init__(self, code: int, reason: str) -> None:
        super().__init__(reason)
        self.code = code
        self.reason = reason


class InboundLimiter:
    """Counts and discards the messages of one browser.

    Raises DisconnectError for a message that viser's page never sends.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._left = MOST_AT_ONCE
        self._last_received_s = clock()

    def take(self, message: bytes | None) -> None:
        """Count one message, None for a text."""
        now_s = self._clock()
        self._left = min(MOST_AT_ONCE, self._left + MOST_PER_S * (now_s - self._last_received_s)) - 1.0
        self._last_received_s = now_s
        if message is None:
            raise DisconnectError(POLICY_VIOLATION, messages.text_not_supported())
        if len(message) > MOST_BYTES:
            raise DisconnectError(
                TOO_BIG, messages.message_too_large(size_bytes=len(message), maximum_bytes=MOST_BYTES)
            )
        if self._left < 0.0:
            raise DisconnectError(POLICY_VIOLATION, messages.too_many_messages(maximum_per_s=MOST_PER_S))


def create_scene_router(
    authorize: Callable[[HTTPConnection], object], scene: SceneMirror, path: str = "/scene"
) -> APIRouter:
    """Return the routes of ``scene`` under ``path``.

    ``authorize`` raises for unauthenticated requests.
    """
    routes = APIRouter(include_in_schema=False)
    html = page()
    viewers = _SceneViewers(scene, path)

    @routes.get(path)
    def redirect(request: Request) -> RedirectResponse:
        query = f"?{request.url.query}" if request.url.query else ""
        return RedirectResponse(f".{path}/{query}", status_code=307)  # relative, since a proxy may add a path prefix

    @routes.get(f"{path}/")
    def client(request: Request) -> HTMLResponse:
        authorize(request)
        return HTMLResponse(html, headers={"Content-Security-Policy": POLICY, "Cache-Control": "private, max-age=3600"})

    @routes.websocket(path)
    @routes.websocket(f"{path}/")
    async def stream(websocket: WebSocket) -> None:
        authorize(websocket)
        await viewers.serve(websocket)

    return routes


class _SceneViewers:
    """Viewers of one scene, including those that wait."""

    def __init__(self, scene: SceneMirror, path: str) -> None:
        self._scene = scene
        self._path = path
        self._viewer_count = 0
        self._start_lock = asyncio.Lock()

    async def serve(self, websocket: WebSocket) -> None:
        """Stream the scene until either side ends the connection."""
        offered = websocket.scope.get("subprotocols", [])
        if PROTOCOL not in offered:
            await _refuse_version(websocket, offered)
            return
        await websocket.accept(subprotocol=PROTOCOL)
        if self._viewer_count >= MOST_VIEWERS:
            await websocket.close(LATER, messages.too_many_viewers(maximum=MOST_VIEWERS))
            return
        self._viewer_count += 1
        try:
            end = await self._show(websocket)
        finally:
            self._viewer_count -= 1
        if end is not None:
            _LOG.warning("%s: the service closed the connection of a browser: %s", self._path, end.reason)
            with suppress(WebSocketDisconnected, WebSocketDisconnect):  # it may have disconnected meanwhile
                await websocket.close(end.code, end.reason)

    async def _show(self, websocket: WebSocket) -> DisconnectError | None:
        """Stream the scene; return the reason to disconnect the browser.

        None if the browser has disconnected.
        """
        tasks = [asyncio.create_task(_receive(websocket)), asyncio.create_task(self._send(websocket))]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            return _find_reason(done.pop())
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _send(self, websocket: WebSocket) -> None:
        async def send(message: bytes) -> None:
            async with asyncio.timeout(SEND_TIMEOUT_S):
                await websocket.send_bytes(message)

        async with self._start_lock:
            await asyncio.sleep(OPENING_S)
        await self._scene.show(send)


async def _refuse_version(websocket: WebSocket, offered: list[str]) -> None:
    """Reject a viser page of another version, which shows it.

    Other clients are closed.
    """
    pages = [name for name in offered if VERSION.fullmatch(name)]
    if pages:
        await websocket.accept(subprotocol=pages[0])
    await websocket.close(WRONG_VERSION, messages.page_of_another_version())


async def _receive(websocket: WebSocket) -> None:
    limiter = InboundLimiter()
    while (message := await websocket.receive())["type"] != "websocket.disconnect":
        limiter.take(message.get("bytes"))


def _find_reason(ended: asyncio.Task[None]) -> DisconnectError | None:
    error = SceneEndedError() if ended.cancelled() else ended.exception()
    match error:
        case None | WebSocketDisconnect() | WebSocketDisconnected():
            return None
        case DisconnectError():
            return error
        case TimeoutError():
            return DisconnectError(POLICY_VIOLATION, messages.no_data_accepted(timeout_s=SEND_TIMEOUT_S))
        case SceneEndedError():
            return DisconnectError(LATER, messages.view_ended())
        case _:
            return DisconnectError(FAILED, messages.view_failed(error=type(error).__name__))
