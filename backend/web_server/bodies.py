"""Bodies of requests: read whole, and refused where they are too large or hold what cannot be written down again."""

from typing import Any

import pydantic_core
from starlette.requests import ClientDisconnect, HTTPConnection
from starlette.types import Message, Receive

from backend.errors import Because, RefusalError
from backend.plain_text import PlainTextError, require_plain_texts

MOST_NAMES, MOST_LISTED = 1_500, 12_000
"""Named values, and values in lists, that a body may have: twenty layouts of charts have 1100, a removal of recordings
ten thousand runs. A refusal of 24 000 unknown names held the interpreter for 0.2 s."""

_SUSPECT = (rb"\u", rb"\b", rb"\f", b"\x7f", b"\xc2")
"""How JSON can write a character that is not taken; what has none of these is not looked through."""


def has_body(connection: HTTPConnection) -> bool:
    """Tell whether a request brings one."""
    return connection.scope["type"] == "http" and connection.headers.get("content-length", "0").strip("0") != ""


async def read_whole(receive: Receive, most: int) -> bytes:
    """Return the whole body, of ``most`` bytes at most. Raises RefusalError, ClientDisconnect."""
    body = bytearray()
    while True:
        message = await receive()
        if message["type"] == "http.disconnect":
            raise ClientDisconnect
        body += message.get("body", b"")
        if len(body) > most:
            raise RefusalError(Because.TOO_LARGE, f"the body is larger than {most} bytes")
        if not message.get("more_body", False):
            break
    return bytes(body)


def require_writable(body: bytes) -> None:
    """Raise RefusalError for a body that is no JSON, or holds what no request has: it takes up to 10 ms."""
    try:
        document = pydantic_core.from_json(body)
        _require_few(document)
        if any(mark in body for mark in _SUSPECT):
            require_plain_texts(document)
    except PlainTextError as error:
        raise RefusalError(Because.BAD_VALUE, f"body: {error}", code="bad_character") from None
    except ValueError as error:
        raise RefusalError(Because.BAD_VALUE, f"body: this is not JSON: {error}", code="json_invalid") from None


def _require_few(document: Any) -> None:
    """Raise RefusalError for more parts than any request has: each that is wrong takes time to be told."""
    parts, names, count = [document], 0, 0
    while parts:
        part = parts.pop()
        names += len(part) if isinstance(part, dict) else 0
        count += len(part) if isinstance(part, list) else 0
        if names > MOST_NAMES or count > MOST_LISTED:
            said = f"{MOST_NAMES} named values and {MOST_LISTED} in lists"
            why = f"body: it has more than {said}, the most that any request has: leave some out"
            raise RefusalError(Because.BAD_VALUE, why, code="too_many_parts")
        parts.extend(part.values() if isinstance(part, dict) else part if isinstance(part, list) else ())


def once_more(body: bytes, receive: Receive) -> Receive:
    """Return a ``receive`` that gives ``body`` first."""
    messages: list[dict[str, Any]] = [{"type": "http.request", "body": body, "more_body": False}]

    async def again() -> Message:
        return messages.pop() if messages else await receive()

    return again
