"""Invalid requests and messages from a seed: the same in every run."""

import json
import random
from collections.abc import Callable

TOKENS = (b"GET", b"POST", b"PUT", b"\x16\x03\x01", b"get", b"G\x00T", b"", b"OPTIONS", b"A" * 300)
PATHS = (
    b"/api/state",
    b"/api/session",
    b"/",
    b"/%00",
    b"/%c0%af..",
    b"//api//state",
    b"*",
    b"/" + b"a" * 9000,
    b"/\xff\xfe",
)
VERSIONS = (b"HTTP/1.1", b"HTTP/1.0", b"HTTP/9.9", b"HTP/1.1", b"", b"HTTP/1.1 extra")
HEADERS = (
    b"Host: 127.0.0.1",
    b"Host: 127.0.0.1\r\nHost: [",
    b"Origin: http://[",
    b"Origin: \xff\xfe",
    b"Content-Length: -1",
    b"Content-Length: 99999999999999999999999",
    b"Content-Length: 5\r\nContent-Length: 7",
    b"Content-Length: 4\r\nTransfer-Encoding: chunked",
    b"Transfer-Encoding: chunked, chunked",
    b"Transfer-Encoding: gzip",
    b"Authorization: Bearer \x00",
    b"Authorization: Bearer \xc3\x28",
    b"Authorization: Basic =====",
    b"Cookie: " + b"a=b; " * 500,
    b"Cookie: sinew=\x01\x02",
    b"Expect: 100-continue",
    b"Upgrade: h2c\r\nConnection: Upgrade, HTTP2-Settings",
    b"X-Long: " + b"x" * 70_000,
    b" folded: line",
    b"no colon at all",
    b": no name",
    b"X\x00Nul: 1",
    b"Range: bytes=99999-1,0-0,-0",
    b"If-Modified-Since: yesterday",
    b"Sec-Fetch-Site: \xf0\x9f",
    b"Content-Type: application/json; charset=\xff",
)
CHUNKS = (
    b"5\r\nhello\r\n0\r\n\r\n",
    b"zz\r\n",
    b"-1\r\n",
    b"ffffffffffffffff\r\nx",
    b"5;ext\r\nhel",
    b"0\r\nX: y\r\n\r\n",
    b"\r\n\r\n",
)
BODIES = (
    b"",
    b"{",
    b'{"token": "\\ud800"}',
    b"\xff\xfe\x00",
    b"[" * 5000,
    b'{"a":' * 2000,
    b"null",
    b"1e999",
    b'{"token": ' + b"9" * 400 + b"}",
)


def request(dice: random.Random) -> bytes:
    """Return one malformed request, often with several faults."""
    line = b" ".join((dice.choice(TOKENS), dice.choice(PATHS), dice.choice(VERSIONS)))
    headers = [b"Host: 127.0.0.1", *dice.sample(HEADERS, dice.randint(0, 4))]
    if dice.random() < 0.1:
        headers += [b"X-%d: y" % n for n in range(dice.choice((20, 200, 2000)))]
    body = dice.choice(BODIES)
    if dice.random() < 0.3:
        headers.append(b"Transfer-Encoding: chunked")
        body = dice.choice(CHUNKS)
    elif body and dice.random() < 0.7:
        headers.append(b"Content-Length: %d" % max(0, len(body) + dice.choice((0, 0, 0, -1, 7))))
    end = dice.choice((b"\r\n", b"\r\n", b"\r\n", b"\n", b"\r"))
    whole = end.join((line, *headers, b"", b"")) + body
    return mangled(whole, dice) if dice.random() < 0.4 else whole


def mangled(whole: bytes, dice: random.Random) -> bytes:
    """Return the bytes cut, with flipped bits, doubled or with zero bytes."""
    place = dice.randrange(len(whole) + 1)
    ways: tuple[Callable[[], bytes], ...] = (
        lambda: whole[:place],
        lambda: whole[:place] + dice.randbytes(dice.randint(1, 40)) + whole[place:],
        lambda: whole[:place] + b"\x00" + whole[place:],
        lambda: whole * dice.randint(2, 6),
        lambda: dice.randbytes(dice.randint(1, 400)),
    )
    return dice.choice(ways)()


def message(dice: random.Random) -> str | bytes:
    """Return one message to the live stream: an invalid ping, other JSON, text or bytes."""
    numbers: tuple[object, ...] = (None, True, -1, 0, 2**63, 10**400, 1e308)
    values: tuple[object, ...] = (*numbers, "1", "\ud800", "\x00", [], {}, [[[[]]]], {"id": 1})
    ways: tuple[Callable[[], str | bytes], ...] = (
        lambda: json.dumps({"type": "ping", "id": dice.choice(values), "control": dice.choice(values)}),
        lambda: json.dumps({dice.choice(("type", "id", "control", "a", "")): dice.choice(values)}),
        lambda: dice.choice(("", "null", "NaN", "{", "[" * 5000, '{"type":"ping"', "9" * 5000, "ping", '"\\ud800"')),
        lambda: "".join(chr(dice.choice((dice.randrange(32, 0xD800), 0, 0x1F600))) for _ in range(dice.randint(1, 80))),
        lambda: dice.randbytes(dice.randint(0, 300)),
        lambda: dice.randbytes(dice.choice((1000, 60_000))),
    )
    return dice.choice(ways)()


def frame(dice: random.Random) -> bytes:
    """Return an invalid websocket frame: reserved bits and codes, no mask, wrong lengths, invalid UTF-8."""
    first = dice.randrange(256)
    length = dice.choice((0, 1, 5, 125, 126, 127))
    second = length | (0x80 if dice.random() < 0.7 else 0)
    return bytes((first, second)) + dice.randbytes(dice.choice((0, 2, 4, 8, 14, 14 + length)))


def upgrade(path: str, host: str, headers: dict[str, str]) -> bytes:
    """Return a valid websocket handshake."""
    lines = {
        "Host": host,
        "Upgrade": "websocket",
        "Connection": "Upgrade",
        "Sec-WebSocket-Key": "dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version": "13",
        "Origin": f"http://{host}",
        **headers,
    }
    return "\r\n".join((f"GET {path} HTTP/1.1", *(f"{n}: {v}" for n, v in lines.items()), "", "")).encode()


def handshake(dice: random.Random, path: str, host: str, headers: dict[str, str]) -> bytes:
    """Return a handshake that is cut or has one wrong header."""
    wrong = {
        "Sec-WebSocket-Key": ("", "x", "=" * 400, "\x00"),
        "Sec-WebSocket-Version": ("", "12", "abc", "99999999999999999999"),
        "Sec-WebSocket-Protocol": ("viser-v0.0.0", "chat, \x01", "", "a" * 5000),
        "Upgrade": ("h2c", "", "websocket, websocket"),
        "Connection": ("close", "", "Upgrade, close, keep-alive"),
        "Origin": ("http://[", "null", "http://elsewhere.example", "\x7f"),
        "Host": ("", "[", "elsewhere.example", "127.0.0.1:99999999"),
    }
    name = dice.choice(list(wrong))
    whole = upgrade(path, host, headers | {name: dice.choice(wrong[name])})
    return whole[: dice.randrange(len(whole))] if dice.random() < 0.3 else whole
