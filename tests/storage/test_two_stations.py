"""Two services, each a station with a data folder of its own, on one PostgreSQL, at work at the same time."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing, suppress
from pathlib import Path
from typing import Any

import httpx
import pytest

from backend.recording.reader import read_samples
from backend.storage import recordings, runs
from backend.storage.database import open_database
from backend.storage.messages import station_taken
from tests.api.conftest import client_with, until, wait_for
from tests.e2e.service import Service, running_service
from tests.postgres import new_database

pytestmark = pytest.mark.live

NAMES = ("rig-a", "rig-b")
POSITIONS = {"rig-a": 0.1, "rig-b": -0.2}
"""Where the joint of each station is sent [rad]: nothing of one may turn up in a recording of the other."""
COUNT = 2
LONG = '[{"duration_s": 60, "q_ref": 0.1, "S_ref": 10}]'


@pytest.fixture(scope="module")
def url(postgres: str) -> str:
    return new_database(postgres, "two_stations")


def started(stack: ExitStack, folder: Path, name: str, url: str) -> Service:
    environment = {"SINEW_DATABASE_URL": url}
    return stack.enter_context(running_service(folder / name, more=("--station", name), environment=environment))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("stations")


@pytest.fixture(scope="module")
def services(url: str, folder: Path) -> Iterator[dict[str, Service]]:
    """Both services, started simultaneously on a database without tables."""
    with ExitStack() as stack:
        with ThreadPoolExecutor(2) as threads:
            waiting = [threads.submit(started, stack, folder, name, url) for name in NAMES]
            both = {name: one.result() for name, one in zip(NAMES, waiting, strict=True)}
        yield both


def queue(client: httpx.Client, segments: str) -> None:
    item = {"name": "sequence", "settings": {"segments": segments}}
    client.post("/api/experiments/queue", json=item).raise_for_status()


def listed(client: httpx.Client, **query: Any) -> list[dict[str, Any]]:
    return list(client.get("/api/runs", params=query).raise_for_status().json()["runs"])


def play(client: httpx.Client, q_ref: float) -> None:
    for _ in range(COUNT):
        queue(client, f'[{{"duration_s": 2, "q_ref": {q_ref}, "S_ref": 10}}]')
    client.post("/api/experiments/queue/run").raise_for_status()

    def over() -> bool:
        waiting = client.get("/api/experiments/queue").raise_for_status().json()
        return not waiting["items"] and not waiting["run"]

    until(over)
    until(lambda: all(run["evaluation"] == "done" for run in listed(client, kind="sequence")))


def test_two_simultaneous_stations_do_not_mix_their_data(
    services: dict[str, Service], url: str, tmp_path: Path
) -> None:
    with ExitStack() as stack:
        clients = {name: stack.enter_context(client_with(services[name], "token")) for name in NAMES}
        a, b = (clients[name] for name in NAMES)
        tuning = a.get("/api/tuning").raise_for_status().json()
        lam = {name: tuning[name] for name in ("lam_q", "lam_S", "lam_motor", "b")}
        a.put("/api/tuning", json={**lam, "lam_q": 0.8}).raise_for_status()
        a.put("/api/saved-searches/mine", json={"where": "kind = sequence"}).raise_for_status()
        with ThreadPoolExecutor(2) as threads:
            list(threads.map(lambda name: play(clients[name], POSITIONS[name]), NAMES))

        of = {name: [run["id"] for run in listed(clients[name])] for name in NAMES}
        assert {name: len(numbers) for name, numbers in of.items()} == dict.fromkeys(NAMES, COUNT)
        everything = sorted((number for numbers in of.values() for number in numbers), reverse=True)
        assert len(set(everything)) == 2 * COUNT
        for name in NAMES:
            assert {run["station"] for run in listed(clients[name])} == {name}
            assert [run["id"] for run in listed(clients[name], everywhere=True)] == everything
            assert [run["id"] for run in listed(clients[name], where='station ~ ""')] == everything
            for other in NAMES:
                assert [run["id"] for run in listed(clients[name], where=f"station = {other}")] == of[other]
            words = clients[name].get("/api/run-words").raise_for_status().json()
            assert (words["station"], words["stations"]) == (name, list(NAMES))
        require_own_samples(url, tmp_path, of)

        # what is in force, saved and told of one is not of the other
        assert a.get("/api/tuning").json()["lam_q"] == 0.8
        assert b.get("/api/tuning").json()["lam_q"] == tuning["lam_q"]
        assert [one["name"] for one in a.get("/api/saved-searches").json()["searches"]] == ["mine"]
        assert b.get("/api/saved-searches").json()["searches"] == []
        require_own_trip(a, b, of["rig-a"][0])
        refused = client_of_a_third(url, tmp_path)
        assert station_taken(service="another service", station="rig-a").partition(":")[0] in refused


def require_own_samples(url: str, tmp_path: Path, of: dict[str, list[int]]) -> None:
    """Check that each recording is complete and holds the references of its own station only."""
    with closing(open_database(tmp_path / "looking", url)) as database, database.reading() as session:
        for name, numbers in of.items():
            for number in numbers:
                assert runs.get(session, number).station == name
                assert recordings.get(session, number).missed == 0
                samples = read_samples(session, number, ["q_ref"])
                sent = {round(float(q_ref), 4) for q_ref in samples.columns["q_ref"]}
                assert POSITIONS[name] in sent
                assert not sent & (set(POSITIONS.values()) - {POSITIONS[name]})


def require_own_trip(a: httpx.Client, b: httpx.Client, run: int) -> None:
    """Check that a trip and its flight record stay at their station, and the other station continues."""
    assert a.get(f"/api/runs/{run}").json()["end_state"] == "completed"
    queue(b, LONG)
    b.post("/api/experiments/queue/run").raise_for_status()
    queue(a, LONG)
    a.post("/api/experiments/queue/run").raise_for_status()
    wait_for(a, "mode", "experiment")
    wait_for(b, "mode", "experiment")
    a.post("/api/faults/injection", json={"kind": "safety_trip"}).raise_for_status()
    until(lambda: a.get("/api/flights").raise_for_status().json()["flights"])
    assert b.get("/api/state").json()["mode"] == "experiment"
    assert b.get("/api/flights").raise_for_status().json()["flights"] == []
    b.post("/api/stop").raise_for_status()
    until(lambda: {run["end_state"] for run in listed(b)} == {"completed", "stopped"})
    until(lambda: {run["end_state"] for run in listed(a)} == {"completed", "tripped"})


def client_of_a_third(url: str, tmp_path: Path) -> str:
    """Start a service with a used name, and return its output."""
    command = [sys.executable, "-m", "backend", "serve", "--port", "0", "--station", "rig-a"]
    command += ["--data", str(tmp_path / "third")]
    environment = {**os.environ, "SINEW_DATABASE_URL": url}
    ended = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert ended.returncode == 1
    return " ".join(ended.stderr.split())


def test_a_killed_and_restarted_service_does_not_affect_the_other(
    services: dict[str, Service], url: str, folder: Path
) -> None:
    with ExitStack() as stack:
        a, b = (stack.enter_context(client_with(services[name], "token")) for name in NAMES)
        for client in (a, b):
            client.post("/api/stop").raise_for_status()
            client.post("/api/reset").raise_for_status()
            queue(client, LONG)
            client.post("/api/experiments/queue/run").raise_for_status()
            wait_for(client, "mode", "experiment")
        of_a, of_b = (newest_of(client) for client in (a, b))
        os.kill(services["rig-b"].pid, signal.SIGKILL)
        until(lambda: not is_there(services["rig-b"].pid))
        again = started(stack, folder, "rig-b", url)
        b = stack.enter_context(client_with(again, "token"))
        assert until(lambda: listed(b, where="end = service_died"))[0]["id"] == of_b
        assert a.get(f"/api/runs/{of_a}").raise_for_status().json()["end_state"] == "running"
        assert a.get("/api/state").json()["mode"] == "experiment"
        assert b.get("/api/experiments/queue").raise_for_status().json()["run"] is None


def newest_of(client: httpx.Client) -> int:
    return int(until(lambda: listed(client)[:1])[0]["id"])


def is_there(pid: int) -> bool:
    with suppress(OSError):
        return "Z" not in Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    return False
