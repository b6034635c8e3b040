"""Busy viewers: each reads the live stream and requests pages successively."""

import asyncio
from collections.abc import Coroutine, Sequence

import httpx
from websockets.asyncio.client import connect
from websockets.exceptions import WebSocketException

from tests.soak.attack.crowd import Signals

ASKED = ("/api/state", "/api/runs", "/api/experiments", "/api/checklist", "/api/flights", "/api/banks", "/api/system")


def busy(signals: Signals, url: str, token: str, count: int) -> None:
    """Run ``count`` viewers. ``ever`` counts responses, ``failed`` status 500 and lost streams."""
    asyncio.run(_all(signals, url, {"Authorization": f"Bearer {token}"}, count))


async def _all(signals: Signals, url: str, headers: dict[str, str], count: int) -> None:
    viewers = [asyncio.create_task(work) for _ in range(count) for work in _viewer(signals, url, headers)]
    while not signals.over.is_set():
        await asyncio.sleep(0.1)
        if signals.ever.value >= count and signals.now.value >= count:
            signals.there.set()
    for viewer in viewers:
        viewer.cancel()
    await asyncio.gather(*viewers, return_exceptions=True)


def _viewer(signals: Signals, url: str, headers: dict[str, str]) -> Sequence[Coroutine[object, object, None]]:
    return _watch(signals, url.replace("http", "ws") + "/api/live", headers), _ask(signals, url, headers)


async def _watch(signals: Signals, url: str, headers: dict[str, str]) -> None:
    while True:
        try:
            async with connect(url, additional_headers=headers, max_size=None, compression=None) as socket:
                signals.now.value += 1
                try:
                    async for _ in socket:
                        pass
                finally:
                    signals.now.value -= 1
        except (OSError, TimeoutError, WebSocketException):
            signals.failed.value += 1
            await asyncio.sleep(0.5)


async def _ask(signals: Signals, url: str, headers: dict[str, str]) -> None:
    async with httpx.AsyncClient(base_url=url, headers=headers, timeout=60.0) as client:
        while True:
            for path in ASKED:
                try:
                    answer = await client.get(path)
                except httpx.HTTPError:
                    signals.failed.value += 1
                    await asyncio.sleep(0.1)
                else:
                    signals.ever.value += 1
                    signals.failed.value += answer.status_code == 500
