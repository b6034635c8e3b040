"""STOP is answered while viewers and operators send the most costly requests.

The attack tests measure the times (tests/soak/attack/costly.py). These tests check only that STOP precedes the results.
"""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import suppress

import httpx
import pytest

from tests.api.conftest import client_with, problem
from tests.e2e.service import Service, running_service
from tests.soak.attack.costly import (
    HOLDING,
    largest_sheet,
    long_letters,
    long_text,
    store_costly_run,
    text_of,
)

CHECK, SHEET = "/api/experiments/check", "/api/chart-sheet.pdf"
LATE_S = 20.0
"""No promised bound: a blocked interpreter answers after minutes."""

PRESSES = 3


@pytest.fixture(scope="module")
def costly(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Service, int]]:
    data = tmp_path_factory.mktemp("costly")
    run = store_costly_run(data)
    with running_service(data, params="lab") as service:
        yield service, run


@pytest.mark.parametrize("token", ["token", "viewer-token"])
def test_requests_that_would_block_the_interpreter_are_rejected(costly: tuple[Service, int], token: str) -> None:
    service, run = costly
    with client_with(service, token) as client:
        text = client.post(CHECK, json={"text": json.dumps(text_of(HOLDING)), "play": False})
        assert problem(text)["path"] == ["phases", 0, "parts", 0, "duration_s"]
        stored = client.get(f"/api/runs/{run}/planned")
        assert problem(stored)["path"] == ["phases", 0, "parts", 0, "duration_s"]
        letters = client.post(SHEET, json={"svg": long_letters()})
        assert (letters.status_code, problem(letters)["code"]) == (422, "sheet_too_large")


def test_stop_is_answered_during_costly_requests(costly: tuple[Service, int]) -> None:
    service, run = costly
    over = threading.Event()
    statuses: list[int] = []

    def ask(token: str, request: Callable[[httpx.Client], httpx.Response]) -> None:
        with client_with(service, token) as client:
            while not over.is_set():
                statuses.append(request(client).status_code)

    text, drawing = {"text": long_text(), "play": False}, {"svg": largest_sheet()}
    wanted: list[Callable[[httpx.Client], httpx.Response]] = [
        lambda client: client.post(CHECK, json=text),
        lambda client: client.post(SHEET, json=drawing),
        lambda client: client.get(f"/api/runs/{run}/planned"),
    ]
    asking = [
        threading.Thread(target=ask, args=(token, request))
        for token in ("token", "viewer-token")
        for request in wanted * 2
    ]
    with client_with(service, "viewer-token") as client:
        for thread in asking:
            thread.start()
        try:
            for _ in range(PRESSES):
                before = len(statuses)
                while len(statuses) == before:  # the computations have begun
                    time.sleep(0.01)
                begun = time.monotonic()
                assert client.post("/api/stop").status_code == 200
                assert time.monotonic() - begun < LATE_S
            assert all(thread.is_alive() for thread in asking)
        finally:
            over.set()
            for thread in asking:
                thread.join()
    assert set(statuses) <= {200, 422, 429}


def test_a_disconnected_sender_of_a_sheet_delays_no_other_request(costly: tuple[Service, int]) -> None:
    service, _ = costly
    with client_with(service, "viewer-token") as client:
        for _ in range(3):  # one more than the limit per person
            with suppress(httpx.ReadTimeout):  # the third is rejected immediately
                client.post(SHEET, json={"svg": largest_sheet()}, timeout=httpx.Timeout(60.0, read=0.05))
        small = '<svg xmlns="http://www.w3.org/2000/svg" width="90mm" height="90mm" viewBox="0 0 9 9"/>'
        end = time.monotonic() + 60.0
        while (answer := client.post(SHEET, json={"svg": small})).status_code == 429:
            assert time.monotonic() < end
            time.sleep(0.1)
        assert answer.status_code == 200
