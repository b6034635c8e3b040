"""SIGKILL of worker processes during a dry run, a report, an export, an evaluation, or at rest."""

import random
import tempfile
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import httpx
from rich.console import Console

from backend.supervision import MAX_RESTART_DELAY_S, STABLE_AFTER_S
from tests.soak.attack.processes import Busy, is_there, kill, pool_workers
from tests.soak.attack.stop_button import StopButton, stop_and_check, wind_up
from tests.soak.attack.tally import Tally
from tests.soak.attack.work import Accounts, be_off, must_be_well, sequence
from tests.soak.live_service import Bench, Loop, bench_on, wait_until

BUSY_S = 0.01
"""A worker that has computed for so long [s] since it was asked is at work: the least that the kernel counts."""

LATER_S = 0.6
"""The kill comes by chance up to so long [s] after the work began."""

DONE_S = 240.0
"""Work of a pool gives way to all else: on a machine with other work it takes minutes."""

REPORTED_FOR_S = MAX_RESTART_DELAY_S + STABLE_AFTER_S + 10.0
"""Deaths are told for so long [s] at most, and no longer."""

SEED = 20


class Pools:
    """The worker processes of one service."""

    def __init__(self, service: int) -> None:
        self._service = service
        self._chance = random.Random(SEED)

    @contextmanager
    def killed_at_work(self) -> Iterator[Callable[[], bool]]:
        """Start work in the block, then call the yielded function: it kills the worker of this work, if any."""
        before = dict(pool_workers(self._service))

        def kill_it() -> bool:
            def busiest() -> Busy:
                grown = (Busy(pid, cpu_s - before.get(pid, 0.0)) for pid, cpu_s in pool_workers(self._service))
                return max(grown, key=lambda worker: worker.cpu_s, default=Busy(0, 0.0))

            try:
                wait_until(lambda: busiest().cpu_s > BUSY_S / 2, "a worker at work", 20.0)
            except TimeoutError:
                return False
            time.sleep(self._chance.uniform(0.0, LATER_S))
            worker = busiest().pid
            kill(worker)
            wait_until(lambda: not is_there(worker), "end of the worker", 10.0)
            return True

        yield kill_it

    def kill_all(self) -> int:
        """Kill every worker process; return their number."""
        workers = pool_workers(self._service)
        for worker in workers:
            kill(worker.pid)
        return len(workers)


def kill_pool(times: int, console: Console) -> bool:
    """Kill workers ``times`` times; return whether all requests were completed nevertheless."""
    tally = Tally("pool worker killed", console)
    with tempfile.TemporaryDirectory() as folder, bench_on(Path(folder)) as bench:
        loop, button, accounts, pools = Loop(bench.service.pid), StopButton(bench), Accounts(), Pools(bench.service.pid)
        run = _evaluated(bench, loop, tally, lambda: None)
        dry_run = partial(bench.client.post, "/api/experiments/dry-run", json=sequence(10, 10), timeout=DONE_S)
        asked = {
            "dry run": dry_run,
            "report": partial(bench.client.get, f"/api/runs/{run}/report.pdf"),
            "export": partial(bench.client.get, f"/api/runs/{run}/data.mat"),
        }
        for turn in range(times):
            what = ("dry run", "report", "fit", "export", "nothing")[turn % 5]
            be_off(bench, loop)
            if what == "fit":
                _fit(bench, loop, pools, tally)
            elif what == "nothing":
                tally.lost(pools.kill_all() == 0, "no worker to kill")
                _must_answer(asked["report"], tally, "report after all workers were killed")
            else:
                _at_work(bench, loop, button, pools, tally, what, asked[what])
            _must_be_free(bench, tally)
            accounts.look(bench, tally)
        must_be_well(bench, tally, "all kills", REPORTED_FOR_S)
        button.release()
        loop.close()
    return tally.close()


def _at_work(
    bench: Bench,
    loop: Loop,
    button: StopButton,
    pools: Pools,
    tally: Tally,
    what: str,
    ask: Callable[[], httpx.Response],
) -> None:
    wind_up(bench, loop)
    with ThreadPoolExecutor(1) as asking, pools.killed_at_work() as kill_it:
        answer = asking.submit(ask)
        tally.lost(not kill_it(), f"{what}: nobody computed")
        begun = time.monotonic()
        stop_and_check(button, loop, tally)
        _judge(answer, tally, what)
        tally.take(f"{what} answered after the kill [s]", time.monotonic() - begun)


def _fit(bench: Bench, loop: Loop, pools: Pools, tally: Tally) -> None:
    """Kill the worker of the evaluation; the run must get its result nevertheless."""
    with pools.killed_at_work() as kill_it:
        _evaluated(bench, loop, tally, lambda: tally.lost(not kill_it(), "fit: nobody computed"))


def _evaluated(bench: Bench, loop: Loop, tally: Tally, disturb: Callable[[], None]) -> int:
    """Execute a short experiment, ``disturb`` its evaluation, and wait for the result; return the run."""
    be_off(bench, loop)
    run = int(bench.client.post("/api/experiments", json=sequence(0.4, 0.4)).raise_for_status().json()["id"])

    def experiment() -> dict[str, Any]:
        return dict(bench.client.get(f"/api/experiments/{run}").raise_for_status().json())

    disturb()
    wait_until(lambda: experiment()["status"] != "running", "end of the program")
    begun = time.monotonic()
    try:
        wait_until(lambda: bool(experiment()["metrics"]), "metrics", DONE_S)
    except TimeoutError:
        tally.lost(True, f"run {run} is {experiment()['status']} without a result")
    else:
        tally.take("result after the end of the run [s]", time.monotonic() - begun)
    return run


def _must_answer(ask: Callable[[], httpx.Response], tally: Tally, what: str) -> None:
    answer: Future[httpx.Response] = Future()
    try:
        answer.set_result(ask())
    except httpx.HTTPError as error:
        answer.set_exception(error)
    _judge(answer, tally, what)


def _judge(answer: Future[httpx.Response], tally: Tally, what: str) -> None:
    try:
        got = answer.result(DONE_S)
    except (httpx.HTTPError, TimeoutError) as error:
        tally.lost(True, f"{what}: {error!r}")
    else:
        tally.lost(got.status_code != 200, f"{what} answered {got.status_code}: {got.text[:120]}")


def _must_be_free(bench: Bench, tally: Tally) -> None:
    try:
        wait_until(lambda: bench.state()["task"] is None, "end of the task", DONE_S)
    except TimeoutError:
        tally.lost(True, f"{bench.state()['task']} is under way for good")
