"""The queue of a running service from the command line, compared with the interface."""

import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from tests.api.conftest import client_with, until
from tests.cli.test_report import sinew
from tests.e2e.service import Service, running_service

pytestmark = pytest.mark.live

SEGMENTS = 'segments=[{"duration_s": 1, "q_ref": 0.1, "S_ref": 10}]'
LONG = SEGMENTS.replace("1,", "60,", 1)


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("queue")) as running:
        yield running


@pytest.fixture(scope="module")
def client(service: Service) -> Iterator[httpx.Client]:
    with client_with(service, "token") as client:
        yield client


def queue(service: Service, *words: str) -> Any:
    answer = sinew("queue", *words, "--json", folder=service.data)
    assert answer.returncode == 0, answer.stderr
    return json.loads(answer.stdout)


def shown(client: httpx.Client) -> Any:
    return client.get("/api/experiments/queue").raise_for_status().json()


def test_queued_experiments_are_listed_moved_and_removed(service: Service, client: httpx.Client) -> None:
    assert queue(service, "show") == shown(client) == {"items": [], "running": False, "run": None, "problem": ""}
    first = queue(service, "add", "sequence", "--set", SEGMENTS)["items"][0]
    second = queue(service, "add", "tracking", "--set", "lam_q=0.6")["items"][1]
    assert second["settings"]["lam_q"] == 0.6
    moved = queue(service, "move", str(second["id"]), "1")
    assert moved == shown(client)
    assert [item["id"] for item in moved["items"]] == [second["id"], first["id"]]
    assert [item["id"] for item in queue(service, "remove", str(second["id"]))["items"]] == [first["id"]]
    assert queue(service, "run") == {"items": [], "running": False, "run": None, "problem": ""}
    newest = client.get("/api/runs", params={"limit": 1}).raise_for_status().json()["runs"][0]
    assert (newest["kind"], newest["end_state"]) == ("sequence", "completed")


def test_the_queue_is_paused_after_the_current_run_and_stopped(service: Service, client: httpx.Client) -> None:
    for _ in range(2):
        queue(service, "add", "sequence", "--set", LONG)
    begun = queue(service, "run", "--no-watch")
    assert begun["running"]
    until(lambda: client.get("/api/state").raise_for_status().json()["task"]["phase"] == "program")
    paused = queue(service, "pause")
    assert (paused["running"], paused["run"], len(paused["items"])) == (False, begun["run"], 1)
    words = sinew("queue", "show", folder=service.data).stdout
    assert f"run {begun['run']} is in progress: sequence" in words
    assert "the queue is not running" in words
    queue(service, "stop")
    until(lambda: shown(client)["run"] is None)
    assert len(shown(client)["items"]) == 1  # a stopped experiment does not restart, a queued one remains queued
    ended = client.get(f"/api/runs/{begun['run']}").raise_for_status().json()
    assert ended["end_state"] in ("stopped", "tripped")


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("add", "juggling"), "there is no such experiment"),
        (("add", "tracking", "--set", "lam_q=9"), "9 s is outside 0.01 to 3 s"),
        (("remove", "999"), "experiment 999 is not in the queue"),
        (("move", "999", "1"), "experiment 999 is not in the queue"),
    ],
)
def test_a_refusal_of_the_service_is_printed_with_its_message(
    service: Service, words: tuple[str, ...], expected: str
) -> None:
    refused = sinew("queue", *words, folder=service.data)
    assert refused.returncode == 1
    assert expected in refused.stderr


def test_a_missing_service_is_reported(tmp_path: Path) -> None:
    refused: subprocess.CompletedProcess[str] = sinew("queue", "show", folder=tmp_path)
    assert refused.returncode == 1
    assert str(tmp_path) in refused.stderr
