"""What every answer carries and what no request gets past: host, origin, size, headers."""

import ipaddress
import logging
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
from backend.public_url import PublicUrl
from backend.web_server import deployment
from backend.web_server.message_page import message_page, wants_page
from backend.web_server.proxied import name_of, take_in

MAX_BODY_BYTES = 256 * 1024
SHEETS = "/api/chart-sheet.pdf"
"""Where drawings are sent to, the only bodies that are large."""
MAX_SHEET_BYTES = LONGEST_SHEET
"""So many characters a sheet may have; none takes less than a byte."""
LONGEST_HEAD = 32 * 1024
"""Bytes that the head of a request may have, of a websocket's too: cookies of all applications on its host."""
MOST_HEADERS = 100
_READING = {"GET", "HEAD", "OPTIONS"}
_UNCLEAR = {"two_lengths", "length_required", "bad_length"}
"""Refusals of a request whose end cannot be known for certain: its connection ends with it."""

APP_POLICY = (
    "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "object-src 'none'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
)
_log = logging.getLogger(__name__)

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
    websockets and on everything that writes, heads beyond ``LONGEST_HEAD`` or ``MOST_HEADERS``, and bodies larger than
    ``most_bytes`` or of no certain length. With a ``public`` URL the hosts are that one, the names of this machine's
    loopback and ``allowed_hosts``, and the origins are that of the URL and those of the other hosts; its path prefix is
    taken off the path, and a trusted proxy's X-Forwarded-For says who asks. A refusal that a proxy or its set-up may
    have caused is logged, with what to change.
    """

    def __init__(self, app: ASGIApp, allowed_hosts: Iterable[str] = (), public: PublicUrl | None = None) -> None:
        self._app = app
        self._public = public
        self._local = {"localhost", *(host.lower() for host in allowed_hosts)}
        if public is None:
            self._local.add(socket.gethostname().lower())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what is allowed, answer the rest."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        take_in(scope, self._public)
        if scope["type"] == "http" and scope["method"] == "HEAD":
            scope, send = {**scope, "method": "GET"}, _without_body(send)
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
        if len(headers) > MOST_HEADERS or _head_bytes(scope) > LONGEST_HEAD:
            return _refuse(scope, 431, "head_too_large", too_large_a_head())
        if not self._is_known(host):
            message = deployment.unknown_host(host, self._public)
            _log.warning("a request was refused: %s", message)
            return _refuse(scope, 400, "unknown_host", message)
        if scope["type"] == "http" and "sec-websocket-key" in headers:
            message = deployment.upgrade_lost(scope["path"], headers.get("origin"))
            _log.warning("a websocket was refused: %s", message)
            return _refuse(scope, 426, "upgrade_required", message)
        writes = scope["type"] == "websocket" or scope["method"] not in _READING
        if writes and not self._is_own_origin(headers, host):
            origin = headers.get("origin") or "a page of another site"
            message = deployment.foreign_origin(origin, host, self._public)
            what = "websocket" if scope["type"] == "websocket" else scope["method"]
            _log.warning("%s %s was refused: %s", what, scope["path"], message)
            return _refuse(scope, 403, "foreign_origin", message)
        try:
            for part in (scope.get("raw_path") or scope["path"], scope["query_string"]):
                require_plain(unquote_to_bytes(part).decode("utf-8", "replace"))
        except PlainTextError as error:
            return _refuse(scope, 400, "bad_character", f"the address: {error}")
        return _refusal_of_length(scope, headers, most_bytes(scope["path"]))

    def _is_known(self, host: str) -> bool:
        name = name_of(host)
        if self._public is not None and name == name_of(self._public.host):
            return True
        return self._is_local(name)

    def _is_local(self, name: str) -> bool:
        """Return whether a host's name is this machine's, without a proxy; an address cannot be rebound to another."""
        if name in self._local:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return self._public is None or address.is_loopback

    def _is_own_origin(self, headers: Headers, host: str) -> bool:
        """Return whether no other site's page sends this: a browser says so in one header or the other."""
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return False
        origin = headers.get("origin")
        if origin is None:
            return True
        if self._public is not None:
            if origin.lower() == self._public.origin:
                return True
            if not self._is_local(name_of(host)):
                return False
        try:
            return urlsplit(origin).netloc.lower() == host.lower()
        except ValueError:  # a bracket that is not closed
            return False


def most_bytes(path: str) -> int:
    """Return how large the body of a request to an address may be."""
    return MAX_SHEET_BYTES if path == SHEETS else MAX_BODY_BYTES


def _refusal_of_length(scope: Scope, headers: Headers, most: int) -> Response | None:
    if "transfer-encoding" in headers:
        if "content-length" in headers:
            return _refuse(scope, 400, "two_lengths", "send either a Content-Length or a Transfer-Encoding, not both")
        return _refuse(scope, 411, "length_required", "send a Content-Length")
    length = headers.get("content-length", "0")
    if not (length.isascii() and length.isdigit()):
        return _refuse(scope, 400, "bad_length", "the Content-Length has to be a whole number")
    if len(length) > 12 or int(length) > most:
        return _refuse(scope, 413, "too_large", f"the body is larger than {most} bytes")
    return None


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


def _without_body(send: Send) -> Send:
    """Answer HEAD as GET is answered, with the same head and nothing after it."""

    async def send_head(message: Message) -> None:
        if message["type"] == "http.response.body":
            message = {**message, "body": b""}
        await send(message)

    return send_head


def _head_bytes(scope: Scope) -> int:
    """Return about how long the head of a request is on the line."""
    target = len(scope.get("raw_path") or scope["path"]) + len(scope["query_string"])
    return target + sum(len(name) + len(value) + 4 for name, value in scope["headers"])


def too_large_a_head() -> str:
    """Return why a head is refused, and what a person at a browser can do."""
    return (
        f"the head of the request has more than {LONGEST_HEAD // 1024} kB or {MOST_HEADERS} lines: other applications "
        "under this host name have set too many cookies; delete the cookies of this site, or use another name for it"
    )


def _refuse(scope: Scope, status: int, code: str, message: str) -> Response:
    """Return a refusal: a page for whoever opens the address in a browser, else the body that every refusal has."""
    # What follows may be a part of it, and must not be taken for the next request. A body that is only too large is
    # read to its end: to close before that would take the answer from whoever still sends.
    headers = {"Connection": "close"} if scope["type"] == "http" and code in _UNCLEAR else {}
    if scope["type"] == "http" and wants_page(Headers(scope=scope), scope["method"]):
        page = message_page(status, message)
        page.headers.update(headers)
        return page
    body = Refusal(error=Problem(code=code, message=message))
    return JSONResponse(body.model_dump(exclude_none=True), status_code=status, headers=headers)
