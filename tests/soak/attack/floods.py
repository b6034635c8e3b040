"""Latency of STOP while viewers send frames, reconnect, sign in, send slow headers or hold connections."""

import asyncio
import base64
import contextlib
import os
import tempfile
from collections.abc import Awaitable, Callable
from pathlib import Path
from urllib.parse import urlsplit

import httpx
from rich.console import Console

from tests.soak.attack.crowd import Crowd, Signals, running_clients
from tests.soak.attack.stop_button import StopButton, rest, stop_and_check
from tests.soak.attack.tally import Tally
from tests.soak.live_service import Loop, bench_on

VIEWERS = (1, 10, 50)
MEDIAN_S = 0.05
_AT_ONCE = 64 * 1024
"""Bytes written at once: as much as the kernel takes."""


def _frame(opcode: int, payload: bytes = b"", *, last: bool = True) -> bytes:
    """Return a masked frame as a browser sends it, with mask 0."""
    assert len(payload) < 126
    return bytes([opcode | (0x80 if last else 0), 0x80 | len(payload), 0, 0, 0, 0]) + payload


FRAMES: dict[str, bytes] = {
    "pings": _frame(9),
    "pongs": _frame(10),
    "texts": _frame(1, b"{}"),
    "binaries": _frame(2, b"x"),
    "fragments": _frame(0, b"x", last=False),
    "closes": _frame(8),
}
BEFORE = {"fragments": _frame(1, b"x", last=False)}
HELD = b"POST /api/session HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 99\r\n\r\n{"
KINDS = (*FRAMES, "reconnects", "sign-ins", "slow heads", "held connections")
_EACH = 10
"""Connections that a viewer holds at once."""


async def _opened(host: str, port: int, cookie: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    reader, writer = await asyncio.open_connection(host, port)
    key = base64.b64encode(os.urandom(16)).decode()
    lines = ["GET /api/live HTTP/1.1", f"Host: {host}:{port}", "Upgrade: websocket", "Connection: Upgrade"]
    lines += [f"Sec-WebSocket-Key: {key}", "Sec-WebSocket-Version: 13", f"Cookie: {cookie}"]
    writer.write("\r\n".join([*lines, "", ""]).encode())
    await reader.readuntil(b"\r\n\r\n")
    return reader, writer


async def _pour(host: str, port: int, cookie: str, frames: bytes, before: bytes) -> None:
    """Send frames as fast as possible, and discard the responses."""
    reader, writer = await _opened(host, port, cookie)
    reading = asyncio.create_task(_drain(reader))
    try:
        writer.write(before)
        while True:
            writer.write(frames)
            await writer.drain()
    finally:
        reading.cancel()
        writer.transport.abort()


async def _drain(reader: asyncio.StreamReader) -> None:
    while await reader.read(1 << 16):
        continue


async def _reconnect(host: str, port: int, cookie: str) -> None:
    _, writer = await _opened(host, port, cookie)
    writer.transport.abort()


async def _cookie(url: str, token: str) -> str:
    """Sign in, after any delay by the sign-ins of earlier floods."""
    async with httpx.AsyncClient(base_url=url, timeout=60.0) as page:
        while (answer := await page.post("/api/session", json={"token": token, "name": "Vic"})).status_code == 429:
            await asyncio.sleep(1.0)
        answer.raise_for_status()
        return "; ".join(f"{name}={value}" for name, value in page.cookies.items())


async def _sign_in(url: str, token: str) -> None:
    async with httpx.AsyncClient(base_url=url, timeout=30.0) as client:
        await client.post("/api/session", json={"token": token, "name": "Vic"})


async def _slow_head(host: str, port: int) -> None:
    _, writer = await asyncio.open_connection(host, port)
    try:
        for letter in f"GET /api/state HTTP/1.1\r\nHost: {host}:{port}\r\nX-A: {'a' * 2000}\r\n\r\n".encode():
            writer.write(bytes([letter]))
            await writer.drain()
            await asyncio.sleep(0)
    finally:
        writer.transport.abort()


async def _hold(host: str, port: int) -> None:
    """Hold connections with incomplete requests, and replace each one that the service closes."""

    async def hold_one() -> None:
        while True:
            with contextlib.suppress(OSError):
                reader, writer = await asyncio.open_connection(host, port)
                try:
                    writer.write(HELD)
                    await reader.read()
                finally:
                    writer.transport.abort()

    await asyncio.gather(*(hold_one() for _ in range(_EACH)))


def flood(signals: Signals, kind: str, url: str, token: str, viewers: int) -> None:
    """Run ``count`` viewers that repeat one action, each in its own task."""
    asyncio.run(_flood(signals, kind, url, token, viewers))


async def _flood(signals: Signals, kind: str, url: str, token: str, viewers: int) -> None:
    address = urlsplit(url)
    host, port = str(address.hostname), int(address.port or 0)
    cookie = await _cookie(url, token) if kind in (*FRAMES, "reconnects") else ""

    def once() -> Awaitable[None]:
        if kind in FRAMES:
            count = _AT_ONCE // len(FRAMES[kind])
            return _pour(host, port, cookie, FRAMES[kind] * count, BEFORE.get(kind, b""))
        if kind == "reconnects":
            return _reconnect(host, port, cookie)
        if kind == "held connections":
            return _hold(host, port)
        return _sign_in(url, token) if kind == "sign-ins" else _slow_head(host, port)

    async def again(work: Callable[[], Awaitable[None]]) -> None:
        while True:
            with contextlib.suppress(OSError, EOFError, httpx.HTTPError):
                await work()
            signals.ever.value += 1
            await asyncio.sleep(0)

    tasks = [asyncio.create_task(again(once)) for _ in range(viewers)]
    signals.there.set()
    while not signals.over.is_set():
        await asyncio.sleep(0.05)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def under_floods(presses: int, console: Console) -> bool:
    """Press STOP under each flood of each size; the median is checked too, and nobody loses control."""
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder)) as bench:
        loop = Loop(bench.service.pid)
        token = (bench.service.data / "viewer-token").read_text("ascii").strip()
        button = StopButton(bench, "at the button")
        whole = True
        for kind in KINDS:
            for viewers in VIEWERS:
                tally = Tally(f"STOP under {kind} of {viewers} viewers", console)
                wanted: Crowd = (flood, (kind, bench.service.url, token, viewers))
                with running_clients(wanted) as (signal,):
                    for press in range(presses):
                        stop_and_check(button, loop, tally, fresh=press % 2 == 1)
                    tally.note(f"{signal.ever.value} rounds of the flood")
                median_s = tally.median("STOP [s]")
                tally.lost(not median_s <= MEDIAN_S, f"the median is {1000 * median_s:.0f} ms")
                whole &= tally.close()
        button.release()
        rest(bench)
        loop.close()
    return whole
