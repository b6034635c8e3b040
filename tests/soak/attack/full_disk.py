"""The disk fills up during a run and is cleared: reported, STOP works, pending data are written."""

import tempfile
import time
from pathlib import Path

from rich.console import Console

from tests.soak.attack.isolation import mount_small, unmount
from tests.soak.attack.stop_button import StopButton, stop_and_check
from tests.soak.attack.tally import Tally
from tests.soak.attack.work import Accounts, be_moving, must_be_well
from tests.soak.live_service import Bench, Loop, bench_on, wait_until

DISK_MB = 48
FULL_REPORTED_S = 15.0
"""A disk that is full is told within so long [s]: a chunk of a second, and what the database waits for."""

FULL_S = 6.0
AGAIN_S = 30.0


def fill_disk(times: int, console: Console) -> bool:
    """Fill the disk of the data folder ``times`` times."""
    tally = Tally("disk full", console)
    with tempfile.TemporaryDirectory() as folder, tempfile.TemporaryDirectory() as elsewhere:
        mount_small(folder, DISK_MB)
        try:
            with bench_on(Path(folder) / "data", Path(elsewhere) / "log") as bench:
                button, loop, accounts = StopButton(bench), Loop(bench.service.pid), Accounts()
                for turn in range(times):
                    _fill(bench, loop, button, accounts, tally, Path(folder) / "filler", stops=turn % 2 == 0)
                button.release()
                loop.close()
        finally:
            unmount(folder)
    return tally.close()


def _fill(
    bench: Bench, loop: Loop, button: StopButton, accounts: Accounts, tally: Tally, filler: Path, *, stops: bool
) -> None:
    """Fill the disk during a run; with ``stops`` the run ends while the disk is full, otherwise afterwards."""
    run = be_moving(bench, loop)
    accounts.look(bench, tally)
    _write_until_full(filler)
    begun = time.monotonic()
    try:
        wait_until(lambda: _says(bench, "stored"), "told", 60.0)
        tally.take("told [s]", time.monotonic() - begun, FULL_REPORTED_S)
    except TimeoutError:
        tally.lost(True, "a full disk is not told")
    if stops:
        stop_and_check(button, loop, tally)
        bench.client.post("/api/reset").raise_for_status()
    time.sleep(FULL_S)
    filler.unlink()
    freed = time.monotonic()
    wait_until(lambda: not _says(bench, "stored"), "writing again", 60.0)
    tally.take("writing again [s]", time.monotonic() - freed, AGAIN_S)
    if not stops:
        time.sleep(2.0)
        stop_and_check(button, loop, tally)
    accounts.must_end_as(bench, tally, run, "stopped")
    accounts.look(bench, tally)
    _must_tell_of_stop(bench, tally, run)
    must_be_well(bench, tally, "a full disk")


def _must_tell_of_stop(bench: Bench, tally: Tally, run: int) -> None:
    """Check that the marks of the run contain the events during the full disk."""

    def texts() -> list[str]:
        marks = bench.client.get(f"/api/runs/{run}/marks").raise_for_status().json()["marks"]
        return [mark["text"] for mark in marks]

    try:
        wait_until(lambda: any("STOP" in text for text in texts()), "mark of STOP", AGAIN_S)
    except TimeoutError:
        tally.lost(True, f"no mark of STOP in run {run}: {texts()[-5:]}")


def _says(bench: Bench, word: str) -> bool:
    return any(word in problem for problem in bench.state()["problems"])


def _write_until_full(filler: Path) -> None:
    with filler.open("wb", buffering=0) as file:
        for size in (1 << 20, 1 << 12, 1):
            try:
                while True:
                    file.write(bytes(size))
            except OSError:
                continue
