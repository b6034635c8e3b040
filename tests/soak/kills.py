"""Kill the service and the loop with -9, again and again, while the joint moves; count what gets lost."""

import os
import select
import signal
import tempfile
import time
from pathlib import Path

import numpy as np
from rich.console import Console

from backend.faults import FAULT_CODE, Fault
from backend.sample import INDEX
from backend.storage import open_database, recordings
from plant.card import WATCHDOG_S
from tests.soak.live_service import Bench, Loop, bench_on, wait_until

BRAKED_TICKS = 500
MOVING = 0.5
"""Joint speed at which to kill [rad/s]."""

BEHIND_TICKS = 1300
"""How far the recording may be behind the loop: a chunk of a second, and the recorder's quarter."""


def kill_service(times: int, console: Console) -> bool:
    """Kill the service ``times`` times; whether nothing was lost in any."""
    losses = 0
    latched_ms, braked = [], []
    with tempfile.TemporaryDirectory() as folder:
        data, killed = Path(folder), 0
        for turn in range(times):
            with bench_on(data) as bench:
                if killed:
                    end_state = bench.client.get(f"/api/runs/{killed}").json()["end_state"]
                    losses += _lost(end_state != "service_died", console, f"run {killed} is listed as {end_state}")
                loop = Loop(bench.service.pid)
                killed = bench.run()
                _move(bench, loop, turn)
                at = loop.ring.count
                os.kill(bench.service.pid, signal.SIGKILL)
                if not select.select([loop.ended], [], [], 30.0)[0]:
                    losses += _lost(True, console, "the loop process outlived its service")
                    continue
            _, rows, _ = loop.ring.read(max(0, at - 1), 10_000)
            fault, q_dot = rows[:, INDEX["fault"]], np.abs(rows[:, INDEX["q_dot"]])
            latched_ms.append(int(np.argmax(fault == FAULT_CODE[Fault.SERVICE_LOST])))
            braked.append(q_dot[BRAKED_TICKS:].max() / q_dot[0])
            volts = np.abs(rows[-1, [INDEX["u_A"], INDEX["u_B"]]]).max()
            losses += _lost(fault[-1] != FAULT_CODE[Fault.SERVICE_LOST], console, "no fault was latched")
            losses += _lost(latched_ms[-1] > BRAKED_TICKS, console, f"latched after {latched_ms[-1]} ms")
            losses += _lost(braked[-1] > 0.05, console, f"{100 * braked[-1]:.1f} % of the speed after 0.5 s")
            losses += _lost(volts != 0.0, console, f"{volts:.2f} V at the end")
            losses += _lost(_recording_lacks(data, killed, at), console, f"run {killed}: the recording lacks samples")
            loop.close()
    console.print(
        f"service killed {times} times: latched {max(latched_ms)} ms after at most, "
        f"{100 * max(braked):.1f} % of the speed left after 0.5 s at most, {losses} losses"
    )
    return losses == 0


def kill_loop(times: int, console: Console) -> bool:
    """Kill the loop process ``times`` times under one service; whether it was told and replaced each time."""
    losses, told_s, zero_s = 0, [], []
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder)) as bench:
        for turn in range(times):
            loop = Loop(bench.service.pid)
            run = bench.run()
            _move(bench, loop, turn)
            os.kill(loop.pid, signal.SIGKILL)
            killed_at = time.monotonic()
            held = loop.card.state()
            losses += _lost(held.u_A == 0.0, console, "the card let go by itself")
            wait_until(lambda: not bench.client.get("/api/health").json()["alive"], "told")
            told_s.append(time.monotonic() - killed_at)
            wait_until(lambda loop=loop: loop.card.state().expired, "watchdog")
            zero_s.append(time.monotonic() - killed_at)
            state = loop.card.state()
            losses += _lost((state.u_A, state.u_B) != (0.0, 0.0), console, "volts after the watchdog")
            losses += _lost(told_s[-1] > 1.0, console, f"told after {told_s[-1]:.2f} s")
            losses += _lost(zero_s[-1] > 2.0 * WATCHDOG_S, console, f"zero volts after {zero_s[-1]:.2f} s")
            losses += _lost(_end_state(bench, run) != "link_lost", console, f"run {run}: {_end_state(bench, run)}")
            bench.client.post("/api/reset").raise_for_status()
            loop.close()
    console.print(
        f"loop killed {times} times: told after {max(told_s):.2f} s at most, zero volts by the watchdog after "
        f"{max(zero_s):.2f} s at most, {losses} losses"
    )
    return losses == 0


def _move(bench: Bench, loop: Loop, turn: int) -> None:
    """Wait until something of the run has been stored, then until the joint moves."""
    begun = loop.ring.count
    wait_until(lambda: loop.ring.count > begun + 2 * BEHIND_TICKS, "recording")
    bench.step(1.2 if turn % 2 else -1.2)
    wait_until(lambda: abs(loop.newest("q_dot")) > MOVING, "motion")


def _end_state(bench: Bench, run: int) -> str:
    def ended() -> bool:
        return bool(bench.client.get(f"/api/runs/{run}").json()["end_state"] != "running")

    wait_until(ended, f"end of run {run}")
    return str(bench.client.get(f"/api/runs/{run}").json()["end_state"])


def _recording_lacks(data: Path, run: int, at: int) -> bool:
    """Whether a run's recording has gaps, or ends earlier than the last second before tick ``at``."""
    database = open_database(data)
    with database.reading() as session:
        extent, missed = recordings.extent(session, run), recordings.get(session, run).missed
    database.close()
    return missed > 0 or extent.count != extent.end_tick - extent.first_tick or extent.end_tick < at - BEHIND_TICKS


def _lost(is_lost: bool, console: Console, what: str) -> int:
    if is_lost:
        console.print(f"LOST: {what}")
    return int(is_lost)
