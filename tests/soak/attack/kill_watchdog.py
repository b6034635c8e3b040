"""SIGKILL of the watchdog of the card, alone or followed by the loop: the remaining process must react."""

import tempfile
from pathlib import Path

import httpx
from rich.console import Console

from backend.realtime.heartbeat import LAST_RESORT_S, POLL_S
from tests.soak.attack.processes import WATCHDOG, kill, named
from tests.soak.attack.stop_button import StopButton, stop_and_check
from tests.soak.attack.tally import REPORTED_S, UNWATCHED_S, Tally
from tests.soak.attack.work import Accounts, be_moving, be_wound_up, must_be_well
from tests.soak.live_service import Bench, Loop, bench_on, wait_until

BOTH_DEAD_S = LAST_RESORT_S + 2.0 * POLL_S
"""From the death of both to zero volts and drives off, by the service: docs/reference/faults.md, ``watchdog_dead``."""

PATIENCE_S = 3.0
"""An unsafe output is looked at for so long [s]; it counts as broken long before."""


def kill_watchdog(times: int, console: Console) -> bool:
    """Kill the watchdog ``times`` times, every third time with the loop; return whether the outputs were safe."""
    tally = Tally("watchdog killed", console)
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder)) as bench:
        button, accounts = StopButton(bench), Accounts()
        for turn in range(times):
            loop = Loop(bench.service.pid)
            be_moving(bench, loop) if turn % 6 == 0 else be_wound_up(bench, loop)
            accounts.look(bench, tally)
            with_loop = turn % 3 == 2
            for watchdog in named(loop.pid, WATCHDOG):
                kill(watchdog)
            if with_loop:
                kill(loop.pid)
            elif turn % 3 == 1:
                stop_and_check(button, loop, tally)
            if with_loop:
                _must_be_safe(loop, tally, "watchdog and loop dead", BOTH_DEAD_S)
            else:
                _must_be_safe(loop, tally, "watchdog dead", UNWATCHED_S)
            _must_be_reported(bench, tally)
            _start_again(bench, tally)
            accounts.look(bench, tally)
            loop.close()
        button.release()
    return tally.close()


def _must_be_safe(loop: Loop, tally: Tally, what: str, within_s: float) -> None:
    """Wait for zero volts and disabled drives in the registers."""

    def safe() -> bool:
        card = loop.card.state()
        return not card.drive_enabled and (card.u_A, card.u_B) == (0.0, 0.0)

    try:
        tally.take(f"{what}: zero volts, drives off [s]", wait_until(safe, "safe", PATIENCE_S), within_s)
    except TimeoutError:
        card = loop.card.state()
        held = f"{card.u_A:.2f} V and {card.u_B:.2f} V, drives {'on' if card.drive_enabled else 'off'}"
        tally.lost(True, f"{what}: {held} after {PATIENCE_S:g} s")


def _must_be_reported(bench: Bench, tally: Tally) -> None:
    def told() -> bool:
        return not next(link["good"] for link in bench.state()["chain"] if link["name"] == "watchdog")

    try:
        tally.take("told after that [s]", wait_until(told, "told", PATIENCE_S), REPORTED_S)
    except TimeoutError:
        tally.lost(True, f"the chain calls a dead watchdog good after {PATIENCE_S:g} s")


def _start_again(bench: Bench, tally: Tally) -> None:
    if bench.state()["mode"] != "tripped":
        bench.client.post("/api/stop")
    try:
        bench.client.post("/api/reset").raise_for_status()
    except httpx.HTTPStatusError as error:
        tally.lost(True, f"reset after a dead watchdog: {error.response.text}")
    must_be_well(bench, tally, "reset")
