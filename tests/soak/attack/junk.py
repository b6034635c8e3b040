"""Invalid data for every endpoint: no HTTP, malformed HTTP, unknown messages to the websockets.

One of them is the request of viser to publish the scene, so this runs in isolation.
"""

import asyncio
import random
from collections.abc import Iterator

import viser
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException
from websockets.typing import Subprotocol

from tests.soak.attack.crowd import Signals

SHARE = b"\x81\xa4type\xafShareUrlRequest"
"""{"type": "ShareUrlRequest"} in msgpack: asks viser for a public address of the scene."""

PATIENCE_S = 2.0
SEED = 20


def throw(signals: Signals, address: tuple[str, int], token: str, hands: int) -> None:
    """Send invalid data from ``hands`` tasks until the end; ``ever`` counts the requests."""
    asyncio.run(_throw(signals, address, token, hands))


async def _throw(signals: Signals, address: tuple[str, int], token: str, hands: int) -> None:
    work = [asyncio.create_task(_raw(signals, address, random.Random(SEED + hand))) for hand in range(hands)]
    headers = {"Authorization": f"Bearer {token}"}
    url = f"ws://localhost:{address[1]}"
    scene = [Subprotocol(f"viser-v{viser.__version__}")]
    for path, subprotocols in (("/api/live", None), ("/scene", scene), ("/replay", scene)):
        work.append(asyncio.create_task(_messages(signals, url + path, headers, subprotocols)))
    while not signals.over.is_set():
        await asyncio.sleep(0.1)
        if signals.ever.value > 10 * hands:
            signals.there.set()
    for task in work:
        task.cancel()
    await asyncio.gather(*work, return_exceptions=True)


async def _raw(signals: Signals, address: tuple[str, int], chance: random.Random) -> None:
    thrown = _requests(chance)
    while True:
        try:
            reader, writer = await asyncio.open_connection(*address)
            writer.write(next(thrown))
            async with asyncio.timeout(PATIENCE_S):
                await writer.drain()
                await reader.read(4096)
            writer.close()
        except (OSError, TimeoutError):
            signals.failed.value += 1
            await asyncio.sleep(0.05)
        signals.ever.value += 1


def _requests(chance: random.Random) -> Iterator[bytes]:
    """Yield invalid data without end, the same for the same seed."""
    while True:
        yield chance.randbytes(chance.randint(1, 4000))
        yield b"GET / HTTP/1.1\r\nHost: localhost\r\n" + b"X: y\r\n" * 20_000 + b"\r\n"
        yield b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n"
        yield b"GET / HTTP/1.1\r\nHost: localhost\r\nOrigin: http://[\r\n\r\n"
        yield b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nOrigin: http://[\r\nContent-Length: 2\r\n\r\n{}"
        yield b"POST /api/stop HTTP/1.1\r\nHost: localhost\r\nContent-Length: -1\r\n\r\n"
        yield (
            b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n"
            + b"fff\r\n" + b"a" * 0xFFF + b"\r\n" * 2
        )  # fmt: skip
        body = b'{"token": "\\ud800"}'
        yield (
            b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
            b"Content-Length: %d\r\n\r\n" % len(body) + body
        )
        yield b"GET /api/live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\r\n"
        yield b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + chance.randbytes(200)  # the start of TLS
        yield b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
        yield b"GET / HTTP/1.1\r\nHost: " + chance.randbytes(40).replace(b"\n", b"") + b"\r\n\r\n"


async def _messages(
    signals: Signals, url: str, headers: dict[str, str], subprotocols: list[Subprotocol] | None
) -> None:
    chance = random.Random(SEED)
    while True:
        try:
            async with connect(url, additional_headers=headers, subprotocols=subprotocols, max_size=None) as socket:
                # One per connection: the first invalid message may close it.
                await socket.send(_message(chance))
                signals.ever.value += 1
                async with asyncio.timeout(0.2):
                    async for _ in socket:
                        pass
        except (OSError, TimeoutError, WebSocketException):
            await asyncio.sleep(0.05)


def _message(chance: random.Random) -> str | bytes:
    messages: list[str | bytes] = [
        SHARE,
        SHARE.replace(b"Request", b"Request" + b"\x00"),
        chance.randbytes(chance.randint(0, 2000)),
        b"\x81\xa4type",
        b"\xdf\xff\xff\xff\xff",  # the header announces a map of four thousand million entries
        b"\x91" * 5000,
        "",
        "{",
        '{"id": 1e999}',
        '{"kind": "ping", "id": -1, "control": "\\ud800"}',
        "[" * 20_000,
        "x" * 500_000,
    ]
    return chance.choice(messages)
