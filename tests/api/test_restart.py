"""State that a service leaves to the next one, for each way to end."""

import asyncio
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import msgspec
import pytest

from backend.schemas.experiment import ExperimentRequest
from backend.services.queue import ExperimentQueue
from backend.storage.database import open_database
from backend.storage.orm import StorageError
from backend.storage.runs import EndState
from backend.supervision import Supervision
from tests.api.conftest import PATIENCE_S, client_with, ended, until, until_state, wait_for
from tests.api.processes import descendants, held
from tests.api.test_queue import LONG, SHORT, add
from tests.api.test_scene import open_scene, receive
from tests.e2e.service import Service, running_service

# Two services never use one database: the second is rejected, the first continues, a killed one is replaced.


def sinew(*words: str, data: Path, database: Path) -> subprocess.CompletedProcess[str]:
    """Run a command that ends by itself, with its own folder and the database of another."""
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


def test_a_second_service_is_rejected_and_the_first_continues(tmp_path: Path) -> None:
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


# An experiment whose service is killed: the next service evaluates its run when a report is requested.

PLAYED_S = 2.0


def elapsed_s(client: httpx.Client) -> float:
    task = client.get("/api/state").raise_for_status().json()["task"]
    return float(task["elapsed_s"])


def test_the_report_of_an_interrupted_run_states_the_executed_time(tmp_path: Path) -> None:
    with running_service(tmp_path, params="ideal") as service, client_with(service, "token") as client:
        run = client.post("/api/experiments", json={"name": "tracking"}).raise_for_status().json()["id"]
        wait_for(client, "mode", "experiment")
        begun_s = elapsed_s(client)
        until_state(client, lambda state: state["task"]["elapsed_s"] > begun_s + PLAYED_S, f"not within {PATIENCE_S} s")
        os.kill(service.pid, signal.SIGKILL)
    with running_service(tmp_path, params="ideal") as service, client_with(service, "viewer-token") as viewer:
        left = viewer.get(f"/api/runs/{run}").raise_for_status().json()
        assert (left["end_state"], left["evaluation"]) == ("service_died", "missing")
        assert left["missing_samples"] is None  # the number of samples that were not stored is unknown
        report = viewer.get(f"/api/runs/{run}/report.html").raise_for_status().text
        assert "s of 102 s were executed" in report
        assert "unknown: the service died during the recording" in report
        assert viewer.get(f"/api/runs/{run}").json()["evaluation"] == "done"
        metrics = viewer.get(f"/api/experiments/{run}").raise_for_status().json()
        assert not any(criterion["passed"] for criterion in metrics["criteria"])


# No process of a service outlives it or holds its descriptors: otherwise no other service could start.

END_TIMEOUT_S = 10.0
MEMORY = {"backend.realtime.process": {"sinew-card", "sinew-ring"}, "plant.safety_card": {"sinew-card"}}
"""Shared memory of a process; the loop also has one socket, its channel."""


@pytest.fixture
def busy(tmp_path: Path) -> Iterator[Service]:
    """A service with all its processes: loop, watchdog, workers; a viewer has sent a message for which viser forks."""
    with (
        running_service(tmp_path, params="ideal") as service,
        client_with(service, "token") as operator,
        client_with(service, "viewer-token") as viewer,
    ):
        operator.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
        wait_for(operator, "pretension_done", True)
        operator.post("/api/mode", json={"mode": "run"}).raise_for_status()
        run = operator.get("/api/state").raise_for_status().json()["recording_run"]
        operator.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
        ended(operator, run)
        operator.get(f"/api/runs/{run}/data.csv").raise_for_status()  # its process ends with it
        operator.get(f"/api/runs/{run}/report.html").raise_for_status()  # by the permanent process for such work
        asyncio.run(_ask_to_publish(service, viewer))
        yield service


async def _ask_to_publish(service: Service, viewer: httpx.Client) -> None:
    async with open_scene(service, viewer) as socket:
        await receive(socket)
        await socket.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
        await asyncio.sleep(0.5)  # an event that must not happen cannot be awaited


def test_child_processes_share_no_descriptors_and_end_with_the_service(busy: Service) -> None:
    processes = descendants(busy.pid)
    for name in (*MEMORY, "spawn_main"):
        assert [line for line in processes.values() if name in line], f"{name} does not exist: {processes}"
    for pid, line in processes.items():
        links = held(pid)
        whose = next((name for name in MEMORY if name in line), "")
        assert {link[7:].split()[0] for link in links if link.startswith("/memfd:")} == MEMORY.get(whose, set()), line
        sockets = [link for link in links if link.startswith(("connected", "listening", "socket:"))]
        assert len(sockets) == (whose == "backend.realtime.process"), f"{line} holds {sockets}"
        assert not [link for link in links if link.startswith(str(busy.data))], f"{line} holds files of {busy.data}"

    alive = {os.pidfd_open(pid): line for pid, line in processes.items()}
    os.kill(busy.pid, signal.SIGKILL)
    for process, line in alive.items():
        assert select.select([process], [], [], END_TIMEOUT_S)[0], f"outlived the service: {line}"
        os.close(process)
    with running_service(busy.data, params="ideal") as again, client_with(again, "token") as operator:
        assert operator.get("/api/state").raise_for_status().json()["link"]["alive"]


# The stored queue after a shutdown or a kill: it is restored and paused.


def queue_of(client: httpx.Client) -> dict[str, Any]:
    return dict(client.get("/api/experiments/queue").raise_for_status().json())


def end_by(service: Service, number: signal.Signals) -> None:
    """Send a signal, and wait until the process has ended or is a zombie."""
    os.kill(service.pid, number)
    status = Path(f"/proc/{service.pid}/stat")
    end = time.monotonic() + 60.0
    while status.exists() and status.read_text().rpartition(")")[2].split()[0] != "Z":
        assert time.monotonic() < end
        time.sleep(0.05)


def test_queue_is_paused_after_a_kill_and_after_a_shutdown(tmp_path: Path) -> None:
    with running_service(tmp_path, params="ideal") as service, client_with(service, "token") as client:
        for segments in (LONG, SHORT, LONG, SHORT):
            assert add(client, segments).status_code == 201
        first, *_, last = (item["id"] for item in queue_of(client)["items"])
        client.put(f"/api/experiments/queue/{last}/place", json={"place": 1}).raise_for_status()
        run = client.post("/api/experiments/queue/run").raise_for_status().json()["run"]
        wait_for(client, "mode", "experiment")
        waited = queue_of(client)
        assert (waited["running"], waited["run"], len(waited["items"])) == (True, run, 3)
        assert first not in {item["id"] for item in waited["items"]}
        assert not any(item["kept"] for item in waited["items"])
        end_by(service, signal.SIGKILL)
    for number in (signal.SIGTERM, None):
        with running_service(tmp_path, params="ideal") as service, client_with(service, "token") as client:
            found = queue_of(client)
            assert [{**item, "kept": False} for item in found["items"]] == waited["items"]
            assert all(item["kept"] for item in found["items"])
            assert (found["running"], found["run"]) == (False, None)
            assert "the service was restarted" in found["problem"]
            wait_for(client, "task", None)
            assert client.get("/api/state").json()["mode"] == "off"
            if number is not None:
                end_by(service, number)
                continue
            entries = client.get("/api/log").raise_for_status().json()["entries"]
            assert [one["kind"] for one in entries if "SIGTERM" in one["text"]] == ["note"]
            assert not [one for one in entries if one["kind"] in ("trip", "fault")]  # it was off when it was ended
            before = client.get("/api/runs").json()["total"]
            client.post("/api/experiments/queue/run").raise_for_status()  # the short one, second before
            until(lambda: len(queue_of(client)["items"]) == 2)
            assert client.get("/api/runs").json()["total"] == before + 1
            client.post("/api/stop").raise_for_status()


def test_experiment_that_cannot_be_stored_is_not_queued(tmp_path: Path) -> None:
    async def start(_request: ExperimentRequest, _who: str) -> int:
        return 5

    async def check(request: ExperimentRequest) -> ExperimentRequest:
        return request

    async def refused(asked: Any) -> str:
        try:
            await asked
        except StorageError as error:
            return str(error)
        return ""

    async def session() -> None:
        supervision = Supervision()
        with closing(open_database(tmp_path)) as database:
            queue = ExperimentQueue(start, check, supervision, database)
            await queue.add(ExperimentRequest(name="sequence", settings={}), "Ana")
            (item,) = queue.view().items
            os.rename(tmp_path / "sinew.db", tmp_path / "away.db")
            assert await refused(queue.add(ExperimentRequest(name="sequence", settings={}), "Ana"))
            assert await refused(queue.remove(item.id))
            assert await refused(queue.move(item.id, 0))
            assert queue.view().items == [item]
            assert (await queue.run()).run == 5  # it has started: the log reports that its row remains
            assert queue.view().items == []
            queue.handle_run_end(5, EndState.COMPLETED)
            os.rename(tmp_path / "away.db", tmp_path / "sinew.db")
            again = ExperimentQueue(start, check, supervision, database).view()
            assert [(one.id, one.kept) for one in again.items] == [(item.id, True)]
        await supervision.close()

    asyncio.run(session())
