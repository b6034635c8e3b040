"""``python -m tests.lanes [PYTEST ARGUMENT ...]``: all tests, each in one of the lanes; told how long each lane took.

The pages are tried in a browser and, beside it, the live tests that a busy core does not disturb. Then, one at a time,
come those that count on the machine for themselves. They wait for clocks and motions half of the time: what only
computes runs in that time, as idle work, which the kernel takes off a core in the moment something else wants it.
`tests/conftest.py` says which is which. At the end the tests that were run are counted against those there are: a test
that no lane runs is a failure.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import pytest
from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).parents[1]
LANES = {
    "pure": ("-m", "not live", "-n", "auto", "--dist", "worksteal", "-p", "no:schemathesis"),
    "live": ("-m", "live and not page and not alone", "-p", "no:xdist"),
    "page": ("-m", "page and not alone", "-p", "no:xdist", "-p", "no:schemathesis"),
    "alone": ("-m", "alone", "-p", "no:xdist"),
}
"""Worksteal leaves the tests of a file beside each other, in the process that has what they share. Schemathesis, which
takes a process seconds to load, makes requests to a live service only."""

IDLE = {"pure"}
GIVES_WAY = {"live": 5}
"""By how much nicer than a browser: a page whose clock stands still for seconds has lost control, and rightly so."""
BESIDE = (("live", "page"), ("alone", "pure"))
"""What runs at the same time, one group after the other. The first lane of a group is seen as it goes; what another
says is shown when it has ended."""

NO_TESTS = int(pytest.ExitCode.NO_TESTS_COLLECTED)


@dataclass(frozen=True)
class Ended:
    """A lane at its end: the tests that exist for the same arguments, and how those that it ran came out."""

    name: str
    code: int
    seconds: float
    there: list[str]
    outcomes: dict[str, str]

    @property
    def failed(self) -> int:
        return sum(outcome == "failed" for outcome in self.outcomes.values())


def run(name: str, arguments: list[str], said: IO[bytes] | None = None) -> Ended:
    """Run one lane, its output as it comes, or into ``said``."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pytest", "-p", "tests.lanes_record", f"--record={folder}", *LANES[name]]
        begun = time.monotonic()
        with subprocess.Popen([*command, *arguments], cwd=ROOT, stdout=said, stderr=said) as process:
            if name in IDLE:
                os.sched_setscheduler(process.pid, os.SCHED_IDLE, os.sched_param(0))
            if name in GIVES_WAY:
                os.setpriority(os.PRIO_PROCESS, process.pid, os.getpriority(os.PRIO_PROCESS, 0) + GIVES_WAY[name])
        there, outcomes = (_lines(Path(folder) / kept) for kept in ("there", "outcomes"))
        return Ended(
            name,
            0 if process.returncode == NO_TESTS else process.returncode,
            time.monotonic() - begun,
            there,
            dict(line.split(" ", 1)[::-1] for line in outcomes),
        )


def run_beside(names: tuple[str, ...], arguments: list[str], console: Console) -> list[Ended]:
    """Run lanes at the same time."""
    first, *others = names
    with ExitStack() as files, ThreadPoolExecutor(len(names)) as threads:
        said = [files.enter_context(tempfile.TemporaryFile()) for _ in others]
        console.rule(f"lane: {first}" + "".join(f", beside it: {name}" for name in others))
        going = [threads.submit(run, name, arguments, kept) for name, kept in zip(others, said, strict=True)]
        ended = [run(first, arguments)]
        for lane, name, kept in zip(going, others, said, strict=True):
            ended.append(lane.result())
            console.rule(f"lane: {name}")
            kept.seek(0)
            sys.stdout.write(kept.read().decode("utf-8", "replace"))
    return ended


def not_run_once(lanes: list[Ended]) -> list[str]:
    """Return what no lane ran, and what more than one did."""
    there = {test for lane in lanes for test in lane.there}
    ran = Counter(test for lane in lanes for test in lane.outcomes)
    return sorted(there.symmetric_difference(ran) | {test for test, times in ran.items() if times > 1})


def main() -> int:
    console = Console(width=None if sys.stdout.isatty() else 120, markup=False)
    lanes: list[Ended] = []
    for names in BESIDE:
        lanes += run_beside(names, sys.argv[1:], console)
    table = Table("lane", "tests", "failed", "time [s]", title=f"Python {sys.version.split()[0]}")
    for lane in lanes:
        table.add_row(lane.name, str(len(lane.outcomes)), str(lane.failed), f"{lane.seconds:.0f}")
    console.print(table)
    broken = [lane for lane in lanes if lane.code not in (0, 1)]
    for lane in broken:
        console.print(f"the lane {lane.name} did not come to its end: exit code {lane.code}")
    astray = [] if broken else not_run_once(lanes)
    for test in astray:
        console.print(f"not run once: {test}")
    failed = sum(lane.failed for lane in lanes)
    ran = sum(len(lane.outcomes) for lane in lanes)
    console.print(f"{ran - failed} passed, {failed} failed")
    return int(bool(broken or astray or failed or any(lane.code for lane in lanes)))


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


if __name__ == "__main__":
    sys.exit(main())
