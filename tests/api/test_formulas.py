"""Derived signals through the interface: written, read with recordings, compared, exported, removed."""

import csv
import io
import json
import math
from typing import Any

import httpx
import numpy as np
import pytest

from tests.api.conftest import ended, problem, until

pytestmark = pytest.mark.live


def put(client: httpx.Client, name: str, expression: str, unit: str = "N", meaning: str = "") -> httpx.Response:
    return client.put(f"/api/formulas/{name}", json={"expression": expression, "unit": unit, "meaning": meaning})


def recorded(operator: httpx.Client) -> int:
    """Record a run of some seconds."""
    operator.post("/api/stop").raise_for_status()
    operator.post("/api/reset").raise_for_status()
    operator.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    until(lambda: operator.get("/api/state").json()["pretension_done"])
    operator.post("/api/mode", json={"mode": "run"}).raise_for_status()
    number = until(lambda: operator.get("/api/state").json()["recording_run"])
    operator.put("/api/references", json={"q_ref": 0.2, "S_ref": 10.0}).raise_for_status()
    until(lambda: operator.get(f"/api/runs/{number}").json()["duration_s"] > 2.0)
    operator.post("/api/mode", json={"mode": "stopping"}).raise_for_status()
    ended(operator, number)
    return int(number)


@pytest.fixture(scope="module")
def run(operator: httpx.Client) -> int:
    """A recorded run."""
    return recorded(operator)


@pytest.fixture(scope="module")
def another(operator: httpx.Client, run: int) -> int:
    """A run after it."""
    return recorded(operator)


def samples(client: httpx.Client, run: int, signals: str, **asked: Any) -> dict[str, Any]:
    answer = client.get(f"/api/runs/{run}/samples", params={"signals": signals, **asked})
    return dict(answer.raise_for_status().json())


def column(told: dict[str, Any], name: str) -> Any:
    return np.array([math.nan if value is None else value for value in told["signals"][name]["minimum"]])


def test_it_is_read_with_a_recording_as_its_formula_says(operator: httpx.Client, run: int) -> None:
    told = put(operator, "F_mean", "(F_A + F_B) / 2", meaning="mean tension").raise_for_status().json()
    assert (told["name"], told["unit"], told["who"], told["signals"]) == ("F_mean", "N", "operator", ["F_A", "F_B"])
    raw = samples(operator, run, "F_mean,F_A,F_B", **{"from": 1.0, "to": 1.5, "points": 2000})
    assert (raw["raw"], raw["signals"]["F_mean"]["unit"]) == (True, "N")
    np.testing.assert_allclose(column(raw, "F_mean"), (column(raw, "F_A") + column(raw, "F_B")) / 2, rtol=1e-6)
    envelope = samples(operator, run, "F_mean", points=10)
    assert not envelope["raw"]
    whole = samples(operator, run, "F_mean", points=20000)
    assert np.nanmin(column(whole, "F_mean")) == np.nanmin(column(envelope, "F_mean"))


def test_a_division_by_zero_is_a_gap(operator: httpx.Client, run: int) -> None:
    put(operator, "odd", "1 / (q - q)", "1").raise_for_status()
    assert np.isnan(column(samples(operator, run, "odd"), "odd")).all()


def test_its_statistics_are_those_of_every_sample(operator: httpx.Client, run: int) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    asked: dict[str, Any] = {"signals": "F_mean", "from": 1.0, "to": 1.5}
    lines = operator.get(f"/api/runs/{run}/statistics", params=asked).raise_for_status().text.splitlines()
    told = json.loads(lines[-1])["result"]["signals"]["F_mean"]
    raw = column(samples(operator, run, "F_mean", **{"from": 1.0, "to": 1.501, "points": 2000}), "F_mean")
    assert (told["unit"], told["values"]) == ("N", 501)
    assert told["mean"] == pytest.approx(raw.mean(), rel=1e-6)
    assert (told["minimum"], told["maximum"]) == (raw.min(), raw.max())


def test_runs_are_compared_by_it(operator: httpx.Client, run: int, another: int) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    asked: dict[str, Any] = {"run": [run, another], "signal": "F_mean"}
    told = operator.get("/api/run-comparison/differences", params=asked).raise_for_status().json()
    assert (told["unit"], told["signal"]) == ("N", "F_mean")
    assert told["runs"][0]["compared_s"] > 1.0


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat"])
def test_exports_have_it_behind_the_recorded_columns_where_asked_for(
    operator: httpx.Client, run: int, kind: str
) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    answer = operator.get(f"/api/runs/{run}/data.{kind}", params={"formulas": "F_mean"}).raise_for_status()
    assert b"F_mean" in answer.content
    if kind == "csv":
        lines = [line for line in io.StringIO(answer.text) if not line.startswith("#")]
        rows = list(csv.DictReader(lines))
        assert list(rows[0])[-1] == "F_mean"
        made = [float(row["F_mean"]) for row in rows]
        np.testing.assert_allclose(made, [(float(row["F_A"]) + float(row["F_B"])) / 2 for row in rows], rtol=1e-5)
    assert b"F_mean" not in operator.get(f"/api/runs/{run}/data.{kind}").raise_for_status().content


def test_a_change_counts_at_once_and_a_removed_one_is_no_signal(operator: httpx.Client, run: int) -> None:
    put(operator, "twice", "2 * q", "rad").raise_for_status()
    put(operator, "twice", "q + q + 1", "rad").raise_for_status()
    told = samples(operator, run, "twice,q", **{"from": 1.0, "to": 1.1})
    np.testing.assert_allclose(column(told, "twice"), 2 * column(told, "q") + 1, rtol=1e-6)
    operator.delete("/api/formulas/twice").raise_for_status()
    assert "twice" not in [one["name"] for one in operator.get("/api/formulas").json()["formulas"]]
    assert operator.get(f"/api/runs/{run}/samples", params={"signals": "twice"}).status_code == 422
    assert operator.delete("/api/formulas/twice").status_code == 404


@pytest.mark.parametrize(
    ("name", "expression", "said"),
    [
        ("made", "F_C * 2", "the nearest is F_"),
        ("made", "q +", "is no expression"),
        ("q", "2 * S", "cannot name a formula"),
        ("f_Mean", "q", "differs from 'F_mean' by case only"),
    ],
)
def test_what_is_wrong_is_refused_in_words(operator: httpx.Client, name: str, expression: str, said: str) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    refused = put(operator, name, expression)
    assert (refused.status_code, problem(refused)["code"]) == (422, "bad_formula")
    assert said in problem(refused)["message"]


def test_a_layout_of_the_charts_may_show_it_with_signals_of_its_unit(operator: httpx.Client) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    kept = operator.get("/api/preferences").raise_for_status().json()
    panel = {"title": "Mean", "signals": ["F_mean", "F_A"], "over": None, "share": 1.0}
    layout = {"version": 1, "name": "Own", "panels": [panel]}
    operator.put("/api/preferences", json=kept | {"layouts": [layout], "layout": "Own"}).raise_for_status()
    operator.put("/api/preferences", json=kept).raise_for_status()


def test_a_viewer_reads_and_writes_none(viewer: httpx.Client) -> None:
    assert viewer.get("/api/formulas").status_code == 200
    assert put(viewer, "made", "q").status_code == 403
    assert viewer.delete("/api/formulas/made").status_code == 403
