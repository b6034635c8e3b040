"""SIGTERM, SIGINT and SIGHUP during an experiment: the joint stops, all data are stored, the run has the reason."""

import os
import signal
import tempfile
import time
from pathlib import Path

from rich.console import Console

from backend.storage import runs
from backend.storage.database import open_database
from plant.safety_card import CardState
from tests.soak.attack.processes import descendants, is_there
from tests.soak.attack.tally import Tally
from tests.soak.attack.work import be_in_experiment
from tests.soak.live_service import Loop, bench_on, wait_until

ENDED_S = 15.0
SIGNALS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def end_service(times: int, console: Console) -> bool:
    """End a service with each signal ``times`` times."""
    tally = Tally("service ended", console)
    for _ in range(times):
        for number in SIGNALS:
            _end(tally, number)
    return tally.close()


def _end(tally: Tally, number: signal.Signals) -> None:
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder)
        with bench_on(data) as bench:
            loop = Loop(bench.service.pid)
            run = be_in_experiment(bench, loop)
            below = descendants(bench.service.pid)
            begun = time.monotonic()
            os.kill(bench.service.pid, number)
            try:
                wait_until(lambda: not is_there(bench.service.pid), "end of the service", 60.0)
                tally.take("ended [s]", time.monotonic() - begun, ENDED_S)
            except TimeoutError as error:
                tally.lost(True, f"{number.name}: {error}")
            time.sleep(0.5)
            left = [pid for pid in below if is_there(pid)]
            tally.lost(bool(left), f"{number.name}: processes {left} are left")
            _must_be_safe(tally, loop.card.state(), number.name)
            loop.close()
        tally.lost("Traceback" in bench.service.log.read_text(encoding="utf-8"), f"{number.name}: a traceback")
        database = open_database(data)
        with database.reading() as session:
            ended = runs.get(session, run)
        database.close()
        tally.note(f"{number.name}: the run is {ended.end_state}: {ended.end_detail}")
        tally.lost(ended.end_state in ("running", "completed"), f"{number.name}: the run is {ended.end_state}")
        tally.lost("stop_pressed" in ended.end_detail, f"{number.name} is called {ended.end_detail}")


def _must_be_safe(tally: Tally, card: CardState, name: str) -> None:
    safe = not card.drive_enabled and (card.u_A, card.u_B) == (0.0, 0.0)
    tally.lost(not safe, f"{name}: {card.u_A:.2f} V, {card.u_B:.2f} V, drives {card.drive_enabled}")
