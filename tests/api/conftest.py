"""A running service for the tests of this folder: process, loop, simulator and data folder."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

import httpx
import pytest
from websockets.sync.client import ClientConnection, connect

from plant.quantity import UNIT_MARK
from tests.e2e.service import Service, running_service

T = TypeVar("T")

PATIENCE_S = 600.0
"""Longest wait [s]; sufficient on a busy machine."""

PAUSE_S = 0.03
"""Interval between two requests [s]; a shorter one takes CPU time from the service."""


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("api"), params="ideal") as running:
        yield running


def client_with(service: Service, token_file: str) -> httpx.Client:
    token = (service.data / token_file).read_text().strip()
    return httpx.Client(base_url=service.url, headers={"Authorization": f"Bearer {token}"}, timeout=240.0)


def live(client: httpx.Client) -> ClientConnection:
    """Open the live stream with the token or cookies of ``client``."""
    sent = client.build_request("GET", "/api/live").headers
    url = f"ws://{client.base_url.netloc.decode()}/api/live"
    return connect(
        url,
        additional_headers={name: sent[name] for name in ("Authorization", "Cookie") if name in sent},
        compression=None,
        open_timeout=PATIENCE_S,
        ping_interval=None,
        close_timeout=0.1,
    )


@pytest.fixture(scope="session")
def operator(service: Service) -> Iterator[httpx.Client]:
    with client_with(service, "token") as client:
        yield client


@pytest.fixture(scope="session")
def viewer(service: Service) -> Iterator[httpx.Client]:
    with client_with(service, "viewer-token") as client:
        yield client


@pytest.fixture
def off(operator: httpx.Client) -> httpx.Client:
    """The operator, with the loop in mode off."""
    operator.post("/api/stop").raise_for_status()
    operator.post("/api/reset").raise_for_status()
    return operator


@pytest.fixture
def running(off: httpx.Client) -> httpx.Client:
    """The operator, with the loop in mode run."""
    off.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    wait_for(off, "pretension_done", True)
    off.post("/api/mode", json={"mode": "run"}).raise_for_status()
    return off


def wait_for(client: httpx.Client, field: str, value: object) -> dict[str, Any]:
    """Poll the state until ``field`` has the value."""
    return until_state(client, lambda state: state[field] == value, f"{field} never became {value!r}")


def wait_until_present(client: httpx.Client, field: str) -> dict[str, Any]:
    """Poll the state until ``field`` is not empty."""
    return until_state(client, lambda state: bool(state[field]), f"{field} never came")


def until_state(client: httpx.Client, reached: Callable[[dict[str, Any]], bool], otherwise: str) -> dict[str, Any]:
    """Poll the state until the condition holds, and return it."""
    end = time.monotonic() + PATIENCE_S
    while not reached(state := dict(client.get("/api/state").raise_for_status().json())):
        assert time.monotonic() < end, f"{otherwise}: {state}"
        time.sleep(PAUSE_S)
    return state


def ended(client: httpx.Client, run: object) -> dict[str, object]:
    """Wait until all samples of a run are stored and it is closed; return its view."""

    def view() -> dict[str, object] | None:
        found = dict(client.get(f"/api/runs/{run}").raise_for_status().json())
        return None if found["end_state"] == "running" else found

    return until(view)


def until(asked: Callable[[], T | None]) -> T:
    """Poll until the answer is true, and return it."""
    end = time.monotonic() + PATIENCE_S
    while not (answer := asked()):
        assert time.monotonic() < end, "it never happened"
        time.sleep(PAUSE_S)
    return answer


def problem(response: httpx.Response) -> dict[str, Any]:
    """Check that the answer is a refusal, and return its body with the message as displayed."""
    assert response.status_code >= 400, response.text
    error = dict(response.json()["error"])
    shown = str(error["message"]).replace(f"{UNIT_MARK}°", "°").replace(UNIT_MARK, " ")
    return error | {"message": shown}


@pytest.fixture(scope="session")
def data(service: Service) -> Path:
    return service.data
