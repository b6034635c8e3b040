"""``sinew doctor``."""

import os
import shutil
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from backend.cli.output import AsJson, out, print_json, print_table
from backend.cli.place import DataFolder, settings_with

TICKS = 1000
LEAST_FREE_BYTES = 2 * 1024**3
"""A day at the bench: 80 MB an hour of recording."""

_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox")


@dataclass(frozen=True)
class Finding:
    """One thing that was looked at; ``remedy`` is empty where all is well."""

    what: str
    found: str
    remedy: str = ""


def doctor(data: DataFolder = None, as_json: AsJson = False) -> None:
    """Tell what this machine can do for a 1 kHz loop, with a remedy for what it cannot."""
    settings = settings_with(data=data)
    findings = [*_real_time(), _beat(), _cores(), _card(), _browser(), _pages(), _disk(settings.data)]
    if as_json:
        print_json([asdict(finding) for finding in findings])
        return
    print_table(("what", "found", "remedy"), [(f.what, f.found, f.remedy) for f in findings])
    open_points = sum(bool(finding.remedy) for finding in findings)
    out.print("all well" if not open_points else f"{open_points} of {len(findings)} could be better", highlight=False)


def _real_time() -> Iterator[Finding]:
    from backend.realtime.timing import request_real_time

    granted = request_real_time()
    refusals = "; ".join(granted.refusals)
    priority = f"SCHED_FIFO {granted.priority}" if granted.priority else "ordinary"
    yield Finding("scheduling", priority, "" if granted.priority else _naming("FIFO", granted.refusals) or refusals)
    locked = "locked" if granted.memory_locked else "not locked"
    yield Finding("memory", locked, "" if granted.memory_locked else _naming("memory", granted.refusals) or refusals)
    yield Finding("timer slack", f"{granted.timer_slack_ns} ns")


def _naming(word: str, refusals: tuple[str, ...]) -> str:
    return next((refusal for refusal in refusals if word in refusal), "")


def _beat() -> Finding:
    """Keep 1 ms for a second, as the loop does but without its work."""
    from backend.realtime.timing import Pacer
    from plant.interface import T_s

    pacer = Pacer(T_s)
    late_us = sorted(1e6 * pacer.wait() for _ in range(TICKS))
    resolution_ns = 1e9 * time.get_clock_info("monotonic").resolution
    found = f"late by {late_us[TICKS // 2]:.0f} µs (median), {late_us[int(0.99 * TICKS)]:.0f} µs (99 %)"
    missed = f", {pacer.overruns} deadlines missed" if pacer.overruns else ""
    remedy = "close other programs, or give the loop a core of its own" if pacer.overruns > TICKS // 100 else ""
    return Finding("1 ms beat", f"{found}{missed}; clock {resolution_ns:.0f} ns", remedy)


def _cores() -> Finding:
    cores = len(os.sched_getaffinity(0))
    return Finding("processor cores", str(cores), "" if cores >= 2 else "the loop and the dashboard want a core each")


def _card() -> Finding:
    from plant.factory import require_available
    from plant.interface import PlantChoice, PlantError, PlantKind

    try:
        require_available(PlantChoice(PlantKind.RIG))
        from plant.daq import driver

        return Finding("DAQ card", driver())
    except PlantError as error:
        found, _, remedy = str(error).partition(": ")
        return Finding("DAQ card", f"none: {found}", f"the simulator needs none; for a rig {remedy}")


def _browser() -> Finding:
    found = next((name for name in _BROWSERS if shutil.which(name)), None)
    return Finding("browser", found or "none on this machine", "" if found else "open the dashboard from another one")


def _pages() -> Finding:
    built = (Path(__file__).parents[1] / "static" / "index.html").is_file()
    return Finding("dashboard pages", "built" if built else "not built", "" if built else "make frontend")


def _disk(data: Path) -> Finding:
    folder = data.resolve()
    while not folder.exists():
        folder = folder.parent
    free = shutil.disk_usage(folder).free
    if not os.access(folder, os.W_OK):
        return Finding("data folder", f"{data} cannot be written", "choose another with --data, or change its owner")
    remedy = "" if free >= LEAST_FREE_BYTES else "free some space: a recording takes 80 MB an hour"
    return Finding("data folder", f"{data}: {free / 1024**3:.1f} GB free", remedy)
