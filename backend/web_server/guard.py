"""What every answer carries and what no request gets past: host, origin, size, headers."""

import ipaddress
import socket
from collections.abc import Iterable
from urllib.parse import unquote_to_bytes, urlsplit

from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import HTTPConnection
from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket

from backend.messages.base import Problem, Refusal
from backend.messages.sheet import LONGEST_SHEET
from backend.plain_text import PlainTextError, require_plain

MAX_BODY_BYTES = 256 * 1024
SHEETS = "/api/chart-sheet.pdf"
"""Where drawings are sent to, the only bodies that are large."""
MAX_SHEET_BYTES = LONGEST_SHEET
"""So many characters a sheet may have; none takes less than a byte."""
_READING = {"GET", "HEAD", "OPTIONS"}

APP_POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
DOCUMENT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; frame-ancestors 'self'"

HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Permissions-Policy": "camera=(), geolocation=(), microphone=()",
    "Content-Security-Policy": APP_POLICY,
}
"""What every answer carries, unless its route says otherwise."""


class Guard:
    """ASGI middleware in front of everything, websockets and the answers to failures included.

    Refuses a Host header that this service is not known by (DNS rebinding), an Origin other than that host on
    websockets and on everything that writes, and bodies larger than ``most_bytes`` or of no certain length.
    """

    def __init__(self, app: ASGIApp, allowed_hosts: Iterable[str] = ()) -> None:
        self._app = app
        self._names = {"localhost", socket.gethostname().lower(), *(host.lower() for host in allowed_hosts)}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what is allowed, answer the rest."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        refusal = self._refusal(scope)
        if refusal is None:
            await self._app(scope, receive, _with_headers(scope, send))
        elif scope["type"] == "websocket":
            await WebSocket(scope, receive, _with_headers(scope, send)).send_denial_response(refusal)
        else:
            await refusal(scope, receive, _with_headers(scope, send))

    def _refusal(self, scope: Scope) -> Response | None:
        headers = Headers(scope=scope)
        host = headers.get("host", "")
        if not self._is_known(host):
            return _refuse(400, "unknown_host", f"this service is not known as {host!r}; see SINEW_ALLOWED_HOSTS")
        writes = scope["type"] == "websocket" or scope["method"] not in _READING
        if writes and not _same_origin(headers, host):
            return _refuse(403, "foreign_origin", "requests from pages of another origin are refused")
        try:
            for part in (scope.get("raw_path") or scope["path"], scope["query_string"]):
                require_plain(unquote_to_bytes(part).decode("utf-8", "replace"))
        except PlainTextError as error:
            return _refuse(400, "bad_character", f"the address: {error}")
        return _refusal_of_length(headers, most_bytes(scope["path"]))

    def _is_known(self, host: str) -> bool:
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        if name in self._names:
            return True
        try:
            ipaddress.ip_address(name)  # an address cannot be rebound to another machine
        except ValueError:
            return False
        return True


def most_bytes(path: str) -> int:
    """Return how large the body of a request to an address may be."""
    return MAX_SHEET_BYTES if path == SHEETS else MAX_BODY_BYTES


def _refusal_of_length(headers: Headers, most: int) -> Response | None:
    if "transfer-encoding" in headers:
        if "content-length" in headers:
            return _refuse(400, "two_lengths", "send either a Content-Length or a Transfer-Encoding, not both")
        return _refuse(411, "length_required", "send a Content-Length")
    length = headers.get("content-length", "0")
    if not (length.isascii() and length.isdigit()):
        return _refuse(400, "bad_length", "the Content-Length has to be a whole number")
    if len(length) > 12 or int(length) > most:
        return _refuse(413, "too_large", f"the body is larger than {most} bytes")
    return None


def _same_origin(headers: Headers, host: str) -> bool:
    origin = headers.get("origin")
    if origin is not None:
        try:
            return urlsplit(origin).netloc.lower() == host.lower()
        except ValueError:  # a bracket that is not closed
            return False
    return headers.get("sec-fetch-site", "none") in ("none", "same-origin")


def _with_headers(scope: Scope, send: Send) -> Send:
    private = HTTPConnection(scope).url.path.startswith("/api")

    async def send_with_headers(message: Message) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            if private:
                headers.setdefault("Cache-Control", "no-store")
        await send(message)

    return send_with_headers


def _refuse(status: int, code: str, message: str) -> JSONResponse:
    body = Refusal(error=Problem(code=code, message=message))
    return JSONResponse(body.model_dump(exclude_none=True), status_code=status)
