"""The wall clock jumps under a running service: sessions continue, STOP works, the recording has no gap.

The clock of the machine is unchanged: a preloaded library shifts the clock of the service and its loop.
"""

import os
import shutil
import struct
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console

from tests.soak.attack.stop_button import StopButton, stop_and_check
from tests.soak.attack.tally import Tally
from tests.soak.attack.work import Accounts, be_moving
from tests.soak.live_service import Bench, Loop, bench_on

SOURCE = Path(__file__).with_name("shifted_clock.c")
HOUR_S, DAY_S = 3600, 86_400
JUMPS = {
    "an hour back": -HOUR_S,
    "a day on": DAY_S,
    "40 days on": 40 * DAY_S,
    "10 years back": -3650 * DAY_S,
}
"""By how much the clock is off then [s]."""

WATCHED_S = 2.0


class ShiftedClock:
    """The clock of processes with the preloaded library."""

    def __init__(self, folder: Path) -> None:
        gcc = shutil.which("gcc")
        if gcc is None:
            raise FileNotFoundError("gcc is not installed: apt-get install gcc")
        self._library, self._file = folder / "shifted_clock.so", folder / "shift"
        flags = ["-std=c11", "-O1", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
        subprocess.run([gcc, *flags, "-o", self._library, SOURCE, "-ldl"], check=True)
        self._file.write_bytes(struct.pack("q", 0))

    def shift(self, seconds: int) -> None:
        """Shift the clock relative to the real one."""
        with self._file.open("r+b") as file:
            file.write(struct.pack("q", seconds))

    @contextmanager
    def preloaded(self) -> Iterator[None]:
        """Preload the library into processes that start in the block."""
        added = {"LD_PRELOAD": str(self._library), "SHIFTED_CLOCK": str(self._file)}
        os.environ.update(added)
        try:
            yield
        finally:
            for name in added:
                del os.environ[name]


def move_clock(times: int, console: Console) -> bool:
    """Let the clock jump forwards and backwards, ``times`` times each."""
    tally = Tally("clock moved", console)
    with tempfile.TemporaryDirectory() as folder:
        clock = ShiftedClock(Path(folder))
        with clock.preloaded():
            service = bench_on(Path(folder) / "data")
            bench = service.__enter__()
        try:
            button, loop = StopButton(bench), Loop(bench.service.pid)
            for _ in range(times):
                for name, shift in JUMPS.items():
                    run = be_moving(bench, loop)
                    clock.shift(shift)
                    _jump(bench, loop, button, tally, name)
                    clock.shift(0)
                    _must_be_recorded(bench, tally, run, name)
            button.release()
            loop.close()
        finally:
            service.__exit__(None, None, None)
    return tally.close()


def _jump(bench: Bench, loop: Loop, button: StopButton, tally: Tally, name: str) -> None:
    """Check a run that begins with the real clock and ends with the wrong one."""
    time.sleep(WATCHED_S)
    tally.lost(bench.state()["fault"] is not None, f"{name}: {bench.state()['fault']}")
    answered = button.get("/api/state")
    tally.lost(answered != 200, f"{name}: the page that was signed in is answered {answered}")
    stop_and_check(button, loop, tally)


def _must_be_recorded(bench: Bench, tally: Tally, run: int, name: str) -> None:
    accounts = Accounts()
    accounts.must_end_as(bench, tally, run, "stopped")
    accounts.look(bench, tally)
    recorded_s = bench.client.get(f"/api/runs/{run}").json()["duration_s"]
    tally.lost(not recorded_s > WATCHED_S, f"{name}: {recorded_s} s recorded")
