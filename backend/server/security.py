"""Security of the web server: hosts, origins, cookies, bodies, headers, sessions."""

import asyncio
import html
import ipaddress
import logging
import socket
from collections.abc import Iterable
from contextlib import suppress
from typing import Any
from urllib.parse import unquote_to_bytes, urlsplit

import pydantic_core
from fastapi import Response
from fastapi.responses import HTMLResponse
from starlette.datastructures import Headers, MutableHeaders
from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.responses import JSONResponse
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.types import Message as AsgiMessage
from starlette.websockets import WebSocket

from backend.auth import Authentication, Credentials, User
from backend.errors import RequestRejectedError
from backend.plain_text import PlainTextError, check_plain_text, check_plain_texts
from backend.public_url import PublicUrl
from backend.schemas import LONGEST_SHEET, ErrorDetail, ErrorResponse
from backend.server import deployment, messages
from backend.server.deployment import COOKIE_PATH, PUBLIC, apply_forwarded_headers, parse_host_name
from plant import ErrorCode, Message

# Request bodies ------------------------------------------------------------------------------------
# Bodies of requests: read completely, and rejected if they are too large or contain values that cannot be stored.


MOST_NAMES, MOST_LISTED = 1_500, 12_000
"""Most named values, and values in lists, of a body: twenty layouts of charts have 1100, a deletion of recordings ten
thousand runs. A rejection of 24 000 unknown names held the interpreter for 0.2 s."""

_SUSPECT = (rb"\u", rb"\b", rb"\f", b"\x7f", b"\xc2")
"""JSON encodings of a character that is not accepted; a body without any of these is not searched."""


def has_body(connection: HTTPConnection) -> bool:
    """Return whether a request has a body."""
    return connection.scope["type"] == "http" and connection.headers.get("content-length", "0").strip("0") != ""


async def read_body(receive: Receive, most: int) -> bytes:
    """Return the whole body, of at most ``most`` bytes.

    Raises RequestRejectedError, ClientDisconnect.
    """
    body = bytearray()
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ClientDisconnect
        body += message.get("body", b"")
        if len(body) > most:
            raise RequestRejectedError(ErrorCode.TOO_LARGE, messages.body_too_large(maximum_bytes=most))
        if not message.get("more_body", False):
            break
    return bytes(body)


def require_valid_body(body: bytes) -> None:
    """Raise RequestRejectedError for a body that is not valid JSON or too complex.

    Takes up to 10 ms.
    """
    try:
        document = pydantic_core.from_json(body)
        _require_few(document)
        if any(mark in body for mark in _SUSPECT):
            check_plain_texts(document)
    except PlainTextError as error:
        message = messages.invalid_text_in_body(reason=error.message)
        raise RequestRejectedError(ErrorCode.BAD_VALUE, message, code="bad_character") from None
    except ValueError as error:
        message = messages.body_is_not_json(reason=str(error))
        raise RequestRejectedError(ErrorCode.BAD_VALUE, message, code="json_invalid") from None


def _require_few(document: Any) -> None:
    """Raise RequestRejectedError for more values than any request has.

    Reporting each invalid one would take time.
    """
    parts, names, count = [document], 0, 0
    while parts:
        part = parts.pop()
        names += len(part) if isinstance(part, dict) else 0
        count += len(part) if isinstance(part, list) else 0
        if names > MOST_NAMES or count > MOST_LISTED:
            message = messages.too_many_values(maximum_named=MOST_NAMES, maximum_listed=MOST_LISTED)
            raise RequestRejectedError(ErrorCode.BAD_VALUE, message, code="too_many_parts")
        parts.extend(part.values() if isinstance(part, dict) else part if isinstance(part, list) else ())


def replay_body(body: bytes, receive: Receive) -> Receive:
    """Return a ``receive`` that returns ``body`` first."""
    unread: list[dict[str, Any]] = [{"type": "http.request", "body": body, "more_body": False}]

    async def again() -> AsgiMessage:
        return unread.pop() if unread else await receive()

    return again


# Cookies -------------------------------------------------------------------------------------------
# Credentials of a request, and the session cookie of a response.


COOKIE = "sinew_session_"
"""Prefix of the cookie's name; the port of the address follows, because all ports of a host share their cookies."""

COOKIE_MAX_AGE_S = 400 * 24 * 3600
"""Longest lifetime of a cookie in browsers [s]: the service decides how long a session lasts."""

LONGEST_COOKIE = 2000

_SAME_COOKIES = 4
_SHOWN = "sinew.shown"


def find_authentication(connection: HTTPConnection) -> Authentication:
    """Return the authentication of the running service."""
    authentication: Authentication = connection.app.state.authentication
    return authentication


def read_credentials(connection: HTTPConnection) -> Credentials:
    """Return the credentials of a request or websocket, parsed once."""
    shown: Credentials | None = connection.scope.get(_SHOWN)
    if shown is None:
        scheme, _, token = connection.headers.get("authorization", "").partition(" ")
        shown = connection.scope[_SHOWN] = Credentials(
            address=connection.client.host if connection.client else "unknown",
            token=token.strip() if scheme.lower() == "bearer" else None,
            cookies=_values(connection, cookie_name(connection)),
            is_foreign=connection.headers.get("sec-fetch-site", "none") not in ("none", "same-origin"),
        )
    return shown


def set_session_cookie(
    authentication: Authentication, connection: HTTPConnection, response: Response, person: User
) -> None:
    """Set the session cookie of ``person`` on ``response``."""
    value = authentication.make_cookie(person)
    if value is not None:
        response.set_cookie(
            cookie_name(connection),
            value,
            max_age=COOKIE_MAX_AGE_S,
            httponly=True,
            samesite="strict",
            secure=_is_secure(connection),
            path=_path(connection),
        )


def end_session(authentication: Authentication, connection: HTTPConnection, response: Response) -> None:
    """End the session of the cookie, and delete the cookie in the browser."""
    authentication.sign_out(read_credentials(connection))
    for path in sorted({"/", _path(connection)}):
        response.delete_cookie(
            cookie_name(connection), httponly=True, samesite="strict", secure=_is_secure(connection), path=path
        )


def cookie_name(connection: HTTPConnection) -> str:
    """Return the name of the session cookie at the address that the browser requested."""
    port = connection.headers.get("host", "").rpartition(":")[2]
    return COOKIE + (port if port.isascii() and port.isdigit() and len(port) <= 5 else "80")


def _is_secure(connection: HTTPConnection) -> bool:
    """Return whether browsers must send the cookie over https only.

    Always with a public https address: a request does not show whether it came that way. Chrome and Firefox treat
    http://localhost as secure too, so a person at this machine can sign in without the proxy.
    """
    public: PublicUrl | None = connection.scope.get(PUBLIC)
    return public is not None and public.is_secure


def _path(connection: HTTPConnection) -> str:
    path: str = connection.scope.get(COOKIE_PATH, "/")
    return path


def _values(connection: HTTPConnection, name: str) -> list[str]:
    """Return the cookies of a name: other applications on this host may have set some."""
    pairs = (pair.strip().partition("=") for pair in connection.headers.get("cookie", "").split(";"))
    return [value for found, _, value in pairs if found == name and len(value) <= LONGEST_COOKIE][:_SAME_COOKIES]


# Session end ---------------------------------------------------------------------------------------
# Closes websockets when the session that opened them ends: a page is authenticated only when it opens one.


LIVE = "/api/live"
OVER = 1008
"""Close code of the websocket: policy violation."""


class SessionExpiryMiddleware:
    """ASGI middleware for all websockets, of the live stream and of the 3D views."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on, and simulate a disconnect by the client when the session ends."""
        if scope["type"] != "websocket":
            await self._app(scope, receive, send)
            return
        connection = HTTPConnection(scope)
        authentication = find_authentication(connection)
        person = None
        with suppress(RequestRejectedError):
            person = authentication.authenticate(read_credentials(connection))
        if person is None:
            await self._app(scope, receive, send)
            return
        with authentication.active_users.connect(person, is_page=scope["path"].rstrip("/") == LIVE) as over:
            await self._app(scope, _until(over, receive, send), send)


def _until(over: asyncio.Event, receive: Receive, send: Send) -> Receive:
    async def receive_or_end() -> AsgiMessage:
        message, ended = asyncio.ensure_future(receive()), asyncio.ensure_future(over.wait())
        try:
            await asyncio.wait((message, ended), return_when=asyncio.FIRST_COMPLETED)
        finally:
            ended.cancel()
            if not message.done():
                message.cancel()
        if message.done() and not message.cancelled():
            return message.result()
        with suppress(RuntimeError):
            await send({"type": "websocket.close", "code": OVER, "reason": "signed out"})
        return {"type": "websocket.disconnect", "code": OVER}

    return receive_or_end


# Message page --------------------------------------------------------------------------------------
# A page with one sentence, for a browser that requests an address without a dashboard.


DOCUMENT_POLICY = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; font-src data:; frame-ancestors 'self'"
"""Content-Security-Policy of documents without scripts."""

_STYLE = (
    ":root { color-scheme: light dark } body { font: 16px/1.5 system-ui, sans-serif; max-width: 44rem; "
    "margin: 12vh auto; padding: 0 16px; overflow-wrap: anywhere }"
)


def render_message_page(status: int, text: str) -> HTMLResponse:
    """Return a page that shows ``text``."""
    content = (
        '<!doctype html><html lang="en"><meta charset="utf-8"><meta name="viewport" content="width=device-width">'
        f"<title>Sinew</title><style>{_STYLE}</style><main><h1>Sinew</h1><p>{html.escape(text)}</p></main></html>"
    )
    return HTMLResponse(content, status_code=status, headers={"Content-Security-Policy": DOCUMENT_POLICY})


def is_page_request(headers: Headers, method: str) -> bool:
    """Return whether a browser requests a page, rather than a script a resource.

    Only a browser lists HTML first.
    """
    return method == "GET" and headers.get("accept", "").startswith("text/html")


# Guard ---------------------------------------------------------------------------------------------
# Headers of every response, and checks of every request: host, origin, size, headers.


MAX_BODY_BYTES = 256 * 1024
SHEETS = "/api/chart-sheet.pdf"
"""Path for drawings, the only large bodies."""
MAX_SHEET_BYTES = LONGEST_SHEET
"""Most characters of a sheet; each takes at least one byte."""
LONGEST_HEAD = 32 * 1024
"""Most bytes of a request's head, also of a websocket's: it has the cookies of all applications on its host."""
MOST_HEADERS = 100
_READING = {"GET", "HEAD", "OPTIONS"}
_UNCLEAR = {"two_lengths", "length_required", "bad_length"}
"""Rejections of a request whose end is uncertain: its connection is closed."""

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
"""Headers of every response, unless its route sets them."""


class HostOriginMiddleware:
    """Outermost ASGI middleware, for websockets and error responses too.

    Rejects an unknown Host header (DNS rebinding), an Origin other than that host on websockets and on everything that
    writes, heads beyond ``LONGEST_HEAD`` or ``MOST_HEADERS``, and bodies larger than ``body_limit`` or of uncertain
    length. With a ``public`` URL the hosts are that one, the loopback names of this machine and ``allowed_hosts``, and
    the origins are that of the URL and those of the other hosts; its path prefix is removed from the path, and the
    X-Forwarded-For of a trusted proxy names the client. A rejection that a proxy or its configuration may have caused
    is logged with its remedy.
    """

    def __init__(self, app: ASGIApp, allowed_hosts: Iterable[str] = (), public: PublicUrl | None = None) -> None:
        self._app = app
        self._public = public
        self._local = {"localhost", *(host.lower() for host in allowed_hosts)}
        if public is None:
            self._local.add(socket.gethostname().lower())

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on permitted requests, respond to the others."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        apply_forwarded_headers(scope, self._public)
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
            message = messages.head_too_large(maximum_bytes=LONGEST_HEAD, maximum_lines=MOST_HEADERS)
            return _refuse(scope, 431, "head_too_large", message)
        if not self._is_known(host):
            message = deployment.unknown_host(host, self._public)
            _log.warning("The service refused a request: %s", message)
            return _refuse(scope, 400, "unknown_host", message)
        if scope["type"] == "http" and "sec-websocket-key" in headers:
            message = deployment.upgrade_lost(scope["path"], headers.get("origin"))
            _log.warning("The service refused a websocket: %s", message)
            return _refuse(scope, 426, "upgrade_required", message)
        writes = scope["type"] == "websocket" or scope["method"] not in _READING
        if writes and not self._is_own_origin(headers, host):
            origin = headers.get("origin") or "a page of another site"
            message = deployment.foreign_origin(origin, host, self._public)
            what = "websocket" if scope["type"] == "websocket" else scope["method"]
            _log.warning("The service refused %s %s: %s", what, scope["path"], message)
            return _refuse(scope, 403, "foreign_origin", message)
        try:
            for part in (scope.get("raw_path") or scope["path"], scope["query_string"]):
                check_plain_text(unquote_to_bytes(part).decode("utf-8", "replace"))
        except PlainTextError as error:
            return _refuse(scope, 400, "bad_character", messages.invalid_text_in_address(reason=error.message))
        return _refusal_of_length(scope, headers, body_limit(scope["path"]))

    def _is_known(self, host: str) -> bool:
        name = parse_host_name(host)
        if self._public is not None and name == parse_host_name(self._public.host):
            return True
        return self._is_local(name)

    def _is_local(self, name: str) -> bool:
        """Return whether a host's name is this machine's, without a proxy.

        An address cannot be rebound to another.
        """
        if name in self._local:
            return True
        try:
            address = ipaddress.ip_address(name)
        except ValueError:
            return False
        return self._public is None or address.is_loopback

    def _is_own_origin(self, headers: Headers, host: str) -> bool:
        """Return whether the request is not from another site's page.

        A browser shows that in one of two headers.
        """
        if headers.get("sec-fetch-site", "none") not in ("none", "same-origin"):
            return False
        origin = headers.get("origin")
        if origin is None:
            return True
        if self._public is not None:
            if origin.lower() == self._public.origin:
                return True
            if not self._is_local(parse_host_name(host)):
                return False
        try:
            return urlsplit(origin).netloc.lower() == host.lower()
        except ValueError:  # an unclosed bracket
            return False


def body_limit(path: str) -> int:
    """Return the largest body of a request to an address [bytes]."""
    return MAX_SHEET_BYTES if path == SHEETS else MAX_BODY_BYTES


def _refusal_of_length(scope: Scope, headers: Headers, most: int) -> Response | None:
    if "transfer-encoding" in headers:
        if "content-length" in headers:
            return _refuse(scope, 400, "two_lengths", messages.two_body_lengths())
        return _refuse(scope, 411, "length_required", messages.body_length_missing())
    length = headers.get("content-length", "0")
    if not (length.isascii() and length.isdigit()):
        return _refuse(scope, 400, "bad_length", messages.invalid_body_length())
    if len(length) > 12 or int(length) > most:
        return _refuse(scope, 413, "too_large", messages.body_too_large(maximum_bytes=most))
    return None


def _with_headers(scope: Scope, send: Send) -> Send:
    private = HTTPConnection(scope).url.path.startswith("/api")

    async def send_with_headers(message: AsgiMessage) -> None:
        if message["type"] in ("http.response.start", "websocket.http.response.start"):
            headers = MutableHeaders(scope=message)
            for name, value in HEADERS.items():
                headers.setdefault(name, value)
            if private:
                headers.setdefault("Cache-Control", "no-store")
        await send(message)

    return send_with_headers


def _without_body(send: Send) -> Send:
    """Return a ``send`` for HEAD: the response of GET without its body."""

    async def send_head(message: AsgiMessage) -> None:
        if message["type"] == "http.response.body":
            message = {**message, "body": b""}
        await send(message)

    return send_head


def _head_bytes(scope: Scope) -> int:
    """Return the approximate length of a request's head [bytes]."""
    target = len(scope.get("raw_path") or scope["path"]) + len(scope["query_string"])
    return target + sum(len(name) + len(value) + 4 for name, value in scope["headers"])


def _refuse(scope: Scope, status: int, code: str, message: Message) -> Response:
    """Return a rejection: a page for a browser, else the usual error body."""
    # The following data may be part of the request and must not be parsed as the next one. A body that is only too
    # large is read to its end: closing earlier would discard the response for a client that still sends.
    headers = {"Connection": "close"} if scope["type"] == "http" and code in _UNCLEAR else {}
    if scope["type"] == "http" and is_page_request(Headers(scope=scope), scope["method"]):
        page = render_message_page(status, message)
        page.headers.update(headers)
        return page
    body = ErrorResponse(error=ErrorDetail(code=code, message=message, message_code=message.code))
    return JSONResponse(body.model_dump(exclude_none=True), status_code=status, headers=headers)
