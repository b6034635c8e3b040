"""Live simulation with viewers for minutes: no gap in the recording, exact ticks, no missed sample."""

import asyncio
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console
from websockets.asyncio.client import connect

from backend import wire
from backend.sample import INDEX
from tests.soak.live_service import Bench, Loop, bench_on, wait_until

STEP_S = 5.0
"""The joint moves to and fro, every so often."""


class Viewer:
    """A websocket client that reads and counts everything."""

    def __init__(self) -> None:
        self.samples = 0
        self.missed = 0
        self.gaps = 0
        self._next: int | None = None

    async def watch(self, url: str, authorization: str) -> None:
        """Read until cancelled."""
        headers = {"Authorization": authorization}
        async with connect(url, additional_headers=headers, max_size=None, compression=None) as socket:
            async for message in socket:
                if isinstance(message, bytes):
                    self._take(wire.unpack_frame(message))

    def _take(self, frame: wire.Frame) -> None:
        count = frame.columns.shape[1]
        if self._next is not None:
            self.missed += frame.missed
            self.gaps += frame.first_tick != self._next + frame.missed
        self.samples += count
        self._next = frame.first_tick + count


def watched_simulation(minutes: float, viewers: int, console: Console) -> bool:
    """Run for ``minutes`` with ``viewers``; return whether all counts are exact."""
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder)) as bench:
        loop = Loop(bench.service.pid)
        run = bench.run()
        begun, first = time.monotonic_ns(), loop.ring.newest()
        watching = [Viewer() for _ in range(viewers)]
        asyncio.run(_watch(bench, watching, 60.0 * minutes))
        last, ended = loop.ring.newest(), time.monotonic_ns()
        if first is None or last is None:
            raise LookupError("the loop has no samples")
        fault = bench.state()["fault"]
        bench.client.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
        stored = _stored(bench, run)
        loop.close()
    ticks, overruns = (last - first)[[INDEX["tick"], INDEX["overruns"]]]
    periods = (ended - begun) / 1e6
    # Clock and ring buffer were not read at the same moment.
    exact = abs(ticks + overruns - periods) < 5.0 + last[INDEX["lateness_s"]] * 1e3
    missed, gaps = sum(viewer.missed for viewer in watching), sum(viewer.gaps for viewer in watching)
    complete = stored["missing_samples"] == 0 and stored["samples"] >= ticks
    seen = np.mean([viewer.samples for viewer in watching])
    console.print(
        f"{minutes:g} min, {viewers} viewers: {ticks:.0f} ticks and {overruns:.0f} overruns in {periods:.0f} periods; "
        f"recorded {stored['samples']} samples, {stored['missing_samples']} missing; "
        f"viewers missed {missed} of {seen:.0f} samples each, {gaps} unexplained gaps; fault: {fault}"
    )
    return bool(exact and complete and gaps == 0 and fault is None)


async def _watch(bench: Bench, viewers: list[Viewer], seconds: float) -> None:
    url = bench.service.url.replace("http", "ws") + "/api/live"
    authorization = bench.client.headers["Authorization"]
    tasks = [asyncio.create_task(viewer.watch(url, authorization)) for viewer in viewers]
    end, turn = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        turn += 1
        references = {"q_ref": 0.8 if turn % 2 else -0.8, "S_ref": 10.0 + turn % 3}
        await asyncio.to_thread(bench.client.put, "/api/references", json=references)
        await asyncio.sleep(min(STEP_S, max(0.0, end - time.monotonic())))
        for task in tasks:
            if task.done():
                task.result()
                raise ConnectionError("a viewer was dropped")
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def _stored(bench: Bench, run: int) -> dict[str, int]:
    def closed() -> bool:
        return bool(bench.client.get(f"/api/runs/{run}").json()["end_state"] != "running")

    wait_until(closed, f"end of run {run}")
    return dict(bench.client.get(f"/api/runs/{run}").json())
