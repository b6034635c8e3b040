"""Each ready-made experiment, its loop or its service killed in the middle: samples, end, report and its proof."""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console

from backend.experiments import library
from tests.soak.live_service import Bench, Loop, bench_on, wait_until

PLAYED_S = 4.0
LOST_S = 1.0
"""The recorder stores once a second: no more than that may be missing."""


def killed_experiments(console: Console) -> bool:
    """Kill loop or service in each experiment and check the result; return whether all checks pass."""
    folder = Path(tempfile.mkdtemp(prefix="sinew-killed-"))
    try:
        found = [
            _after(victim, name, folder, console)
            for name in library.READY_NAMES
            for victim in ("the loop", "the service")
        ]
    finally:
        shutil.rmtree(folder)
    console.print(f"{sum(found)} of {len(found)} experiments keep their samples, end and report")
    return all(found)


def _after(victim: str, name: str, folder: Path, console: Console) -> bool:
    with _killed(victim, name, folder) as (bench, run, played_s):
        wait_until(lambda: _view(bench, run)["end_state"] != "running", "the run's end")
        wait_until(lambda: _view(bench, run)["evaluation"] != "pending", "the run's result")
        view = _view(bench, run)
        rows = bench.client.get(f"/api/runs/{run}/data.csv").text.splitlines()
        kept_s = len([row for row in rows if row[:1].isdigit()]) / 1000
        page = bench.client.get(f"/api/runs/{run}/report.html")
        file = folder / f"{run}.html"
        file.write_bytes(page.content)
        verified = subprocess.run(
            [sys.executable, "-m", "backend", "report", "verify", str(file), "--data", str(bench.service.data)],
            capture_output=True,
            text=True,
            check=False,
        )
    good = (
        view["end_state"] == ("link_lost" if victim == "the loop" else "service_died")
        and kept_s >= played_s - LOST_S
        and page.is_success
        and ("were played" in page.text or "No result" in page.text)
        and verified.returncode == 0
    )
    proof = " ".join((verified.stdout + verified.stderr).split()).removeprefix(f"{file} ")
    console.print(
        f"{'kept' if good else 'LOST'}: {name}, {victim} killed after {played_s:.1f} s: {view['end_state']}, "
        f"{kept_s:.1f} s of samples, report {page.status_code}, {proof[:80]}"
    )
    return good


@contextmanager
def _killed(victim: str, name: str, folder: Path) -> Iterator[tuple[Bench, int, float]]:
    """Kill it during the run; return the bench for the check, the run, and the executed duration [s]."""
    data = folder / f"{name}-{victim.split()[-1]}"
    with bench_on(data) as bench:
        run = int(bench.client.post("/api/experiments", json={"name": name}).raise_for_status().json()["id"])
        wait_until(lambda: _since_order_s(bench) > 0.0, "the program's beginning")
        before_s = _since_order_s(bench)
        wait_until(lambda: _since_order_s(bench) > before_s + PLAYED_S, "the middle of the program")
        played_s = _since_order_s(bench) - before_s
        loop = Loop(bench.service.pid)
        os.kill(loop.pid if victim == "the loop" else bench.service.pid, signal.SIGKILL)
        loop.close()
        if victim == "the loop":
            yield bench, run, played_s
            return
    with bench_on(data) as anew:
        yield anew, run, played_s


def _since_order_s(bench: Bench) -> float:
    """Return the time since the start command [s], 0 until the program runs."""
    task = bench.state()["task"]
    return float(task["elapsed_s"]) if task is not None and task["phase"] == "program" else 0.0


def _view(bench: Bench, run: int) -> dict[str, Any]:
    return dict(bench.client.get(f"/api/runs/{run}").raise_for_status().json())
