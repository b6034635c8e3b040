"""SIGKILL of the loop at rest, under voltage, in motion or during a run; watchdog and service take over."""

import tempfile
from collections.abc import Sequence
from pathlib import Path

import httpx
from rich.console import Console

from tests.soak.attack.processes import kill
from tests.soak.attack.stop_button import StopButton
from tests.soak.attack.tally import REPORTED_S, STOP_S, ZERO_S, Tally
from tests.soak.attack.work import OCCUPATIONS, Accounts, Flights, must_be_well
from tests.soak.live_service import Bench, Loop, bench_on, wait_until


def kill_loop(times: int, console: Console) -> bool:
    """Kill the loop ``times`` times under one service; return whether it was reported, safe and replaced."""
    return _kill("loop killed", ("simulator",), times, console)


def kill_card_loop(times: int, console: Console) -> bool:
    """Do the same with a loop that drives the virtual card through NI-DAQmx."""
    return _kill("loop killed on the virtual card", ("rig", "--virtual-card"), times, console)


def _kill(what: str, plant: Sequence[str], times: int, console: Console) -> bool:
    tally = Tally(what, console)
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder), plant=plant) as bench:
        button, accounts, flights = StopButton(bench), Accounts(), Flights(bench, "loop_died")
        for turn in range(times):
            name = list(OCCUPATIONS)[turn % len(OCCUPATIONS)]
            loop = Loop(bench.service.pid)
            run = OCCUPATIONS[name](bench, loop)
            accounts.look(bench, tally)
            kill(loop.pid)
            _after(bench, loop, button, tally)
            accounts.must_end_as(bench, tally, run, "link_lost")
            flights.must_grow_by_one(tally, f"kill {turn + 1}, {name}")
            _start_again(bench, tally)
            accounts.look(bench, tally)
            loop.close()
        button.release()
    return tally.close()


def _after(bench: Bench, loop: Loop, button: StopButton, tally: Tally) -> None:
    """Press STOP immediately: the response must state that it is unconfirmed. Then wait for the new loop."""
    press = button.press()
    tally.take("STOP refused [s]", press.latency_s, STOP_S)
    tally.lost(press.status != 503, f"STOP without a loop answered {press.status}")
    zero_s = press.latency_s + wait_until(lambda: _safe(loop), "zero volts, drives off", 10.0)
    tally.take("zero volts, drives off [s]", zero_s, ZERO_S)
    told_s = wait_until(lambda: not bench.client.get("/api/health").json()["alive"], "told")
    tally.take("told [s]", told_s + zero_s, REPORTED_S)


def _safe(loop: Loop) -> bool:
    card = loop.card.state()
    return not card.drive_enabled and (card.u_A, card.u_B) == (0.0, 0.0)


def _start_again(bench: Bench, tally: Tally) -> None:
    try:
        bench.client.post("/api/reset").raise_for_status()
    except httpx.HTTPStatusError as error:
        tally.lost(True, f"no new loop: {error.response.text}")
    must_be_well(bench, tally, "the new start")
