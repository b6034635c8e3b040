"""SIGSTOP: each process is suspended and continued; its monitor has reacted in the meantime."""

import os
import signal
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path

import numpy as np
from rich.console import Console

from backend.faults import FAULT_CODE, Fault
from backend.sample import INDEX
from tests.docs.faults_page import documented_ms
from tests.soak.attack.kill_pool import DONE_S
from tests.soak.attack.processes import WATCHDOG, named, pool_workers
from tests.soak.attack.stop_button import StopButton, stop_and_check, wind_up
from tests.soak.attack.tally import STOP_S, UNWATCHED_S, ZERO_S, Tally
from tests.soak.attack.work import Accounts, be_moving, must_be_well, sequence
from tests.soak.live_service import Bench, Loop, bench_on, wait_until

SERVICE_S, WATCHDOG_S, POOL_S = 3.0, 1.0, 3.0
LOOP_SHORT_S, LOOP_LONG_S = 0.6, 1.0
"""The watchdog cuts in both; in the longer one the service gives the loop up and kills it."""


def freeze(times: int, console: Console) -> bool:
    """Suspend each process ``times`` times; return whether the outputs were safe in time and all recovered."""
    tally = Tally("frozen", console)
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder)) as bench:
        accounts, button = Accounts(), StopButton(bench)
        for _ in range(times):
            for attack in (_service, _loop_shortly, _loop_for_long, _watchdog, _pool_worker):
                loop = Loop(bench.service.pid)
                attack(bench, loop, button, tally)
                _rest(bench)
                must_be_well(bench, tally, attack.__name__.strip("_"))
                accounts.look(bench, tally)
                loop.close()
        button.release()
    return tally.close()


def _rest(bench: Bench) -> None:
    """Reset; without a control loop this starts another one."""
    if bench.client.get("/api/health").json()["alive"] and bench.state()["mode"] != "tripped":
        bench.client.post("/api/stop").raise_for_status()
    bench.client.post("/api/reset").raise_for_status()


def _service(bench: Bench, loop: Loop, button: StopButton, tally: Tally) -> None:
    run, at = be_moving(bench, loop), loop.ring.count
    with ThreadPoolExecutor(1) as pressing:
        _stand_still(bench.service.pid, SERVICE_S / 2)
        pressed = pressing.submit(button.press)
        time.sleep(SERVICE_S / 2)
        os.kill(bench.service.pid, signal.SIGCONT)
        went_on = time.monotonic()
        press = pressed.result()
        tally.take("STOP answered after the service goes on [s]", time.monotonic() - went_on, STOP_S)
    tally.lost(press.status != 200, f"STOP to a service that went on answered {press.status}")
    _, rows, _ = loop.ring.read(at - 1, 10_000)
    latched = np.argmax(rows[:, INDEX["fault"]] == FAULT_CODE[Fault.SERVICE_LOST])
    tally.take("service: latched [ms]", float(latched), documented_ms(Fault.SERVICE_LOST))
    tally.lost(latched == 0, "service: the loop did not latch")
    Accounts().must_end_as(bench, tally, run, "service_died")


def _loop_shortly(bench: Bench, loop: Loop, button: StopButton, tally: Tally) -> None:
    _loop(bench, loop, tally, LOOP_SHORT_S)
    wait_until(lambda: bench.state()["mode"] == "tripped", "trip", 5.0)
    tally.lost(bench.state()["fault"]["code"] != "watchdog", f"latched: {bench.state()['fault']}")
    tally.lost(not bench.client.get("/api/health").json()["alive"], "the loop was given up after 0.6 s")
    stop_and_check(button, loop, tally, what="STOP after the loop went on")


def _loop_for_long(bench: Bench, loop: Loop, _button: StopButton, tally: Tally) -> None:
    _loop(bench, loop, tally, LOOP_LONG_S)
    wait_until(lambda: not bench.client.get("/api/health").json()["alive"], "the loop given up", 5.0)


def _loop(bench: Bench, loop: Loop, tally: Tally, seconds: float) -> None:
    wind_up(bench, loop)
    begun = time.monotonic()
    os.kill(loop.pid, signal.SIGSTOP)
    try:
        wait_until(lambda: not loop.card.state().drive_enabled, "drives off", 5.0)
        tally.take("loop: zero volts, drives off [s]", time.monotonic() - begun, ZERO_S)
        time.sleep(max(0.0, seconds - (time.monotonic() - begun)))
    finally:
        with suppress(ProcessLookupError):  # detected as lost and killed in the meantime
            os.kill(loop.pid, signal.SIGCONT)


def _watchdog(bench: Bench, loop: Loop, button: StopButton, tally: Tally) -> None:
    wind_up(bench, loop)
    (watchdog,) = named(loop.pid, WATCHDOG)
    begun = time.monotonic()
    os.kill(watchdog, signal.SIGSTOP)
    try:
        wait_until(lambda: not loop.card.state().drive_enabled, "drives off", WATCHDOG_S)
        tally.take("watchdog: zero volts, drives off [s]", time.monotonic() - begun, UNWATCHED_S)
        stop_and_check(button, loop, tally)
    except TimeoutError:
        tally.lost(True, f"a watchdog that stood still for {WATCHDOG_S:g} s was not seen")
    finally:
        with suppress(ProcessLookupError):
            os.kill(watchdog, signal.SIGCONT)


def _pool_worker(bench: Bench, loop: Loop, button: StopButton, tally: Tally) -> None:
    wind_up(bench, loop)
    with ThreadPoolExecutor(1) as asking:
        before = {worker.pid for worker in pool_workers(bench.service.pid)}
        answer = asking.submit(bench.client.post, "/api/experiments/dry-run", json=sequence(30, 30), timeout=DONE_S)
        time.sleep(0.3)
        workers = {worker.pid for worker in pool_workers(bench.service.pid)} | before
        for worker in workers:
            os.kill(worker, signal.SIGSTOP)
        try:
            stop_and_check(button, loop, tally, what="STOP while the pools stand still")
            time.sleep(POOL_S)
        finally:
            for worker in workers:
                os.kill(worker, signal.SIGCONT)
        status = answer.result().status_code
    tally.lost(status != 200, f"the dry run of a worker that stood still answered {status}")


def _stand_still(pid: int, seconds: float) -> None:
    os.kill(pid, signal.SIGSTOP)
    time.sleep(seconds)
