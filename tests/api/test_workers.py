"""The service's own processes killed as a person or the kernel would, and dry runs that must not hold anybody up."""

import os
import signal
from pathlib import Path

import httpx
import pytest

from tests.api.conftest import problem, wait_for
from tests.api.test_orders import finished
from tests.e2e.service import Service

SHORT = {"name": "sequence", "settings": {"segments": '[{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}]'}}
COMPUTING, POLITE = 0, 10


def workers(service: Service, niceness: int) -> list[int]:
    """Numbers of the service's processes for work that run at this niceness."""
    found = []
    for child in Path(f"/proc/{service.pid}/task/{service.pid}/children").read_text(encoding="ascii").split():
        try:
            if b"multiprocessing.spawn" in Path(f"/proc/{child}/cmdline").read_bytes():
                found.append(int(child))
        except OSError:
            continue
    return [pid for pid in found if os.getpriority(os.PRIO_PROCESS, pid) == niceness]


def kill_all(service: Service, niceness: int) -> int:
    pids = workers(service, niceness)
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    return len(pids)


def begin(client: httpx.Client) -> int:
    return int(client.post("/api/experiments", json=SHORT).raise_for_status().json()["id"])


@pytest.fixture
def run(off: httpx.Client) -> int:
    """A short run with its result."""
    number = begin(off)
    assert finished(off, f"/api/experiments/{number}")["status"] == "completed"
    assert off.get(f"/api/runs/{number}").json()["evaluation"] == "done"
    return number


def test_reports_and_exports_survive_their_process(service: Service, off: httpx.Client, run: int) -> None:
    assert off.get(f"/api/runs/{run}/report.html").is_success
    assert kill_all(service, POLITE) >= 1
    for path in ("report.html", "report.pdf", "data.csv"):
        assert off.get(f"/api/runs/{run}/{path}").status_code == 200
    (told,) = [text for text in off.get("/api/state").json()["problems"] if "reports and exports" in text]
    assert "was started anew" in told or "is being started anew" in told
    assert off.post("/api/experiments/dry-run", json=SHORT).is_success


def test_an_experiment_ends_with_its_result_although_its_process_was_killed(
    service: Service, off: httpx.Client, run: int
) -> None:
    assert kill_all(service, COMPUTING) == 1
    again = begin(off)
    wait_for(off, "mode", "experiment")
    kill_all(service, COMPUTING)
    finished(off, f"/api/experiments/{again}")
    assert off.get(f"/api/runs/{again}").json()["evaluation"] == "done"


def test_what_has_no_result_is_not_evaluated(off: httpx.Client, viewer: httpx.Client, run: int) -> None:
    assert off.post("/api/runs/999999/evaluation").status_code == 404
    assert viewer.post(f"/api/runs/{run}/evaluation").status_code == 403
    off.post("/api/stop").raise_for_status()
    off.post("/api/reset").raise_for_status()
    off.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    wait_for(off, "pretension_done", True)
    off.post("/api/mode", json={"mode": "run"}).raise_for_status()
    session = wait_for(off, "mode", "run")["recording_run"] or off.get("/api/runs").json()["runs"][0]["id"]
    refused = off.post(f"/api/runs/{session}/evaluation")
    assert refused.status_code == 409
    assert "session" in str(problem(refused)["message"])


def test_a_dry_run_has_a_longest_length(viewer: httpx.Client) -> None:
    segments = ", ".join(['{"duration_s": 400, "q_ref": 0.1, "S_ref": 10}'] * 2)
    refused = viewer.post(
        "/api/experiments/dry-run", json={"name": "sequence", "settings": {"segments": f"[{segments}]"}}
    )
    assert refused.status_code == 422
    told = problem(refused)
    assert (told["quantity"], told["value"], told["maximum"], told["unit"]) == (
        "duration of a dry run",
        800.0,
        600.0,
        "s",
    )
