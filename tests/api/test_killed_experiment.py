"""An experiment whose service is killed: its run gets its result from the next one, once a report of it is wanted."""

import os
import signal
from pathlib import Path

import httpx

from tests.api.conftest import PATIENCE_S, client_with, until_state, wait_for
from tests.e2e.service import running_service

PLAYED_S = 2.0


def elapsed_s(client: httpx.Client) -> float:
    task = client.get("/api/state").raise_for_status().json()["task"]
    return float(task["elapsed_s"])


def test_its_report_says_how_much_was_played(tmp_path: Path) -> None:
    with running_service(tmp_path, params="ideal") as service, client_with(service, "token") as client:
        run = client.post("/api/experiments", json={"name": "tracking"}).raise_for_status().json()["id"]
        wait_for(client, "mode", "experiment")
        begun_s = elapsed_s(client)
        until_state(client, lambda state: state["task"]["elapsed_s"] > begun_s + PLAYED_S, f"not within {PATIENCE_S} s")
        os.kill(service.pid, signal.SIGKILL)
    with running_service(tmp_path, params="ideal") as service, client_with(service, "viewer-token") as viewer:
        left = viewer.get(f"/api/runs/{run}").raise_for_status().json()
        assert (left["end_state"], left["evaluation"]) == ("service_died", "missing")
        assert left["missing_samples"] is None  # how many were still to be stored nobody knows
        report = viewer.get(f"/api/runs/{run}/report.html").raise_for_status().text
        assert "s of 102 s were played" in report
        assert "not known: the service died while it recorded" in report
        assert viewer.get(f"/api/runs/{run}").json()["evaluation"] == "done"
        metrics = viewer.get(f"/api/experiments/{run}").raise_for_status().json()
        assert not any(criterion["passed"] for criterion in metrics["criteria"])
