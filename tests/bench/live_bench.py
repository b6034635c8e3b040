"""The live stream with many viewers: delay of frames, cost of silent viewers, lateness of the loop."""

import asyncio
import resource
import socket
import tempfile
import time
from contextlib import AsyncExitStack
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from rich.console import Console
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed

from backend import wire
from backend.api.dependencies import SEND_TIMEOUT_S
from backend.sample import INDEX, STORED_NAMES
from backend.services.live_stream import HISTORY_S
from plant.interface import T_s
from tests.bench.c_twin import PacingTwin
from tests.bench.table import Ratio, print_ratios
from tests.soak.live_service import Bench, Loop, bench_on, wait_until

VIEWERS, SILENT = 100, 20
WATCHED_S = 20.0
MAX_DELAY_MS, MAX_GROWTH_MB, MAX_LATENESS_RATIO = 50.0, 50.0, 1.2
OVERRUNS = STORED_NAMES.index("overruns")


def bench(console: Console) -> bool:
    """Print the measurements; return whether all bounds are met."""
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder)) as live:
        loop = Loop(live.service.pid)
        live.run()
        wait_until(lambda: loop.ring.count > HISTORY_S / T_s, "a full history")
        lines = [*_relative_to_c(loop, Path(folder)), *asyncio.run(_viewers(live, loop))]
        loop.close()
    return print_ratios(console, "Live: loop and viewers", lines)


def _relative_to_c(loop: Loop, folder: Path) -> list[Ratio]:
    """Return lateness and processor time of the loop relative to those of the C loop, measured simultaneously."""
    twin = PacingTwin(folder)
    priority = _fifo_priority(loop.pid)
    begun, before_s, theirs_before_s = loop.ring.count, _processor_s(loop.pid), _of_children_s()
    periods = round(WATCHED_S / T_s)
    theirs = float(np.percentile(twin.lateness_us(periods, priority, T_s), 99.0))
    ticks = loop.ring.count - begun
    busy_us, bare_us = (
        1e6 * (_processor_s(loop.pid) - before_s) / ticks,
        1e6 * (_of_children_s() - theirs_before_s) / periods,
    )
    _, rows, _ = loop.ring.read(begun, ticks)
    ours = 1e6 * float(np.percentile(rows[:, INDEX["lateness_s"]], 99.0))
    detail = f"{ours:.0f} µs against {theirs:.0f} µs, FIFO priority {priority}, {WATCHED_S:g} s side by side"
    return [
        Ratio.at_most("lateness p99: loop / bare C loop", ours / theirs, MAX_LATENESS_RATIO, detail),
        Ratio(
            "processor time of the loop process / bare C loop",
            busy_us / bare_us,
            detail=f"{busy_us:.0f} µs a tick against {bare_us:.0f} µs for the waiting alone",
        ),
    ]


def _processor_s(pid: int) -> float:
    return 1e-9 * int(Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()[0])


def _of_children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _fifo_priority(pid: int) -> int:
    # Field 40 of stat(5), after the name in parentheses.
    return int(Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[37])


async def _viewers(live: Bench, loop: Loop) -> list[Ratio]:
    origin_s = _time_of_tick_zero(loop)
    async with AsyncExitStack() as stack:
        reading = [await stack.enter_async_context(_connected(live)) for _ in range(VIEWERS)]
        alone, missed_alone = await _delays(reading, origin_s)
        before_MB = _memory_MB(live.service.pid)
        silent = [await stack.enter_async_context(_connected(live, silent=True)) for _ in range(SILENT)]
        beside, missed_beside = await _delays(reading, origin_s)
        grown_MB = _memory_MB(live.service.pid) - before_MB
        await asyncio.sleep(SEND_TIMEOUT_S)
        dropped = sum(await asyncio.gather(*(_is_dropped(connection) for connection in silent)))
    p99, p99_beside = (float(np.percentile(delays, 99.0)) for delays in (alone, beside))
    return [
        Ratio.at_most(f"{VIEWERS} viewers at 30 Hz: p99 frame delay / 50 ms", p99 / MAX_DELAY_MS, 1.0, f"{p99:.1f} ms"),
        Ratio.at_most("samples missed by them", missed_alone, 0.0),
        Ratio.at_most(
            f"the same beside {SILENT} that never read", p99_beside / MAX_DELAY_MS, 1.0, f"{p99_beside:.1f} ms"
        ),
        Ratio.at_most("samples missed by those who read", missed_beside, 0.0),
        Ratio.at_most("memory the silent ones cost / 50 MB", grown_MB / MAX_GROWTH_MB, 1.0, f"{grown_MB:.1f} MB"),
        Ratio.at_least("silent ones dropped", dropped / SILENT, 1.0, f"{dropped} of {SILENT}"),
    ]


def _connected(live: Bench, silent: bool = False) -> connect:
    url = urlsplit(live.service.url)
    end = socket.socket()
    if silent:
        end.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    end.connect((url.hostname, url.port))
    headers = {"Authorization": live.client.headers["Authorization"]}
    queue = 1 if silent else 64
    return connect(
        f"ws://{url.netloc}/api/live", sock=end, additional_headers=headers, max_size=None, compression=None,
        max_queue=queue, ping_interval=None, close_timeout=1.0,
    )  # fmt: skip


async def _delays(viewers: list[ClientConnection], origin_s: float) -> tuple[list[float], int]:
    """Return the delays [ms] of all frames from the tick of their newest sample, and the number of missed samples."""
    delays: list[float] = []
    missed = 0

    async def watch(viewer: ClientConnection) -> None:
        nonlocal missed
        async for message in viewer:
            arrived_s = time.monotonic()
            if isinstance(message, str):
                continue
            frame = wire.unpack_frame(message)
            newest = frame.first_tick + frame.columns.shape[1] - 1
            born_s = origin_s + T_s * (newest + float(frame.columns[OVERRUNS, -1]))
            if born_s > begun_s:
                delays.append(1e3 * (arrived_s - born_s))
                missed += frame.missed

    begun_s = time.monotonic() + 2.0  # until the histories have been read
    tasks = [asyncio.create_task(watch(viewer)) for viewer in viewers]
    await asyncio.sleep(WATCHED_S + 2.0)
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)
    return delays, missed


def _time_of_tick_zero(loop: Loop) -> float:
    """Return the monotonic time of tick 0 [s]: the earliest value from many readings of the newest tick."""
    looks = []
    for _ in range(2000):
        row = loop.ring.newest()
        if row is None:
            raise LookupError("the loop has no samples")
        looks.append(time.monotonic() - T_s * (row[INDEX["tick"]] + row[INDEX["overruns"]]))
        time.sleep(3e-4)
    return float(min(looks))


async def _is_dropped(connection: ClientConnection) -> bool:
    """Return whether the service had closed the connection before the first read."""
    try:
        async with asyncio.timeout(5.0):
            while True:
                await connection.recv()
    except ConnectionClosed:
        return True
    except TimeoutError:
        return False


def _memory_MB(pid: int) -> float:
    pages = int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6
