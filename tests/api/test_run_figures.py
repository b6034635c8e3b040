"""Figures of ranges of a run over HTTP: lines that tell how far they are, refusals before them, an end when left."""

import json
import time
from collections.abc import Iterator
from contextlib import closing
from typing import Any

import httpx
import numpy as np
import pytest

from backend.sample import STORED_NAMES
from backend.storage.database import open_database
from plant.interface import T_s
from tests.api.conftest import PATIENCE_S, client_with, problem
from tests.e2e.service import running_service
from tests.recording.stored_run import store_run

COUNT = 120_000
KINDS = ("statistics", "spectra", "range.csv")


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[httpx.Client, int]]:
    data = tmp_path_factory.mktemp("figures")
    q = 0.4 * np.sin(np.arange(COUNT) * 1e-3)
    q[70_123] = 2.0
    with closing(open_database(data)) as database:
        run = store_run(database, {"q": q, "S": np.where(np.arange(COUNT) < 1000, np.nan, 8.0)})
    with running_service(data, params="ideal") as service, client_with(service, "viewer-token") as viewer:
        yield viewer, run


def lines(response: httpx.Response) -> list[dict[str, Any]]:
    assert response.headers["content-type"] == "application/x-ndjson"
    return [json.loads(line) for line in response.raise_for_status().iter_lines()]


def test_statistics_come_in_lines_the_last_of_which_is_the_result(stored: tuple[httpx.Client, int]) -> None:
    client, run = stored
    *under_way, last = lines(client.get(f"/api/runs/{run}/statistics", params={"signals": "q,S"}))
    assert [line["result"] for line in under_way] == [None] * len(under_way)
    assert len(under_way) >= 2
    result = last["result"]
    assert (result["samples"], result["missing"], result["to_s"]) == (COUNT, 0, pytest.approx((COUNT - 1) * T_s))
    q, stiffness = result["signals"]["q"], result["signals"]["S"]
    assert (q["maximum"], q["maximum_s"], q["values"]) == (2.0, pytest.approx(70.123), COUNT)
    assert (stiffness["without_value"], stiffness["values"], stiffness["mean"]) == (1000, COUNT - 1000, 8.0)


def test_spectra_say_how_they_were_computed(stored: tuple[httpx.Client, int]) -> None:
    client, run = stored
    result = lines(client.get(f"/api/runs/{run}/spectra", params={"signals": "q,S", "from": 2.0}))[-1]["result"]
    assert (result["method"], result["window"], result["overlap"]) == ("Welch", "Hann", 0.5)
    q = result["signals"]["q"]
    assert len(q["density"]) == q["segment"] // 2 - 1
    assert (q["values"], q["unit"]) == (COUNT - 2000, "rad")


def test_a_range_is_a_file_of_every_sample(stored: tuple[httpx.Client, int]) -> None:
    client, run = stored
    answer = client.get(f"/api/runs/{run}/range.csv", params={"from": 69.0, "to": 71.0, "signals": "q,S"})
    assert f"sinew-run-{run}-69.000-to-71.000-s.csv" in answer.headers["content-disposition"]
    rows = [line for line in answer.text.splitlines() if not line.startswith("#")]
    assert rows[0] == "t,q,S"
    assert len(rows) == 1 + 2001
    assert rows[1 + 1123].startswith("70.123,2")


def test_values_are_those_of_the_samples_at_or_before(stored: tuple[httpx.Client, int]) -> None:
    client, run = stored
    asked = client.get(f"/api/runs/{run}/values", params={"at": [0.5, 70.1234], "signals": "q,S"})
    first, second = asked.raise_for_status().json()["moments"]
    assert (first["values"]["S"], second["t"], second["values"]["q"]) == (None, pytest.approx(70.123), 2.0)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize(
    ("params", "status", "told"),
    [
        ({"from": 500.0}, 422, {"quantity": "from", "value": 500.0, "maximum": 119.999, "unit": "s"}),
        ({"from": 3.0, "to": 2.0}, 422, {"quantity": "to", "value": 2.0, "minimum": 3.0, "unit": "s"}),
        ({"to": 121.0}, 422, {"quantity": "to", "value": 121.0, "maximum": 119.999, "unit": "s"}),
        ({"signals": "q,nonsense"}, 422, {}),
    ],
)
def test_a_bad_range_is_refused_before_anything_is_sent(
    stored: tuple[httpx.Client, int], kind: str, params: dict[str, Any], status: int, told: dict[str, Any]
) -> None:
    client, run = stored
    response = client.get(f"/api/runs/{run}/{kind}", params=params)
    assert response.status_code == status
    refused = problem(response)
    assert {name: refused[name] for name in told} == pytest.approx(told)
    assert client.get(f"/api/runs/{run + 1}/{kind}").status_code == 404


def test_a_range_that_is_left_makes_place_for_others(stored: tuple[httpx.Client, int]) -> None:
    """More of them than are read at a time, each left after its first line: the next one is answered all the same."""
    client, run = stored
    for _ in range(20):
        with client.stream("GET", f"/api/runs/{run}/statistics", params={"signals": ",".join(STORED_NAMES)}) as begun:
            assert begun.status_code == 200
            next(begun.iter_bytes())
    end = time.monotonic() + PATIENCE_S
    while (answer := client.get(f"/api/runs/{run}/statistics", params={"signals": "q"})).status_code == 429:
        assert time.monotonic() < end
    assert lines(answer)[-1]["result"]["samples"] == COUNT
