"""Searching, tagging and comparing runs through the interface, on the running service."""

from typing import Any

import httpx
import pytest

from tests.api.conftest import problem, until

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


def test_a_run_in_the_list_has_the_verdict_and_a_figure_of_its_result(
    operator: httpx.Client, played: list[int]
) -> None:
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


def test_a_search_that_says_nothing_is_refused(operator: httpx.Client, played: list[int]) -> None:
    for where, said in (
        ("durtion_s < 5", "character 1: no stored run has a 'durtion_s'"),
        ("kind = sequense", "did you mean sequence"),
        ("(a", "character 1: the bracket is not closed"),
        ("a " * 600, "1000 characters at most"),
    ):
        refused = operator.get("/api/runs", params={"where": where})
        assert (refused.status_code, problem(refused)["code"]) == (422, "bad_search")
        assert said in problem(refused)["message"]
    assert played


def test_tags_that_are_none_and_runs_that_are_not_there_are_refused(operator: httpx.Client, played: list[int]) -> None:
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


def test_runs_are_compared_by_what_each_of_them_shows(operator: httpx.Client, played: list[int]) -> None:
    shown = [metrics(operator, run) for run in played]
    asked: dict[str, Any] = {"run": played, "reference": played[1]}
    told = operator.get("/api/run-comparison", params=asked).raise_for_status().json()
    assert (told["reference"], [run["id"] for run in told["runs"]]) == (played[1], played)
    assert [metric["name"] for metric in told["metrics"]] == list(shown[1])
    for metric in told["metrics"]:
        first, second = (of_run[metric["name"]]["value"] for of_run in shown)
        values = metric["values"]
        assert [one["value"] for one in values] == [first, second]
        assert values[0]["difference"] == (None if None in (first, second) else first - second)
        assert values[1]["difference"] == (None if second is None else 0.0)
    assert any(metric["values"][0]["difference"] for metric in told["metrics"])


def test_settings_that_differ_are_those_that_the_runs_tell(operator: httpx.Client, played: list[int]) -> None:
    told = operator.get("/api/run-comparison", params={"run": played}).raise_for_status().json()
    shown = [operator.get(f"/api/runs/{run}").raise_for_status().json()["settings"] for run in played]
    each = [{f"{one['meaning']} {one['symbol']}": one["value"] for one in settings} for settings in shown]
    differing = {name: [one[name] for one in each] for name in each[0] if each[0][name] != each[1][name]}
    assert differing
    assert {one["name"]: one["values"] for one in told["settings"]} == differing


def test_differences_and_files_are_those_of_the_samples(operator: httpx.Client, played: list[int]) -> None:
    asked: dict[str, Any] = {"run": played, "signal": "q_ref", "points": 20000, "band": 0.05}
    told = operator.get("/api/run-comparison/differences", params=asked).raise_for_status().json()
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
    [found] = told["runs"]
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


def test_comparisons_of_nothing_are_refused(operator: httpx.Client, played: list[int]) -> None:
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


def test_a_metric_over_dates_is_that_of_each_run(operator: httpx.Client, played: list[int]) -> None:
    where = f"run >= {played[0]} run <= {played[1]}"
    told = operator.get("/api/metric-history", params={"kind": "sequence", "where": where}).raise_for_status().json()
    assert [one["name"] for one in told["metrics"]] == list(metrics(operator, played[1]))
    for metric in told["metrics"]:
        asked = {"kind": "sequence", "where": where, "metric": metric["name"]}
        history = operator.get("/api/metric-history", params=asked).raise_for_status().json()
        values = {run: metrics(operator, run)[metric["name"]]["value"] for run in played}
        assert {point["run"]: point["value"] for point in history["points"]} == {
            run: value for run, value in values.items() if value is not None
        }
        assert history["without"] == sum(value is None for value in values.values())
    asked = {"kind": "sequence", "where": where, "metric": "nonsense"}
    assert problem(operator.get("/api/metric-history", params=asked))["code"] == "bad_search"


def test_what_can_be_asked_for_is_told(operator: httpx.Client, played: list[int]) -> None:
    words = operator.get("/api/run-words").raise_for_status().json()
    assert (words["station"], words["stations"]) == ("", [""])
    assert set(metrics(operator, played[0])) - unmeasured(operator, played) <= set(words["values"]["metric"])
    assert "geometry.r_j" in words["values"]["parameter"]


def metrics(client: httpx.Client, run: int) -> dict[str, dict[str, Any]]:
    experiment = client.get(f"/api/experiments/{run}").raise_for_status().json()
    return {metric["name"]: metric for metric in experiment["metrics"]}


def unmeasured(client: httpx.Client, played: list[int]) -> set[str]:
    return {name for run in played for name, metric in metrics(client, run).items() if metric["value"] is None}
