"""Latency of STOP under load from groups of clients: each alone, then all together."""

import tempfile
import time
from pathlib import Path
from urllib.parse import urlsplit

import httpx
from rich.console import Console

from tests.soak.attack import junk, sockets, viewers
from tests.soak.attack.crowd import Crowd, Signals, running_clients, usual_descriptors
from tests.soak.attack.isolation import isolate
from tests.soak.attack.processes import count_unpooled_children
from tests.soak.attack.stop_button import StopButton, stop_and_check, wind_up
from tests.soak.attack.tally import Tally
from tests.soak.live_service import Bench, Loop, bench_on

SLOW_BODIES = 300
VIEWERS = 24
HANDS = 4
ADDRESSES = 50
"""Loopback addresses that the crowd of many addresses comes from."""

LOG_GROWTH_MB = 1.0
MEMORY_GROWTH_MB = 150.0
LONGEST_S = 120.0
"""Presses end after this time [s]: where each takes seconds, some tell it as well as many."""


def under_load(presses: int, idle: int, console: Console) -> bool:
    """Press STOP ``presses`` times under each load; return whether all responses were in time and nothing leaked."""
    isolate()
    usual_descriptors()
    whole = True
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder)) as bench:
        loop = Loop(bench.service.pid)
        for name, wanted in _crowds(bench, idle).items():
            tally = Tally(f"STOP under {name}", console)
            service = _Service(bench)
            button = StopButton(bench)  # signed in and connected before the load starts
            with running_clients(*wanted) as signals:
                _press(bench, loop, button, tally, presses)
                tally.note(_count(signals))
            button.release()
            service.check(tally)
            whole &= tally.close()
        loop.close()
    return whole


def _crowds(bench: Bench, idle: int) -> dict[str, list[Crowd]]:
    at = urlsplit(bench.service.url)
    address = (str(at.hostname), int(at.port or 80))
    viewer = (bench.service.data / "viewer-token").read_text(encoding="ascii").strip()
    one = (sockets.idle, (address, idle, 1))
    many = (sockets.idle, (address, idle, ADDRESSES))
    slow = (sockets.slow_bodies, (address, SLOW_BODIES, ADDRESSES))
    junk_of_all_kinds = (junk.throw, (address, viewer, HANDS))
    watching = (viewers.busy, (bench.service.url, viewer, VIEWERS))
    return {
        "nobody": [],
        f"{idle} idle sockets of one address": [one],
        f"{idle} idle sockets of {ADDRESSES} addresses": [many],
        f"{SLOW_BODIES} slow bodies": [slow],
        "junk": [junk_of_all_kinds],
        f"{VIEWERS} busy viewers": [watching],
        "all of them": [many, slow, junk_of_all_kinds, watching],
    }


def _press(bench: Bench, loop: Loop, button: StopButton, tally: Tally, presses: int) -> None:
    """Press STOP under voltage, on a kept and on a new connection in turn."""
    ending = time.monotonic() + LONGEST_S
    for turn in range(presses):
        if time.monotonic() > ending:
            tally.lost(True, f"only {turn} of {presses} presses in {LONGEST_S:g} s")
            return
        fresh = turn % 2 == 1
        try:
            wind_up(bench, loop)
        except (httpx.HTTPError, TimeoutError) as error:
            tally.lost(True, f"reset and pretension: {error!r}")
        stop_and_check(button, loop, tally, fresh=fresh, what="STOP, new connection" if fresh else "STOP")


class _Service:
    """Possible leaks of the service: memory, log lines, tracebacks, processes."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self._before = self._look()

    def check(self, tally: Tally) -> None:
        memory, log, tracebacks, children = (
            now - before for now, before in zip(self._look(), self._before, strict=True)
        )
        tally.take("log grown by [MB]", log / 1e6, LOG_GROWTH_MB)
        tally.take("memory grown by [MB]", memory, MEMORY_GROWTH_MB)
        if tracebacks > 0:
            last = self._bench.service.log.read_text(encoding="utf-8", errors="replace").rpartition("Traceback")[2]
            tally.lost(True, f"{tracebacks} tracebacks in the log, the last: {last[-600:]}")
        tally.lost(children > 0, f"{children} processes more than before")

    def _look(self) -> tuple[float, int, int, int]:
        process = Path(f"/proc/{self._bench.service.pid}")
        status = process.joinpath("status").read_text(encoding="ascii")
        memory = next(int(line.split()[1]) / 1e3 for line in status.splitlines() if line.startswith("VmRSS"))
        log = self._bench.service.log.read_bytes()
        return memory, len(log), log.count(b"Traceback"), count_unpooled_children(self._bench.service.pid)


def _count(signals: list[Signals]) -> str:
    return "crowd: " + ("; ".join(map(_counted, signals)) or "nobody")


def _counted(signal: Signals) -> str:
    whole = "" if signal.there.is_set() else ", never all of them"
    return f"{signal.now.value} at once, {signal.ever.value} in all, {signal.failed.value} failed{whole}"
