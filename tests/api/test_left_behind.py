"""What the processes of a service hold of it, and that none of them outlives it: else no other service could start."""

import asyncio
import os
import select
import signal
from collections.abc import Iterator
from pathlib import Path

import httpx
import msgspec
import pytest

from tests.api.conftest import client_with, ended, wait_for
from tests.api.processes import descendants, held
from tests.api.test_scene import looking, receive
from tests.e2e.service import Service, running_service

END_TIMEOUT_S = 10.0
MEMORY = {"backend.realtime.process": {"sinew-card", "sinew-ring"}, "plant.safety_card": {"sinew-card"}}
"""Shared memory that a process is meant to have; the loop has one socket besides, its channel."""


@pytest.fixture
def busy(tmp_path: Path) -> Iterator[Service]:
    """A service with all its processes: loop, watchdog, pool; a viewer has asked for what viser's server forks for."""
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
        operator.get(f"/api/runs/{run}/report.html").raise_for_status()  # by the process that stays for such work
        asyncio.run(_ask_to_publish(service, viewer))
        yield service


async def _ask_to_publish(service: Service, viewer: httpx.Client) -> None:
    async with looking(service, viewer) as socket:
        await receive(socket)
        await socket.send(msgspec.msgpack.encode({"type": "ShareUrlRequest"}))
        await asyncio.sleep(0.5)  # what is not to happen cannot be waited for


def test_no_process_holds_what_is_the_services_own_and_none_outlives_it(busy: Service) -> None:
    processes = descendants(busy.pid)
    for name in (*MEMORY, "spawn_main"):
        assert [line for line in processes.values() if name in line], f"{name} is not there: {processes}"
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
