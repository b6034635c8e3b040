"""``python -m tests.lanes [PYTEST ARGUMENT ...]``: all tests, each in one of the lanes; told how long each lane took.

The pages are tried in a browser, then what is live, one lane after the other: a browser and a service that share two
slow cores with a second pair of them wait for each other for longer than a person would. They wait for clocks and
motions half of the time: what only computes runs in that time, as idle work, which the kernel takes off a core in the
moment something else wants it.
`tests/conftest.py` says which is which. With ``--front-end`` the tests of the page without a browser run beside them
too. At the end the tests that were run are counted against those there are: a test
that no lane runs is a failure.
"""

import os
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import pytest
from rich.console import Console
from rich.table import Table

from tests.tiers import renamed

ROOT = Path(__file__).parents[1]
COMPUTING = (os.cpu_count() or 1) + 1
"""Processes: one more than cores, for what waits a moment in a test that computes."""

LANES = {
    "page": ("-m", "page", "-p", "no:xdist", "-p", "no:schemathesis"),
    "live": ("-m", "live and not page", "-p", "no:xdist"),
    "pure": ("-m", "not live", "-n", str(COMPUTING), "--dist", "worksteal", "-p", "no:schemathesis"),
}
"""Worksteal leaves the tests of a file beside each other, in the process that has what they share. Schemathesis, which
takes a process seconds to load, makes requests to a live service only."""

IN_TURN, BESIDE = ("page", "live"), "pure"
"""What runs one after the other, and what runs beside all of it and is shown at the end."""

FRONT_END = "--front-end"
PAGE_ALONE = (sys.executable, "frontend/build.py", "test")

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
            if name == BESIDE:
                _as_idle_work(process)
        there, outcomes = (_lines(Path(folder) / kept) for kept in ("there", "outcomes"))
        return Ended(
            name,
            0 if process.returncode == NO_TESTS else process.returncode,
            time.monotonic() - begun,
            there,
            dict(line.split(" ", 1)[::-1] for line in outcomes),
        )


def run_front_end(said: IO[bytes]) -> int:
    """Run the tests of the page that need no browser, and return their exit code; they are counted by themselves."""
    with subprocess.Popen(PAGE_ALONE, cwd=ROOT, stdout=said, stderr=said) as process:
        _as_idle_work(process)
        return process.wait()


def run_all(arguments: list[str], console: Console) -> list[Ended]:
    """Run the lanes one after the other, and beside them all what only computes."""
    with tempfile.TemporaryFile() as said, ThreadPoolExecutor(1) as threads:
        computing = threads.submit(run, BESIDE, arguments, said)
        ended = []
        for name in IN_TURN:
            console.rule(f"lane: {name}")
            ended.append(run(name, arguments))
        console.rule(f"lane: {BESIDE}, beside the others")
        ended.append(computing.result())
        _show(said)
    return ended


def not_run_once(lanes: list[Ended]) -> list[str]:
    """Return what no lane ran, and what more than one did."""
    there = {test for lane in lanes for test in lane.there}
    ran = Counter(test for lane in lanes for test in lane.outcomes)
    return sorted(there.symmetric_difference(ran) | {test for test, times in ran.items() if times > 1})


def main() -> int:
    console = Console(width=None if sys.stdout.isatty() else 120, markup=False)
    arguments = [argument for argument in sys.argv[1:] if argument != FRONT_END]
    with tempfile.TemporaryFile() as said, ThreadPoolExecutor(1) as threads:
        page_alone = threads.submit(run_front_end, said) if FRONT_END in sys.argv else None
        lanes = run_all(arguments, console)
        page_failed = bool(page_alone and page_alone.result())
        if page_alone:
            console.rule("the page without a browser, beside the others")
            _show(said)
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
    unknown = renamed({test for lane in lanes for test in lane.there}) if "--thorough" in sys.argv else []
    for test in unknown:
        console.print(f"named in thorough.toml, but no longer there: {test}")
    failed = sum(lane.failed for lane in lanes)
    ran = sum(len(lane.outcomes) for lane in lanes)
    console.print(f"{ran - failed} passed, {failed} failed")
    if page_failed:
        console.print("tests of the page without a browser failed: see above")
    return int(bool(broken or astray or unknown or failed or page_failed or any(lane.code for lane in lanes)))


def _as_idle_work(process: subprocess.Popen[bytes]) -> None:
    os.sched_setscheduler(process.pid, os.SCHED_IDLE, os.sched_param(0))


def _show(said: IO[bytes]) -> None:
    said.seek(0)
    sys.stdout.write(said.read().decode("utf-8", "replace"))


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


if __name__ == "__main__":
    sys.exit(main())
