"""Queued experiments, and dry runs of experiments on a simulator."""

import httpx
import pytest

from backend.services import messages
from tests.api.conftest import problem, until, wait_for

SHORT = '[{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}]'
LONG = '[{"duration_s": 60, "q_ref": 0.1, "S_ref": 10}]'


@pytest.fixture(autouse=True)
def empty_queue(off: httpx.Client) -> None:
    for item in off.get("/api/experiments/queue").raise_for_status().json()["items"]:
        off.delete(f"/api/experiments/queue/{item['id']}").raise_for_status()


def add(client: httpx.Client, segments: str) -> httpx.Response:
    return client.post("/api/experiments/queue", json={"name": "sequence", "settings": {"segments": segments}})


def test_the_queue_runs_its_experiments_in_order(off: httpx.Client) -> None:
    for _ in range(2):
        assert add(off, SHORT).status_code == 201
    waiting = off.get("/api/experiments/queue").json()
    assert [item["who"] for item in waiting["items"]] == ["operator", "operator"]
    assert off.get("/api/state").json()["task"] is None  # adding starts nothing
    first = off.post("/api/experiments/queue/run").raise_for_status().json()["run"]

    def over() -> dict[str, object] | None:
        queue = dict(off.get("/api/experiments/queue").raise_for_status().json())
        return None if queue["items"] or queue["run"] else queue

    queue = until(over)
    assert (queue["running"], queue["problem"]) == (False, "")
    ends = [off.get(f"/api/runs/{run}").json()["end_state"] for run in (first, first + 1)]
    assert ends == ["completed", "completed"]


def test_a_stop_pauses_the_queue_and_gives_the_reason(off: httpx.Client) -> None:
    add(off, LONG)
    add(off, SHORT)
    run = off.post("/api/experiments/queue/run").raise_for_status().json()["run"]
    wait_for(off, "mode", "experiment")
    off.post("/api/stop").raise_for_status()
    wait_for(off, "task", None)
    queue = off.get("/api/experiments/queue").json()
    assert not queue["running"]
    stopped = messages.run_not_completed(run=run, end_state="stopped")
    assert queue["problem"] == messages.queue_paused(cause=stopped, waiting=1)
    assert len(queue["items"]) == 1


def test_queued_experiments_can_be_reordered(off: httpx.Client) -> None:
    items = [add(off, SHORT).json()["items"][-1]["id"] for _ in range(3)]

    def order_after(item: int, place: int) -> list[int]:
        moved = off.put(f"/api/experiments/queue/{item}/place", json={"place": place})
        return [one["id"] for one in moved.raise_for_status().json()["items"]]

    first, second, third = items
    assert order_after(third, 0) == [third, first, second]
    assert order_after(third, 2) == [first, second, third]
    assert order_after(second, 1) == [first, second, third]
    beyond = off.put(f"/api/experiments/queue/{first}/place", json={"place": 3})
    assert beyond.status_code == 422
    bounds = ("quantity", "value", "minimum", "maximum", "path")
    assert [problem(beyond)[name] for name in bounds] == ["place", 3, 0, 2, ["place"]]
    gone = off.put("/api/experiments/queue/999999/place", json={"place": 0})
    assert (gone.status_code, problem(gone)["message_code"]) == (404, "not_in_the_queue")


def test_a_queued_user_experiment_keeps_its_version(off: httpx.Client) -> None:
    text = off.get("/api/experiments/texts/step_battery").raise_for_status().json()["text"]
    own = text.replace("name: step_battery\n", "name: waiting\n", 1)
    for written, version in ((own, 1), (own.replace("title: Step battery", "title: Another"), 2)):
        stored = off.post("/api/experiments/own", json={"text": written}).raise_for_status().json()
        assert (stored["name"], stored["version"]) == ("waiting", version)
        waiting = off.post("/api/experiments/queue", json={"name": "waiting", "settings": {}}).raise_for_status().json()
        assert waiting["items"][-1]["name"] == f"waiting@{version}"
    listed = {one["name"]: one["title"] for one in off.get("/api/experiments").json()["experiments"]}
    assert listed["waiting@2"] == "Another"
    assert "waiting@1" not in listed


def test_the_tuning_that_an_experiment_applies_is_shown(off: httpx.Client) -> None:
    text = (
        "format: 1\nname: slowly\ntitle: Slowly\nphases:\n  - name: all\n    title: All\n    parts:\n"
        "      - {do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 1.0}\n"
        "      - {do: tuning, lam_q: 0.9, interpolate: true}\n      - {do: hold, duration_s: 3.0}\n"
    )
    off.post("/api/experiments/own", json={"text": text}).raise_for_status()
    before = off.get("/api/state").json()["tuning"]
    run = off.post("/api/experiments", json={"name": "slowly"}).raise_for_status().json()["id"]

    def shown() -> dict[str, object] | None:
        tuning = dict(off.get("/api/state").raise_for_status().json()["tuning"])
        return tuning if tuning["lam_q"] == 0.9 else None

    meanwhile = until(shown)
    assert meanwhile == {**before, "lam_q": 0.9, "interpolate": True, "entry": meanwhile["entry"]}
    wait_for(off, "task", None)
    assert {**off.get("/api/state").json()["tuning"], "entry": before["entry"]} == before
    marks = off.get(f"/api/runs/{run}/marks").raise_for_status().json()["marks"]
    texts = [mark["text"] for mark in marks if mark["kind"] == "tuning"]
    assert messages.tuning_by_program(lam_q=0.9, lam_S=0.42) in texts
    assert off.get(f"/api/runs/{run}").json()["title"] == "Slowly"


def test_every_role_may_check_a_text_and_rejected_texts_are_not_stored(off: httpx.Client) -> None:
    before = off.get("/api/experiments/own").raise_for_status().json()
    text = off.get("/api/experiments/texts/lambda_sweep").raise_for_status().json()["text"]
    fast = text.replace("name: lambda_sweep\n", "name: fast\n", 1).replace(
        "default: 0.5, minimum: 0.05", "default: 0.06, minimum: 0.05"
    )
    for way in ("check", "own"):
        refused = off.post(f"/api/experiments/{way}", json={"text": fast})
        assert refused.status_code == 422
        refusal = problem(refused)
        assert (refusal["code"], refusal["line"]) == ("bad_experiment", 23)
        assert "λ_q: 0.232379 s is outside" in str(refusal["message"])
    assert off.get("/api/experiments/own").json() == before
    assert off.get("/api/experiments/schema").raise_for_status().json()["title"] == "Experiment"
    assert off.get("/api/experiments/texts/nowhere").status_code == 404


def test_an_experiment_that_cannot_start_is_rejected_by_the_queue(off: httpx.Client) -> None:
    refused = add(off, '[{"duration_s": 1, "q_ref": 9, "S_ref": 10}]')
    assert refused.status_code == 422
    assert str(problem(refused)["message"]).startswith("segment 1, position reference: 515.662° is outside ")
    assert problem(refused)["path"] == ["segments", 0, "q_ref"]
    assert off.get("/api/experiments/queue").json()["items"] == []
    assert off.post("/api/experiments/queue/run").status_code == 409
    assert off.delete("/api/experiments/queue/9999").status_code == 404


def test_a_dry_run_predicts_the_outcome_without_motion(off: httpx.Client) -> None:
    runs = off.get("/api/runs").json()["total"]
    segments = '[{"duration_s": 1, "q_ref": 0, "S_ref": 10}, {"duration_s": 4, "q_ref": 0.4, "S_ref": 10}]'
    order = {"name": "sequence", "settings": {"segments": segments}}
    played = off.post("/api/experiments/dry-run", json=order).raise_for_status().json()
    assert played["status"] == "completed"
    assert played["duration_s"] == 5.0
    assert max(played["samples"]["signals"]["q"]["maximum"]) == pytest.approx(0.4, abs=0.01)
    assert any(metric["value"] is not None for metric in played["metrics"])
    assert off.get("/api/state").json()["mode"] == "off"
    assert off.get("/api/runs").json()["total"] == runs


def test_runs_of_several_kinds_are_listed_together(off: httpx.Client) -> None:
    kinds = {run["kind"] for run in off.get("/api/runs", params={"kind": "sequence,session"}).json()["runs"]}
    assert kinds <= {"sequence", "session"}
    assert off.get("/api/runs", params={"kind": "sequence,dance"}).status_code == 422
