"""``python -m tests.lanes [PYTEST ARGUMENT ...]``: all tests, each in one of the lanes; told how long each lane took.

The pages are tried in a browser, then what is live, one lane after the other: a browser and a service that share two
slow cores with a second pair of them wait for each other for longer than a person would. They wait for clocks and
motions half of the time: what only computes runs in that time, as idle work, which the kernel takes off a core in the
moment something else wants it.
`tests/conftest.py` says which is which. With ``--beside COMMAND`` a command runs beside them too, as the tests of the
page without a browser do; with ``--then COMMAND`` after the live ones, while what computes goes on. At the end the
tests that were run are counted against those there are: a test that no lane runs is a failure.
"""

import argparse
import os
import shlex
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

from tests.tiers import renamed

ROOT = Path(__file__).parents[1]
COMPUTING = (os.cpu_count() or 1) + 1
"""Processes: one more than cores, for what waits a moment in a test that computes."""

LANES = {
    "page": ("-m", "page", "-p", "no:xdist", "-p", "no:schemathesis"),
    "live": ("-m", "live and not page", "-p", "no:xdist"),
    "pure": ("-m", "not live", "-n", str(COMPUTING), "--dist", "worksteal", "-p", "no:schemathesis", "--durations=60"),
}
"""Worksteal leaves the tests of a file beside each other, in the process that has what they share. Schemathesis, which
takes a process seconds to load, makes requests to a live service only."""

IN_TURN, BESIDE = ("page", "live"), "pure"
"""What runs one after the other, and what runs beside all of it and is shown at the end."""

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


@dataclass(frozen=True)
class Command:
    """A command that ran with the lanes, at its end."""

    words: str
    code: int
    seconds: float


def run_command(words: str, said: IO[bytes] | None = None) -> Command:
    """Run it, its output as it comes; or as idle work, its output into ``said``."""
    begun = time.monotonic()
    with subprocess.Popen(shlex.split(words), cwd=ROOT, stdout=said, stderr=said) as process:
        if said is not None:
            _as_idle_work(process)
    return Command(words, process.returncode, time.monotonic() - begun)


def run_all(arguments: list[str], then: list[str], console: Console) -> tuple[list[Ended], list[Command]]:
    """Run the lanes one after the other and then these commands, and beside them all what only computes."""
    with tempfile.TemporaryFile() as said, ThreadPoolExecutor(1) as threads:
        computing = threads.submit(run, BESIDE, arguments, said)
        lanes, commands = [], []
        for name in IN_TURN:
            console.rule(f"lane: {name}")
            lanes.append(run(name, arguments))
        for words in then:
            console.rule(words)
            commands.append(run_command(words))
        console.rule(f"lane: {BESIDE}, beside the others")
        lanes.append(computing.result())
        _show(said)
    return lanes, commands


def not_run_once(lanes: list[Ended]) -> list[str]:
    """Return what no lane ran, and what more than one did."""
    there = {test for lane in lanes for test in lane.there}
    ran = Counter(test for lane in lanes for test in lane.outcomes)
    return sorted(there.symmetric_difference(ran) | {test for test, times in ran.items() if times > 1})


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.lanes", description=__doc__, allow_abbrev=False)
    parser.add_argument("--beside", action="append", default=[], metavar="COMMAND", help="what runs beside the lanes")
    parser.add_argument("--then", action="append", default=[], metavar="COMMAND", help="what runs after the live ones")
    given, arguments = parser.parse_known_args()
    console = Console(width=None if sys.stdout.isatty() else 120, markup=False)
    with ExitStack() as files, ThreadPoolExecutor(len(given.beside) or 1) as threads:
        beside = [(words, files.enter_context(tempfile.TemporaryFile())) for words in given.beside]
        running = [threads.submit(run_command, words, said) for words, said in beside]
        lanes, commands = run_all(arguments, given.then, console)
        for (words, said), companion in zip(beside, running, strict=True):
            commands.append(companion.result())
            console.rule(f"{words}, beside the lanes")
            _show(said)
    table = Table("lane", "tests", "failed", "time [s]", title=f"Python {sys.version.split()[0]}")
    for lane in lanes:
        table.add_row(lane.name, str(len(lane.outcomes)), str(lane.failed), f"{lane.seconds:.0f}")
    for command in commands:
        words = " ".join(shlex.split(command.words)[:2])
        table.add_row(words, "", "yes" if command.code else "no", f"{command.seconds:.0f}")
    console.print(table)
    broken = [lane for lane in lanes if lane.code not in (0, 1)]
    for lane in broken:
        console.print(f"the lane {lane.name} did not come to its end: exit code {lane.code}")
    astray = [] if broken else not_run_once(lanes)
    for test in astray:
        console.print(f"not run once: {test}")
    unknown = renamed({test for lane in lanes for test in lane.there}) if "--thorough" in arguments else []
    for test in unknown:
        console.print(f"named in thorough.toml, but no longer there: {test}")
    failed = sum(lane.failed for lane in lanes)
    ran = sum(len(lane.outcomes) for lane in lanes)
    console.print(f"{ran - failed} passed, {failed} failed")
    wrong = [command for command in commands if command.code]
    for command in wrong:
        console.print(f"failed, see above: {command.words}")
    return int(bool(broken or astray or unknown or failed or wrong or any(lane.code for lane in lanes)))


def _as_idle_work(process: subprocess.Popen[bytes]) -> None:
    os.sched_setscheduler(process.pid, os.SCHED_IDLE, os.sched_param(0))


def _show(said: IO[bytes]) -> None:
    said.seek(0)
    sys.stdout.write(said.read().decode("utf-8", "replace"))


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


if __name__ == "__main__":
    sys.exit(main())
