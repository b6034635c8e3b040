"""SIGKILL of the service during motion; the loop stops by itself, and the next service recovers all data."""

import select
import tempfile
from pathlib import Path

import numpy as np
from rich.console import Console

from backend.faults import FAULT_CODE, Fault
from backend.sample import INDEX
from backend.storage import recordings
from backend.storage.database import open_database
from tests.docs.faults_page import documented_ms
from tests.soak.attack.processes import descendants, is_there, kill
from tests.soak.attack.stop_button import StopButton, stop_and_check, wind_up
from tests.soak.attack.tally import Tally
from tests.soak.attack.work import Accounts, be_moving
from tests.soak.live_service import Bench, Loop, bench_on, wait_until

BRAKED_TICKS = 500
STANDING = 0.05
"""What may be left of the joint's speed after BRAKED_TICKS."""

BEHIND_TICKS = 1300
"""How far the recording may be behind the loop: a chunk of a second, and the recorder's quarter."""

GONE_S = 10.0


def kill_service(times: int, console: Console) -> bool:
    """Kill the service ``times`` times; return whether no data were lost."""
    tally = Tally("service killed", console)
    accounts = Accounts()
    with tempfile.TemporaryDirectory() as folder:
        data, killed = Path(folder), 0
        for turn in range(times):
            with bench_on(data) as bench:
                _must_have_data(bench, accounts, tally, killed)
                loop = Loop(bench.service.pid)
                killed = be_moving(bench, loop, 1.0 if turn % 2 else -1.0)
                accounts.look(bench, tally)
                below = descendants(bench.service.pid)
                at = loop.ring.count
                kill(bench.service.pid)
                if not select.select([loop.ended], [], [], 30.0)[0]:
                    tally.lost(True, "the loop process outlived its service")
                    kill(loop.pid)
            _must_have_stopped(loop, at, tally)
            tally.lost(_recording_lacks(data, killed, at), f"run {killed}: the recording lacks samples")
            _must_be_gone(below, tally)
            loop.close()
        with bench_on(data) as bench:
            _must_have_data(bench, accounts, tally, killed)
    return tally.close()


def _must_have_data(bench: Bench, accounts: Accounts, tally: Tally, killed: int) -> None:
    """Check that the service after a kill has all stored data, and that STOP works."""
    if not killed:
        return
    accounts.look(bench, tally)
    accounts.must_end_as(bench, tally, killed, "service_died")
    loop, button = Loop(bench.service.pid), StopButton(bench)
    wind_up(bench, loop)
    stop_and_check(button, loop, tally, what="STOP after a new start")
    button.release()
    loop.close()


def _must_have_stopped(loop: Loop, at: int, tally: Tally) -> None:
    """Check the reaction of the loop to the missing service in its own samples."""
    _, rows, _ = loop.ring.read(max(0, at - 1), 10_000)
    fault, q_dot = rows[:, INDEX["fault"]], np.abs(rows[:, INDEX["q_dot"]])
    tally.lost(fault[-1] != FAULT_CODE[Fault.SERVICE_LOST], "no fault was latched")
    latched_ms = float(np.argmax(fault == FAULT_CODE[Fault.SERVICE_LOST]))
    tally.take("latched [ms]", latched_ms, documented_ms(Fault.SERVICE_LOST))
    tally.take("speed left after 0.5 s [%]", 100.0 * q_dot[BRAKED_TICKS:].max() / q_dot[0], 100.0 * STANDING)
    volts = np.abs(rows[:, [INDEX["u_A"], INDEX["u_B"]]]).max(axis=1)
    tally.take("zero volts [s]", float(np.flatnonzero(volts > 0.0).max(initial=0)) * 1e-3, 2.5)
    card = loop.card.state()
    tally.lost((card.u_A, card.u_B) != (0.0, 0.0) or card.drive_enabled, "volts or drives on after the loop's end")


def _must_be_gone(below: list[int], tally: Tally) -> None:
    """Wait until all child processes of the service have ended."""
    try:
        wait_until(lambda: not any(map(is_there, below)), "end of all processes", GONE_S)
    except TimeoutError:
        left = [Path(f"/proc/{pid}/cmdline").read_bytes().replace(b"\0", b" ") for pid in below if is_there(pid)]
        tally.lost(True, f"outlived the service: {left}")


def _recording_lacks(data: Path, run: int, at: int) -> bool:
    """Return whether a recording has gaps, or ends more than a second before tick ``at``."""
    database = open_database(data)
    with database.reading() as session:
        extent, missed = recordings.extent(session, run), recordings.get(session, run).missed
    database.close()
    return missed > 0 or extent.count != extent.end_tick - extent.first_tick or extent.end_tick < at - BEHIND_TICKS
