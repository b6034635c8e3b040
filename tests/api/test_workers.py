"""Worker processes that are killed, and dry runs that must not delay other requests."""

import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest

from tests.api.conftest import problem, until, wait_for
from tests.api.sockets import connected
from tests.api.test_orders import finished
from tests.e2e.service import Service

SHORT = {"name": "sequence", "settings": {"segments": '[{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}]'}}
COMPUTING, POLITE = 0, 10
ASKED = 3000


def lasting(duration_s: float) -> dict[str, object]:
    segments = f'[{{"duration_s": {duration_s}, "q_ref": 0.1, "S_ref": 10}}]'
    return {"name": "sequence", "settings": {"segments": segments}}


def workers(service: Service, niceness: int) -> list[int]:
    """Return the worker processes of the service with this niceness."""
    found = []
    for child in Path(f"/proc/{service.pid}/task/{service.pid}/children").read_text(encoding="ascii").split():
        with suppress(OSError):  # the process has ended meanwhile
            is_worker = b"multiprocessing.spawn" in Path(f"/proc/{child}/cmdline").read_bytes()
            if is_worker and os.getpriority(os.PRIO_PROCESS, int(child)) == niceness:
                found.append(int(child))
    return found


def kill_all(service: Service, niceness: int) -> int:
    pids = workers(service, niceness)
    for pid in pids:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    return len(pids)


@contextmanager
def all_killed(service: Service, niceness: int) -> Iterator[None]:
    """Kill every process of this niceness as soon as it exists."""
    over = threading.Event()

    def kill() -> None:
        while not over.wait(0.005):
            kill_all(service, niceness)

    killing = threading.Thread(target=kill)
    killing.start()
    try:
        yield
    finally:
        over.set()
        killing.join()


def begin(client: httpx.Client) -> int:
    return int(client.post("/api/experiments", json=SHORT).raise_for_status().json()["id"])


@pytest.fixture
def run(off: httpx.Client) -> int:
    """A short run with its result."""
    number = begin(off)
    assert finished(off, f"/api/experiments/{number}")["status"] == "completed"
    assert off.get(f"/api/runs/{number}").json()["evaluation"] == "done"
    return number


def test_reports_and_exports_work_after_their_process_is_killed(service: Service, off: httpx.Client, run: int) -> None:
    assert off.get(f"/api/runs/{run}/report.html").is_success
    assert kill_all(service, POLITE) >= 1
    (line_text,) = until(
        lambda: [text for text in off.get("/api/state").json()["problems"] if "reports and exports" in text]
    )
    for path in ("report.html", "report.pdf", "data.csv"):
        assert off.get(f"/api/runs/{run}/{path}").status_code == 200
    assert "was restarted" in line_text or "is being restarted" in line_text
    assert off.post("/api/experiments/dry-run", json=SHORT).is_success


def test_an_experiment_has_its_result_although_its_process_was_killed(
    service: Service, off: httpx.Client, run: int
) -> None:
    assert kill_all(service, COMPUTING) >= 1
    again = begin(off)
    wait_for(off, "mode", "experiment")
    kill_all(service, COMPUTING)
    finished(off, f"/api/experiments/{again}")
    assert off.get(f"/api/runs/{again}").json()["evaluation"] == "done"


def test_a_failed_evaluation_is_reported_and_can_be_repeated(
    service: Service, off: httpx.Client, run: int, data: Path
) -> None:
    with all_killed(service, COMPUTING):
        without = begin(off)
        finished(off, f"/api/experiments/{without}")
    view = off.get(f"/api/runs/{without}").json()
    assert (view["end_state"], view["evaluation"]) == ("completed", "missing")
    assert "died twice" in view["evaluation_problem"]
    assert any(f"Run {without} is complete, but" in text for text in off.get("/api/state").json()["problems"])
    assert "not evaluated" in off.get(f"/api/experiments/{without}").json()["message"]
    listed = sinew("runs", "list", data=data)
    assert "not evaluated" in listed.stdout
    assert off.post("/api/experiments", json={"name": "levitation"}).status_code == 422  # no run is in progress

    again = off.post(f"/api/runs/{without}/evaluation").raise_for_status().json()
    assert (again["evaluation"], again["evaluation_problem"]) == ("done", "")
    assert not any(f"Run {without} is complete, but" in text for text in off.get("/api/state").json()["problems"])
    assert any(metric["value"] is not None for metric in off.get(f"/api/experiments/{without}").json()["metrics"])
    assert sinew("runs", "evaluate", str(without), data=data).returncode == 0
    assert begin(off) == without + 1
    assert all("restarted" in text for text in off.get("/api/state").json()["problems"])
    wait_for(off, "task", None)


def sinew(*words: str, data: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "backend", *words, "--data", str(data)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | {"COLUMNS": "200"})


def test_runs_without_a_result_cannot_be_evaluated(off: httpx.Client, viewer: httpx.Client, run: int) -> None:
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


def test_a_dry_run_has_a_maximum_duration(viewer: httpx.Client) -> None:
    segments = ", ".join(['{"duration_s": 400, "q_ref": 0.1, "S_ref": 10}'] * 2)
    refused = viewer.post(
        "/api/experiments/dry-run", json={"name": "sequence", "settings": {"segments": f"[{segments}]"}}
    )
    assert refused.status_code == 422
    refusal = problem(refused)
    assert (refusal["words"], refusal["value"], refusal["maximum"], refusal["unit"]) == (
        "duration of a dry run",
        800.0,
        600.0,
        "s",
    )


def about_dry_runs(client: httpx.Client) -> list[str]:
    return [text for text in client.get("/api/state").json()["problems"] if "dry runs" in text]


@pytest.fixture
def reported(off: httpx.Client, run: int) -> int:
    """A short run with a requested report: the process of reports exists and is idle."""
    assert off.get(f"/api/runs/{run}/report.html").is_success
    return run


def processor_ticks(pid: int) -> int:
    """Return the CPU time of a process (proc(5): utime and stime)."""
    after_name = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()
    return int(after_name[11]) + int(after_name[12])


@contextmanager
def held(pid: int) -> Iterator[None]:
    """Stop a process, so that its computation never ends."""
    os.kill(pid, signal.SIGSTOP)
    try:
        yield
    finally:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGCONT)


@pytest.fixture
def hanging(service: Service, viewer: httpx.Client, reported: int) -> Iterator[socket.socket]:
    """A connection that waits for a long dry run of a viewer while no report is requested."""
    parts = urlsplit(service.url)
    token = (service.data / "viewer-token").read_text().strip()
    body = json.dumps(lasting(600)).encode()
    head = f"POST /api/experiments/dry-run HTTP/1.1\r\nHost: {parts.netloc}\r\nAuthorization: Bearer {token}\r\n"
    head += f"Content-Type: application/json\r\nContent-Length: {len(body)}\r\n\r\n"
    address = (str(parts.hostname), int(parts.port or 0))
    for _ in range(ASKED):
        with connected(address, head.encode() + body) as connection:
            while viewer.post("/api/experiments/dry-run", json=SHORT).status_code != 429:
                if select.select([connection], [], [], 0.0)[0]:
                    break  # rejected: a short one was first
            else:
                yield connection
                return
    raise AssertionError("the long dry run never came first")


def test_a_dry_run_of_a_viewer_delays_no_report_and_ends_on_disconnect(
    service: Service, off: httpx.Client, viewer: httpx.Client, reported: int, hanging: socket.socket
) -> None:
    since = {pid: processor_ticks(pid) for pid in workers(service, POLITE)}
    (dry_run,) = until(lambda: [pid for pid, ticks in since.items() if processor_ticks(pid) > ticks + 5])
    problems = set(about_dry_runs(off))
    with held(dry_run):  # so that it cannot end before the reports
        assert off.get(f"/api/runs/{reported}/report.html").is_success
        assert off.get(f"/api/runs/{reported}/data.csv").is_success
        refused = viewer.post("/api/experiments/dry-run", json=SHORT)
        assert refused.status_code == 429
        assert problem(refused)["message_code"] == "own_work_at_limit"
        hanging.close()

        def answered() -> httpx.Response | None:
            answer = viewer.post("/api/experiments/dry-run", json=SHORT)
            return None if answer.status_code == 429 else answer

        again = until(answered)
    assert again.status_code == 200, again.text
    assert again.json()["status"] == "completed"
    assert dry_run not in workers(service, POLITE)
    assert set(about_dry_runs(off)) <= problems  # the intended end of a process is no problem; earlier problems expire
