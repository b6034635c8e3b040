"""Stored runs through the interface: search, comparison, derived signals, downloads, lineage."""

import csv
import io
import json
import math
import zipfile
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import httpx
import numpy as np
import pandas
import pytest

from backend.banks.tuning_settings import saved_tuning_key
from backend.experiments.messages import invalid_formula_name, not_an_expression, unknown_signal
from backend.exports.importer import import_bundle
from backend.exports.importer import import_export as take_in_samples
from backend.exports.mcap import foxglove_layout
from backend.models.run import SAVED_TUNING, SavedLoopSettings
from backend.schemas.run import ChecklistState
from backend.services import record_messages
from backend.services.lineage import build_checklist
from backend.storage import banks, identifications, runs, settings
from backend.storage import messages as search_messages
from backend.storage.banks import BankEntry
from backend.storage.database import Database, open_database
from backend.storage.identifications import NewIdentification
from backend.storage.runs import EndState, NewRun, RunKind
from backend.units import AngleUnit, format_text
from tests.api.conftest import ended, problem, until, wait_for, wait_until_present
from tests.e2e.service import Service
from tests.models.earlier_identifications import ACTUATOR

# Downloads of samples: streams that are rejected before they begin, and end when the client disconnects.


@pytest.fixture(scope="module")
def run(operator: httpx.Client) -> int:
    operator.post("/api/stop").raise_for_status()
    operator.post("/api/reset").raise_for_status()
    operator.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    wait_for(operator, "pretension_done", True)
    operator.post("/api/mode", json={"mode": "run"}).raise_for_status()
    number = int(wait_until_present(operator, "recording_run")["recording_run"])
    operator.post("/api/stop").raise_for_status()
    ended(operator, number)
    return number


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat", "mcap"])
def test_every_export_format_can_be_imported(operator: httpx.Client, run: int, kind: str, tmp_path: Path) -> None:
    answer = operator.get(f"/api/runs/{run}/data.{kind}").raise_for_status()
    assert answer.headers["content-disposition"] == f'attachment; filename="sinew-run-{run}.{kind}"'
    assert "content-length" not in answer.headers  # a stream
    (tmp_path / f"run.{kind}").write_bytes(answer.content)
    database = open_database(tmp_path / "empty")
    assert take_in_samples(database, tmp_path / f"run.{kind}", "Ben").new
    database.close()


def test_a_bundle_can_be_imported_into_another_database(operator: httpx.Client, run: int, tmp_path: Path) -> None:
    file = tmp_path / "run.zip"
    file.write_bytes(operator.get(f"/api/runs/{run}/bundle.zip").raise_for_status().content)
    assert f"recordings/{run}.parquet" in zipfile.ZipFile(file).namelist()
    database = open_database(tmp_path / "empty")
    taken = import_bundle(database, file, "Ben", tmp_path)
    with database.reading() as session:
        assert runs.get(session, taken.run).kind == "session"
    database.close()


def test_downloads_of_missing_runs_are_rejected_before_the_first_byte(
    operator: httpx.Client, viewer: httpx.Client
) -> None:
    for path in ("data.csv", "data.mcap", "bundle.zip"):
        assert operator.get(f"/api/runs/999999/{path}").status_code == 404
    assert viewer.get("/api/runs/foxglove-layout.json").raise_for_status().text == foxglove_layout()


def test_a_viewer_can_download_runs_of_the_operator(viewer: httpx.Client, run: int) -> None:
    text = viewer.get(f"/api/runs/{run}/data.csv").raise_for_status().text
    table = pandas.read_csv(io.StringIO(text), comment="#")
    np.testing.assert_allclose(np.diff(table["t"]), 1e-3, atol=1e-9)


def test_an_abandoned_download_leaves_no_process(service: Service, operator: httpx.Client, run: int) -> None:
    with operator.stream("GET", f"/api/runs/{run}/data.csv") as answer:
        next(answer.iter_bytes(64))
    until(lambda: True if not _writers(service) else None)


def _writers(service: Service) -> list[str]:
    """Return the processes of the service that write a download."""
    found = []
    for task in Path(f"/proc/{service.pid}/task").iterdir():
        for child in (task / "children").read_text(encoding="ascii").split():
            status = Path(f"/proc/{child}/cmdline").read_bytes()
            if task.name != str(service.pid) and b"multiprocessing.spawn" in status:
                found.append(child)
    return found


# Search, tags and comparison of runs through the interface, on the running service.

SEGMENTS = '[{{"duration_s": 1, "q_ref": {q_ref}, "S_ref": 10}}]'


@pytest.fixture(scope="module")
def played(operator: httpx.Client) -> list[int]:
    """Two sequences with their results."""
    operator.post("/api/stop").raise_for_status()
    operator.post("/api/reset").raise_for_status()
    for q_ref in (0.1, 0.2):
        item = {"name": "sequence", "settings": {"segments": SEGMENTS.format(q_ref=q_ref)}}
        operator.post("/api/experiments/queue", json=item).raise_for_status()
    first = operator.post("/api/experiments/queue/run").raise_for_status().json()["run"]

    def over() -> bool:
        queue = operator.get("/api/experiments/queue").raise_for_status().json()
        assert queue["problem"] == ""
        return not queue["items"] and not queue["run"]

    until(over)
    until(lambda: [one["id"] for one in newest(operator) if one["evaluation"] == "done"] == [first + 1, first])
    return [first, first + 1]


def newest(client: httpx.Client) -> list[dict[str, Any]]:
    return list(client.get("/api/runs", params={"limit": 2}).raise_for_status().json()["runs"])


def found(client: httpx.Client, *where: str) -> list[int]:
    answer = client.get("/api/runs", params={"where": list(where), "limit": 500}).raise_for_status().json()
    assert answer["total"] == len(answer["runs"])
    return [run["id"] for run in answer["runs"]]


def test_runs_are_found_by_tags_and_all_parts_of_a_search(operator: httpx.Client, played: list[int]) -> None:
    first, second = played
    for run, tag in ((first, "Paper"), (second, "paper"), (second, "Größe")):
        answer = operator.post(f"/api/runs/{run}/tags", json={"tag": tag}).raise_for_status().json()
    assert answer["tags"] == ["grösse", "paper"]
    assert found(operator, "tag = PAPER") == [second, first]
    assert found(operator, "tag = paper", "", f"run < {second}") == [first]
    assert found(operator, f"kind = sequence run >= {first}", "not tag = größe") == [first]
    renamed = operator.patch("/api/run-tags/paper", json={"tag": "figure-7"}).raise_for_status().json()
    assert renamed["tags"] == ["figure-7", "grösse"]
    assert operator.delete(f"/api/runs/{first}/tags/figure-7").raise_for_status().json()["tags"] == []
    assert found(operator, "tag = figure-7") == [second]
    for run, tag in ((second, "figure-7"), (second, "grösse")):
        operator.delete(f"/api/runs/{run}/tags/{tag}").raise_for_status()
    assert problem(operator.patch("/api/run-tags/figure-7", json={"tag": "x"}))["code"] == "not_found"


def test_a_listed_run_has_its_verdict_and_a_metric(operator: httpx.Client, played: list[int]) -> None:
    for run in newest(operator):
        result = operator.get(f"/api/experiments/{run['id']}").raise_for_status().json()
        assert run["outcome"] == result["outcome"]
        figures = {one["name"]: one["value"] for one in (*result["criteria"], *result["metrics"])}
        assert run["headline"]["value"] == figures[run["headline"]["name"]]
        assert run["id"] in found(operator, f"verdict = {run['outcome']}")


def test_one_report_of_both_runs(operator: httpx.Client, played: list[int]) -> None:
    page = operator.get("/api/run-comparison/report.html", params={"run": played}).raise_for_status()
    assert "script" not in page.headers["content-security-policy"]
    assert f"Runs {played[0]}, {played[1]}" in page.text
    pdf = operator.get("/api/run-comparison/report.pdf", params={"run": played}).raise_for_status()
    assert pdf.content.startswith(b"%PDF-")
    one = operator.get("/api/run-comparison/report.html", params={"run": played[:1]})
    assert problem(one)["message"].startswith("number of runs: 1 is outside 2 to 100")
    assert operator.get("/api/run-comparison/report.html", params={"run": [played[0], 10**9]}).status_code == 404


def in_search(reason: str) -> str:
    """Return a message about the first character of a search."""
    return search_messages.invalid_search(place=0, reason=reason, near=[], known=[])


def test_an_invalid_search_is_rejected(operator: httpx.Client, played: list[int]) -> None:
    for where, expected in (
        ("durtion_s < 5", in_search(search_messages.name_in_no_run(name="durtion_s"))),
        ("kind = sequense", "did you mean sequence"),
        ("(a", in_search(search_messages.bracket_not_closed())),
        ("a " * 600, "1000 characters at most"),
    ):
        refused = operator.get("/api/runs", params={"where": where})
        assert (refused.status_code, problem(refused)["code"]) == (422, "bad_search")
        assert expected in problem(refused)["message"]
    assert played


def test_invalid_tags_and_missing_runs_are_rejected(operator: httpx.Client, played: list[int]) -> None:
    refused = operator.post(f"/api/runs/{played[0]}/tags", json={"tag": "two words"})
    assert (refused.status_code, problem(refused)["code"]) == (422, "bad_tag")
    assert operator.post("/api/runs/999999/tags", json={"tag": "a"}).status_code == 404
    assert operator.post(f"/api/runs/{played[0]}/tags", json={}).status_code == 422


def test_searches_are_saved_under_names(operator: httpx.Client, viewer: httpx.Client, played: list[int]) -> None:
    where = f'kind = "sequence" run >= {played[0]}'
    saved = operator.put("/api/saved-searches/of this test", json={"where": where}).raise_for_status().json()
    assert [(one["name"], one["where"]) for one in saved["searches"]] == [("of this test", where)]
    operator.put("/api/saved-searches/of this test", json={"where": "sequence"}).raise_for_status()
    listed = viewer.get("/api/saved-searches").raise_for_status().json()["searches"]
    assert [one["where"] for one in listed] == ["sequence"]
    assert viewer.put("/api/saved-searches/mine", json={"where": ""}).status_code == 403
    assert problem(operator.put("/api/saved-searches/bad", json={"where": "(("}))["code"] == "bad_search"
    assert operator.put(f"/api/saved-searches/{'x' * 61}", json={"where": ""}).status_code == 422
    assert operator.delete("/api/saved-searches/of this test").raise_for_status().json()["searches"] == []
    assert operator.delete("/api/saved-searches/of this test").status_code == 404


def test_runs_are_compared_by_their_metrics(operator: httpx.Client, played: list[int]) -> None:
    shown = [metrics(operator, run) for run in played]
    asked: dict[str, Any] = {"run": played, "reference": played[1]}
    comparison = operator.get("/api/run-comparison", params=asked).raise_for_status().json()
    assert (comparison["reference"], [run["id"] for run in comparison["runs"]]) == (played[1], played)
    assert [metric["name"] for metric in comparison["metrics"]] == list(shown[1])
    for metric in comparison["metrics"]:
        first, second = (of_run[metric["name"]]["value"] for of_run in shown)
        values = metric["values"]
        assert [one["value"] for one in values] == [first, second]
        assert values[0]["difference"] == (None if None in (first, second) else first - second)
        assert values[1]["difference"] == (None if second is None else 0.0)
    assert any(metric["values"][0]["difference"] for metric in comparison["metrics"])


def test_different_settings_are_those_of_the_runs(operator: httpx.Client, played: list[int]) -> None:
    comparison = operator.get("/api/run-comparison", params={"run": played}).raise_for_status().json()
    shown = [operator.get(f"/api/runs/{run}").raise_for_status().json()["settings"] for run in played]
    each = [{f"{one['meaning']} {one['symbol']}": one["value"] for one in settings} for settings in shown]
    differing = {name: [one[name] for one in each] for name in each[0] if each[0][name] != each[1][name]}
    compared = {one["name"]: one["values"] for one in comparison["settings"]}
    texts = compared.pop("text of the experiment, sha256")
    assert len(set(texts)) == 2
    assert compared == {**differing, "experiment.phases[0].parts[0].q_ref": [0.1, 0.2]}
    assert {one["unit"] for one in comparison["settings"] if one["name"].startswith("experiment.")} == {"rad"}


def test_differences_and_files_are_those_of_the_samples(operator: httpx.Client, played: list[int]) -> None:
    asked: dict[str, Any] = {"run": played, "signal": "q_ref", "points": 20000, "band": 0.05}
    comparison = operator.get("/api/run-comparison/differences", params=asked).raise_for_status().json()
    columns = []
    for run in played:
        every = f"/api/runs/{run}/samples?points=20000&signals=q_ref"
        answer = operator.get(every).raise_for_status().json()
        assert answer["raw"]
        columns.append(
            dict(zip((round(t * 1e3) for t in answer["t"]), answer["signals"]["q_ref"]["minimum"], strict=True))
        )
    apart = [
        None if columns[0][k] is None or columns[1].get(k) is None else columns[1][k] - columns[0][k]
        for k in sorted(columns[0])
    ]
    [found] = comparison["runs"]
    assert found["minimum"] == apart
    assert any(apart)
    outside = [k for k, value in enumerate(apart) if value is not None and abs(value) > 0.05]
    assert found["outside_s"] == pytest.approx(len(outside) * 1e-3)
    assert found["left_at_s"] == pytest.approx(outside[0] * 1e-3)
    curves = operator.get("/api/run-comparison/curves.csv", params=asked).raise_for_status()
    rows = [line.split(",") for line in curves.text.splitlines() if not line.startswith("#")]
    assert rows[0] == ["t", *(f"q_ref_run_{run}" for run in played), f"d_q_ref_run_{played[1]}"]
    assert [None if row[3] == "nan" else float(row[3]) for row in rows[1:]] == apart
    table = operator.get("/api/run-comparison/table.csv", params={"run": played}).raise_for_status()
    assert "metric,peak_voltage_V,Peak voltage,V" in table.text


def test_invalid_comparisons_are_rejected(operator: httpx.Client, played: list[int]) -> None:
    refused: tuple[tuple[dict[str, Any], int], ...] = (
        ({"run": played[:1]}, 422),
        ({"run": [played[0]] * 3}, 422),
        ({"run": list(range(1, 23))}, 422),
        ({"run": played, "reference": 999999}, 422),
        ({"run": [*played, 999999]}, 404),
        ({}, 422),
    )
    for asked, status in refused:
        for part in ("", "/differences", "/curves.csv", "/table.csv"):
            assert operator.get(f"/api/run-comparison{part}", params=asked).status_code == status, part
    assert operator.get("/api/run-comparison/differences", params={"run": played, "signal": "x"}).status_code == 422
    assert operator.get("/api/run-comparison", params={"run": played, "by": "x"}).status_code == 422


def test_the_history_of_a_metric_has_the_value_of_each_run(operator: httpx.Client, played: list[int]) -> None:
    where = f"run >= {played[0]} run <= {played[1]}"
    metric_history = (
        operator.get("/api/metric-history", params={"kind": "sequence", "where": where}).raise_for_status().json()
    )
    assert [one["name"] for one in metric_history["metrics"]] == list(metrics(operator, played[1]))
    for metric in metric_history["metrics"]:
        asked = {"kind": "sequence", "where": where, "metric": metric["name"]}
        history = operator.get("/api/metric-history", params=asked).raise_for_status().json()
        values = {run: metrics(operator, run)[metric["name"]]["value"] for run in played}
        assert {point["run"]: point["value"] for point in history["points"]} == {
            run: value for run, value in values.items() if value is not None
        }
        assert history["without"] == sum(value is None for value in values.values())
    asked = {"kind": "sequence", "where": where, "metric": "nonsense"}
    assert problem(operator.get("/api/metric-history", params=asked))["code"] == "bad_search"


def test_the_terms_of_a_search_are_listed(operator: httpx.Client, played: list[int]) -> None:
    words = operator.get("/api/run-words").raise_for_status().json()
    assert (words["station"], words["stations"]) == ("", [""])
    assert set(metrics(operator, played[0])) - unmeasured(operator, played) <= set(words["values"]["metric"])
    assert "geometry.r_j" in words["values"]["parameter"]


def metrics(client: httpx.Client, run: int) -> dict[str, dict[str, Any]]:
    experiment = client.get(f"/api/experiments/{run}").raise_for_status().json()
    return {metric["name"]: metric for metric in experiment["metrics"]}


def unmeasured(client: httpx.Client, played: list[int]) -> set[str]:
    return {name for run in played for name, metric in metrics(client, run).items() if metric["value"] is None}


# Derived signals through the interface: stored, read with recordings, compared, exported, removed.


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
def run_formulas(operator: httpx.Client) -> int:
    """A recorded run."""
    return recorded(operator)


@pytest.fixture(scope="module")
def another(operator: httpx.Client, run_formulas: int) -> int:
    """A second run."""
    return recorded(operator)


def samples(client: httpx.Client, run: int, signals: str, **asked: Any) -> dict[str, Any]:
    answer = client.get(f"/api/runs/{run}/samples", params={"signals": signals, **asked})
    return dict(answer.raise_for_status().json())


def column(answer: dict[str, Any], name: str) -> Any:
    return np.array([math.nan if value is None else value for value in answer["signals"][name]["minimum"]])


def test_a_derived_signal_is_computed_by_its_formula(operator: httpx.Client, run_formulas: int) -> None:
    answer = put(operator, "F_mean", "(F_A + F_B) / 2", meaning="mean tension").raise_for_status().json()
    assert (answer["name"], answer["unit"], answer["who"], answer["signals"]) == (
        "F_mean",
        "N",
        "operator",
        ["F_A", "F_B"],
    )
    raw = samples(operator, run_formulas, "F_mean,F_A,F_B", **{"from": 1.0, "to": 1.5, "points": 2000})
    assert (raw["raw"], raw["signals"]["F_mean"]["unit"]) == (True, "N")
    np.testing.assert_allclose(column(raw, "F_mean"), (column(raw, "F_A") + column(raw, "F_B")) / 2, rtol=1e-6)
    envelope = samples(operator, run_formulas, "F_mean", points=10)
    assert not envelope["raw"]
    whole = samples(operator, run_formulas, "F_mean", points=20000)
    assert np.nanmin(column(whole, "F_mean")) == np.nanmin(column(envelope, "F_mean"))


def test_a_division_by_zero_is_a_gap(operator: httpx.Client, run_formulas: int) -> None:
    put(operator, "odd", "1 / (q - q)", "1").raise_for_status()
    assert np.isnan(column(samples(operator, run_formulas, "odd"), "odd")).all()


def test_statistics_of_a_derived_signal_use_every_sample(operator: httpx.Client, run_formulas: int) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    asked: dict[str, Any] = {"signals": "F_mean", "from": 1.0, "to": 1.5}
    lines = operator.get(f"/api/runs/{run_formulas}/statistics", params=asked).raise_for_status().text.splitlines()
    statistics = json.loads(lines[-1])["result"]["signals"]["F_mean"]
    raw = column(samples(operator, run_formulas, "F_mean", **{"from": 1.0, "to": 1.501, "points": 2000}), "F_mean")
    assert (statistics["unit"], statistics["values"]) == ("N", 501)
    assert statistics["mean"] == pytest.approx(raw.mean(), rel=1e-6)
    assert (statistics["minimum"], statistics["maximum"]) == (raw.min(), raw.max())


def test_runs_are_compared_by_a_derived_signal(operator: httpx.Client, run_formulas: int, another: int) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    asked: dict[str, Any] = {"run": [run_formulas, another], "signal": "F_mean"}
    comparison = operator.get("/api/run-comparison/differences", params=asked).raise_for_status().json()
    assert (comparison["unit"], comparison["signal"]) == ("N", "F_mean")
    assert comparison["runs"][0]["compared_s"] > 1.0


@pytest.mark.parametrize("kind", ["csv", "parquet", "mat"])
def test_exports_append_derived_signals_on_request(operator: httpx.Client, run_formulas: int, kind: str) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    answer = operator.get(f"/api/runs/{run_formulas}/data.{kind}", params={"formulas": "F_mean"}).raise_for_status()
    assert b"F_mean" in answer.content
    if kind == "csv":
        lines = [line for line in io.StringIO(answer.text) if not line.startswith("#")]
        rows = list(csv.DictReader(lines))
        assert list(rows[0])[-1] == "F_mean"
        made = [float(row["F_mean"]) for row in rows]
        np.testing.assert_allclose(made, [(float(row["F_A"]) + float(row["F_B"])) / 2 for row in rows], rtol=1e-5)
    assert b"F_mean" not in operator.get(f"/api/runs/{run_formulas}/data.{kind}").raise_for_status().content


def test_changes_and_deletions_of_derived_signals_apply_immediately(operator: httpx.Client, run_formulas: int) -> None:
    put(operator, "twice", "2 * q", "rad").raise_for_status()
    put(operator, "twice", "q + q + 1", "rad").raise_for_status()
    answer = samples(operator, run_formulas, "twice,q", **{"from": 1.0, "to": 1.1})
    np.testing.assert_allclose(column(answer, "twice"), 2 * column(answer, "q") + 1, rtol=1e-6)
    operator.delete("/api/formulas/twice").raise_for_status()
    assert "twice" not in [one["name"] for one in operator.get("/api/formulas").json()["formulas"]]
    assert operator.get(f"/api/runs/{run_formulas}/samples", params={"signals": "twice"}).status_code == 422
    assert operator.delete("/api/formulas/twice").status_code == 404


@pytest.mark.parametrize(
    ("name", "expression", "expected"),
    [
        ("made", "F_C * 2", unknown_signal(name="F_C", nearest="F_")),
        ("made", "q +", not_an_expression(expression="q +")),
        ("q", "2 * S", invalid_formula_name(name="q").partition(":")[0]),
        ("f_Mean", "q", "differs from 'F_mean' only in case"),
    ],
)
def test_an_invalid_formula_is_rejected_with_a_message(
    operator: httpx.Client, name: str, expression: str, expected: str
) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    refused = put(operator, name, expression)
    assert (refused.status_code, problem(refused)["code"]) == (422, "bad_formula")
    assert expected in problem(refused)["message"]


def test_a_layout_may_show_a_derived_signal_with_signals_of_its_unit(operator: httpx.Client) -> None:
    put(operator, "F_mean", "(F_A + F_B) / 2").raise_for_status()
    preferences = operator.get("/api/preferences").raise_for_status().json()
    panel = {"title": "Mean", "signals": ["F_mean", "F_A"], "over": None, "share": 1.0}
    layout = {"version": 1, "name": "Own", "panels": [panel]}
    operator.put("/api/preferences", json=preferences | {"layouts": [layout], "layout": "Own"}).raise_for_status()
    operator.put("/api/preferences", json=preferences).raise_for_status()


def test_a_viewer_can_read_but_not_change_derived_signals(viewer: httpx.Client) -> None:
    assert viewer.get("/api/formulas").status_code == 200
    assert put(viewer, "made", "q").status_code == 403
    assert viewer.delete("/api/formulas/made").status_code == 403


# Lineage, marks and checklist through the interface, and the rules of the checklist on a separate database.

PARAMETERS = {"r_m": 0.0075}


def test_a_session_has_its_origin_and_events(off: httpx.Client) -> None:
    off.post("/api/banks/geometry/activate").raise_for_status()  # another test of the service may have used a bank
    off.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
    running = off
    wait_for(running, "pretension_done", True)
    running.post("/api/mode", json={"mode": "run"}).raise_for_status()
    run = running.get("/api/state").json()["recording_run"]
    running.put("/api/references", json={"q_ref": math.radians(15.0), "S_ref": 10.25}).raise_for_status()
    running.post("/api/mode", json={"mode": "stopping"}).raise_for_status()
    wait_for(running, "mode", "off")

    def about_references() -> list[dict[str, Any]]:
        marks = running.get(f"/api/runs/{run}/marks").raise_for_status().json()["marks"]
        return [mark for mark in marks if mark["text"].startswith("q_ref ")]

    [mark] = until(about_references)  # the event log is written separately, the samples follow
    assert format_text(mark["text"], AngleUnit.DEGREES) == "q_ref 15°, S_ref 10.25 N·m/rad"
    assert 0.0 <= mark["t"] < 60.0
    assert mark["who"] == "operator"
    lineage = running.get(f"/api/runs/{run}/lineage").raise_for_status().json()
    assert (lineage["bank"], lineage["parameters_as_now"]) == (None, True)
    assert running.get("/api/runs/999999/lineage").status_code == 404
    assert running.post(f"/api/runs/{run}/replay", json={"t": 0.1}).status_code == 204
    assert running.post("/api/runs/999999/replay", json={"t": 0.1}).status_code == 404


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    with closing(open_database(tmp_path)) as opened:
        yield opened


def identified(database: Database, kind: RunKind, parameters: dict[str, Any] = PARAMETERS, S: float = 10.5) -> int:
    """Store a completed identification and return the number of its estimate."""
    run = completed(database, kind, parameters)
    new = NewIdentification(
        kind=kind.removesuffix("_identification"),
        run_id=run,
        data={},
        method="oe",
        options={},
        model=ACTUATOR["model"] | {"S_nominal": S},
        quality=ACTUATOR["quality"],
        usable=True,
        verdict="usable",
        who="a",
        software="0",
    )
    with database.session() as session:
        return identifications.add(session, new).id


def completed(
    database: Database, kind: RunKind, parameters: dict[str, Any] = PARAMETERS, bank: int | None = None
) -> int:
    with database.session() as session:
        new = NewRun(
            kind=kind,
            plant="simulator",
            parameters_name="lab",
            parameters=parameters,
            who="a",
            software="0",
            settings={},
            bank_id=bank,
        )
        run = runs.create(session, new).id
        runs.end(session, run, EndState.COMPLETED)
        return run


def built(database: Database, estimate: int) -> int:
    with database.session() as session:
        return banks.add(session, "bench", [BankEntry(10.5, {"S_nominal": 10.5}, estimate)], "a").id


def states(database: Database, in_use: int | None, parameters: dict[str, Any] = PARAMETERS) -> dict[str, str]:
    with database.reading() as session:
        return {step.name: str(step.state) for step in build_checklist(session, parameters, in_use)}


def test_the_checklist_covers_pretension_to_report(database: Database) -> None:
    assert set(states(database, None).values()) == {"missing"}
    identified(database, RunKind.MOTOR_IDENTIFICATION)
    identified(database, RunKind.SPRING_IDENTIFICATION)
    bank = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION))
    assert states(database, None)["bank"] == "missing"  # built but not active: to be done, and not out of date
    completed(database, RunKind.TRACKING, bank=bank)
    checklist = states(database, bank)
    assert (checklist.pop("report"), checklist.pop("tuning")) == ("missing", "missing")
    assert set(checklist.values()) == {"done"}


def test_the_tuning_step_is_done_once_saved_for_the_active_bank(database: Database) -> None:
    bank = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION))
    other = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION, S=14.0))
    with database.session() as session:
        value = SAVED_TUNING.write(SavedLoopSettings(lam_q=0.45, lam_S=0.1, bank=bank))
        settings.save(session, saved_tuning_key(bank), value, "Ada")
    with database.reading() as session:
        [step] = [one for one in build_checklist(session, PARAMETERS, bank) if one.name == "tuning"]
    assert (step.state, step.run) == (ChecklistState.DONE, None)
    lambdas = {"q": 0.45, "S": 0.1}
    assert step.detail == record_messages.saved_tuning(lambdas=lambdas, bank="bench v1", who="Ada")
    assert states(database, other)["tuning"] == "missing"
    assert states(database, None)["tuning"] == "missing"


def test_a_bank_older_than_the_parameters_is_out_of_date(database: Database) -> None:
    bank = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION))
    assert states(database, bank)["bank"] == "done"
    checklist = states(database, bank, {"r_m": 0.008})
    assert (checklist["actuator"], checklist["bank"]) == ("outdated", "outdated")


def test_a_new_identification_makes_later_steps_out_of_date(database: Database) -> None:
    bank = built(database, identified(database, RunKind.ACTUATOR_IDENTIFICATION))
    completed(database, RunKind.TRACKING, bank=bank)
    identified(database, RunKind.ACTUATOR_IDENTIFICATION, S=14.0)  # another operating point
    assert states(database, bank)["bank"] == "done"
    identified(database, RunKind.ACTUATOR_IDENTIFICATION)
    assert states(database, bank)["bank"] == "outdated"
    identified(database, RunKind.MOTOR_IDENTIFICATION)
    assert states(database, bank)["actuator"] == "outdated"
    assert states(database, built(database, 1))["experiment"] == "outdated"
