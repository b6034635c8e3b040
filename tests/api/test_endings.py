"""State that a service leaves when a signal ends it, and a service whose data folder disappears."""

import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import httpx
import pytest

from backend.storage import runs
from backend.storage.database import open_database
from tests.api.conftest import client_with, ended, until, wait_for, wait_until_present
from tests.e2e.service import Service, running_service


def begin_session(operator: httpx.Client) -> None:
    operator.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    wait_for(operator, "pretension_done", True)
    operator.post("/api/mode", json={"mode": "run"}).raise_for_status()


def begin_experiment(operator: httpx.Client) -> None:
    operator.post("/api/experiments", json={"name": "tracking"}).raise_for_status()


def in_motion(operator: httpx.Client) -> int:
    """Return the number of the run to which the samples belong."""
    return int(str(wait_until_present(operator, "recording_run")["recording_run"]))


@pytest.fixture
def hangup_heeded() -> Iterator[None]:
    """SIGHUP with its default action; with nohup these tests and the service would inherit another."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


@pytest.mark.usefixtures("hangup_heeded")
@pytest.mark.parametrize(
    ("number", "begin"),
    [(signal.SIGTERM, begin_experiment), (signal.SIGHUP, begin_experiment), (signal.SIGINT, begin_session)],
    ids=["SIGTERM", "SIGHUP", "SIGINT"],
)
def test_a_run_that_a_signal_ends_stores_the_signal(
    tmp_path: Path, number: signal.Signals, begin: Callable[[httpx.Client], None]
) -> None:
    with running_service(tmp_path, params="ideal") as service:
        with client_with(service, "token") as operator:
            begin(operator)
            run = in_motion(operator)
        os.kill(service.pid, number)
        left = wait_for_end(service)
    if number is not signal.SIGINT:  # not killed by it: the interpreter releases its resources at the end
        assert (left.si_code, left.si_status) == (os.CLD_EXITED, 128 + number)
    with closing(open_database(tmp_path)) as database, database.reading() as session:
        stored = runs.get(session, run)
        assert (stored.end_state, stored.end_detail) == ("stopped", f"service ended by {number.name}")
    assert "Traceback" not in service.log.read_text()
    assert "leaked" not in service.log.read_text()


def wait_for_end(service: Service) -> os.waitid_result:
    """Wait until the service, a child of this process, has ended; leave its status to the parent."""
    left = os.waitid(os.P_PID, service.pid, os.WEXITED | os.WNOWAIT)
    assert left is not None
    return left


def problems(operator: httpx.Client) -> str:
    return " ".join(operator.get("/api/state").raise_for_status().json()["problems"])


def wait_for_problems(operator: httpx.Client, words: str) -> None:
    until(lambda: words in problems(operator) if words else not problems(operator))


def sinew(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "backend", *words], capture_output=True, text=True, check=False)


def test_a_missing_data_folder_is_reported_and_its_return_loses_no_data(tmp_path: Path) -> None:
    data = tmp_path / "data"
    with running_service(data, params="ideal") as service, client_with(service, "token") as operator:
        assert sinew("link", "--data", str(data)).stdout.splitlines()[0].endswith(service.link)
        begin_session(operator)
        run = in_motion(operator)
        aside = data.rename(tmp_path / "aside")
        wait_for_problems(operator, f"the data folder {data} was deleted, moved or replaced")
        second = sinew("serve", "--port", "0", "--data", str(data))
        assert second.returncode == 1
        assert "another service uses the folder" in second.stderr
        wait_for_problems(operator, "samples cannot be stored")
        aside.rename(data)
        wait_for_problems(operator, "")
        operator.post("/api/stop").raise_for_status()
        whole = ended(operator, run)
        assert (whole["end_state"], whole["end_reason"]) == ("stopped", "stop_pressed")
        assert whole["missing_samples"] == 0
        shutil.rmtree(data.rename(tmp_path / "deleted"))  # immediately, whatever is being written meanwhile
        wait_for_problems(operator, f"the data folder {data} was deleted")
        # Files that the service still holds open can be saved, and saving does not hide the problem.
        saved = operator.post("/api/system/backups").raise_for_status().json()
        assert (data / "backups" / saved["name"]).stat().st_size == saved["size_bytes"]
        wait_for_problems(operator, "it was replaced")
