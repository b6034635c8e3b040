"""The stored queue after a shutdown or a kill: it is restored and paused."""

import asyncio
import os
import signal
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx

from backend.schemas.experiment import ExperimentRequest
from backend.services.queue import ExperimentQueue
from backend.storage.database import open_database
from backend.storage.orm import StorageError
from backend.storage.runs import EndState
from backend.supervision import Supervision
from tests.api.conftest import client_with, until, wait_for
from tests.api.test_queue import LONG, SHORT, add
from tests.e2e.service import Service, running_service


def queue_of(client: httpx.Client) -> dict[str, Any]:
    return dict(client.get("/api/experiments/queue").raise_for_status().json())


def end_by(service: Service, number: signal.Signals) -> None:
    """Send a signal, and wait until the process is a zombie or gone: its loop process ends by itself."""
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
            assert "the service was started again" in found["problem"]
            wait_for(client, "task", None)
            assert client.get("/api/state").json()["mode"] == "off"
            if number is not None:
                end_by(service, number)
                continue
            entries = client.get("/api/log").raise_for_status().json()["entries"]
            assert [one["kind"] for one in entries if "SIGTERM" in one["text"]] == ["note"]
            assert not [one for one in entries if one["kind"] in ("trip", "fault")]  # it was off when it was ended
            before = client.get("/api/runs").json()["total"]
            client.post("/api/experiments/queue/run").raise_for_status()  # the short one, in second place before
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
            assert (await queue.run()).run == 5  # it has started: that its row stays is in the log
            assert queue.view().items == []
            queue.handle_run_end(5, EndState.COMPLETED)
            os.rename(tmp_path / "away.db", tmp_path / "sinew.db")
            again = ExperimentQueue(start, check, supervision, database).view()
            assert [(one.id, one.kept) for one in again.items] == [(item.id, True)]
        await supervision.close()

    asyncio.run(session())
