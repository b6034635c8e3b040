"""Two services never work on one database: the second is refused, the first goes on, a killed one is replaced."""

import os
import signal
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import httpx

from tests.api.conftest import client_with
from tests.e2e.service import Service, running_service


def sinew(*words: str, data: Path, database: Path) -> subprocess.CompletedProcess[str]:
    """Run a command in a folder of its own, on a database in another; it is to end by itself."""
    command = [sys.executable, "-m", "backend", *words, "--data", str(data)]
    environment = os.environ | {"SINEW_DATABASE_URL": f"sqlite:///{database}"}
    return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=100, check=False)


def open_runs(script: httpx.Client) -> list[int]:
    runs = script.get("/api/runs").raise_for_status().json()["runs"]
    return [run["id"] for run in runs if run["end_state"] == "running"]


def in_run(service: Service) -> httpx.Client:
    script = client_with(service, "token")
    script.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    while not script.get("/api/state").raise_for_status().json()["pretension_done"]:
        time.sleep(0.05)
    script.post("/api/mode", json={"mode": "run"}).raise_for_status()
    return script


def test_a_second_service_is_refused_and_the_first_is_undisturbed(tmp_path: Path) -> None:
    first = tmp_path / "a"
    (tmp_path / "link").symlink_to(first)
    with running_service(first, params="ideal") as service, closing(in_run(service)) as script:
        recorded = open_runs(script)
        assert len(recorded) == 1
        for place in ("a", "link"):
            serve = ("serve", "--port", "0", "--params", "ideal")
            ended = sinew(*serve, data=tmp_path / "b", database=tmp_path / place / "sinew.db")
            assert ended.returncode != 0
            assert "a service of version" in ended.stderr + ended.stdout
            assert str(service.pid) in ended.stderr + ended.stdout
        assert sinew("runs", "list", data=tmp_path / "b", database=first / "sinew.db").returncode == 0
        assert open_runs(script) == recorded
        os.kill(service.pid, signal.SIGKILL)
        environment = {"SINEW_DATABASE_URL": f"sqlite:///{first}/sinew.db"}
        with running_service(tmp_path / "c", environment=environment) as after, client_with(after, "token") as other:
            assert open_runs(other) == []
