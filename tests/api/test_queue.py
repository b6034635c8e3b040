"""Experiments that wait for their turn, and experiments that are only played on a simulator."""

import httpx
import pytest

from tests.api.conftest import problem, until, wait_for

SHORT = '[{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}]'
LONG = '[{"duration_s": 60, "q_ref": 0.1, "S_ref": 10}]'


@pytest.fixture(autouse=True)
def empty_queue(off: httpx.Client) -> None:
    for item in off.get("/api/experiments/queue").raise_for_status().json()["items"]:
        off.delete(f"/api/experiments/queue/{item['id']}").raise_for_status()


def add(client: httpx.Client, segments: str) -> httpx.Response:
    return client.post("/api/experiments/queue", json={"name": "sequence", "settings": {"segments": segments}})


def test_the_queue_runs_one_after_the_other(off: httpx.Client) -> None:
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


def test_a_stop_holds_the_queue_and_says_why(off: httpx.Client) -> None:
    add(off, LONG)
    add(off, SHORT)
    run = off.post("/api/experiments/queue/run").raise_for_status().json()["run"]
    wait_for(off, "mode", "experiment")
    off.post("/api/stop").raise_for_status()
    wait_for(off, "task", None)
    queue = off.get("/api/experiments/queue").json()
    assert not queue["running"]
    assert (
        queue["problem"]
        == f"held because run {run} ended as stopped; start the queue again to go on with the first that waits"
    )
    assert len(queue["items"]) == 1


def test_what_could_not_be_started_is_refused_when_it_is_added(off: httpx.Client) -> None:
    refused = add(off, '[{"duration_s": 1, "q_ref": 9, "S_ref": 10}]')
    assert refused.status_code == 422
    assert str(problem(refused)["message"]).startswith("segment 1, position reference: 515.662 deg is outside ")
    assert problem(refused)["path"] == ["segments", 0, "q_ref"]
    assert off.get("/api/experiments/queue").json()["items"] == []
    assert off.post("/api/experiments/queue/run").status_code == 409
    assert off.delete("/api/experiments/queue/9999").status_code == 404


def test_a_dry_run_tells_the_outcome_and_moves_nothing(off: httpx.Client) -> None:
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
