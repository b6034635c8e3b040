"""The data folder is deleted or replaced during a run: reported immediately, STOP works."""

import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from rich.console import Console

from tests.soak.attack.stop_button import StopButton, stop_and_check
from tests.soak.attack.tally import Tally
from tests.soak.attack.work import be_moving
from tests.soak.live_service import Loop, bench_on, wait_until

LOSS_REPORTED_S = 3.0
SECOND_S = 60.0


def lose_folder(times: int, console: Console) -> bool:
    """Delete the data folder ``times`` times, and replace it as often."""
    tally = Tally("data folder lost", console)
    for turn in range(2 * times):
        _lose(tally, replaced=turn % 2 == 1)
    return tally.close()


def _lose(tally: Tally, *, replaced: bool) -> None:
    what = "replaced" if replaced else "deleted"
    with tempfile.TemporaryDirectory() as folder:
        data = Path(folder) / "data"
        with bench_on(data, Path(folder) / "log") as bench:
            button, loop = StopButton(bench), Loop(bench.service.pid)
            run = be_moving(bench, loop)
            (data.rename(Path(folder) / "gone") if replaced else shutil.rmtree(data))
            if replaced:
                data.mkdir()
            begun = time.monotonic()
            try:
                wait_until(lambda: bool(bench.state()["problems"]), "told", 20.0)
                tally.take("told [s]", time.monotonic() - begun, LOSS_REPORTED_S)
                tally.note(f"{what}: {bench.state()['problems'][0]}")
            except TimeoutError:
                tally.lost(True, f"{what}: nothing is told")
            stop_and_check(button, loop, tally)
            answer = bench.client.get(f"/api/runs/{run}")
            whole = answer.status_code == 200 and answer.json()["end_state"] in ("completed", "stopped")
            silent = not bench.state()["problems"]
            tally.lost(whole and silent, f"{what}: the run is shown as whole, and nothing is told")
            _second_service(tally, data, what)
            button.release()
            loop.close()


def _second_service(tally: Tally, data: Path, what: str) -> None:
    """Start another service on the folder: it must be refused while the first one runs."""
    command = [sys.executable, "-m", "backend", "serve", "--plant", "simulator", "--port", "0", "--data", str(data)]
    try:
        ended = subprocess.run(command, capture_output=True, text=True, timeout=SECOND_S, check=False)
    except subprocess.TimeoutExpired:
        tally.lost(True, f"{what}: a second service starts there unseen")
    else:
        tally.lost(ended.returncode == 0, f"{what}: a second service ended with 0")
        tally.lost("Traceback" in ended.stderr, f"{what}: a second service is refused with a traceback")
