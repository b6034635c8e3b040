"""The trigger through the interface: armed, shown live, captured, listed with the flight records, disarmed."""

import csv
import io
from typing import Any

import httpx
import pytest

from backend.services import messages
from plant.quantity import Angle
from tests.api.conftest import client_with, problem, until, until_state, wait_for
from tests.e2e.service import running_service

pytestmark = pytest.mark.live


def records(client: httpx.Client) -> list[dict[str, Any]]:
    return [one for one in client.get("/api/flights").raise_for_status().json()["flights"] if one["kind"] == "trigger"]


@pytest.fixture
def disarmed(running: httpx.Client) -> httpx.Client:
    running.delete("/api/trigger").raise_for_status()
    return running


def arm(client: httpx.Client, **order: Any) -> httpx.Response:
    return client.put("/api/trigger", json={"signal": "q_ref", "condition": "rising", "level": 0.1, **order})


def test_a_capture_has_the_requested_samples_around_the_trigger(disarmed: httpx.Client, viewer: httpx.Client) -> None:
    before = len(records(viewer))
    disarmed.put("/api/references", json={"q_ref": 0.0, "S_ref": 10.0}).raise_for_status()
    wait_for(disarmed, "references", {"q_ref": 0.0, "S_ref": 10.0, "in_force": True})
    armed = arm(disarmed, before_s=0.25, after_s=0.5, captures=2).raise_for_status().json()
    assert (armed["phase"], armed["captured"], armed["says"], armed["unit"]) == (
        "armed",
        0,
        f"q_ref rising through {Angle(0.1)}",
        "rad",
    )
    assert viewer.get("/api/state").json()["trigger"]["phase"] == "armed"
    disarmed.put("/api/references", json={"q_ref": 0.2, "S_ref": 10.0}).raise_for_status()
    state = until_state(viewer, lambda state: state["trigger"]["captured"] == 1, "nothing was captured")
    assert state["trigger"]["phase"] == "armed"
    record, *_ = until(lambda: records(viewer) if len(records(viewer)) > before else None)
    assert (record["fault"], record["who"], record["text"]) == (
        "trigger",
        "operator",
        f"trigger: q_ref rising through {Angle(0.1)}, 1 of 2",
    )
    assert [record["before_s"], record["after_s"]] == pytest.approx([0.25, 0.5])
    assert record["run"] == viewer.get("/api/state").json()["recording_run"]
    text = viewer.get(f"/api/flights/{record['id']}/data.csv").raise_for_status().text
    rows = list(csv.DictReader(line for line in io.StringIO(text) if not line.startswith("#")))
    q_ref = [float(row["q_ref"]) for row in rows]
    assert len(rows) == 750
    assert (q_ref[249], min(q_ref[250:])) == (0.0, 0.2)
    assert not any(value > 0.1 for value in q_ref[:250])
    assert float(rows[250]["t"]) == 0.0
    log = viewer.get("/api/log", params={"kind": "trigger"}).json()["entries"]
    assert (log[0]["event"], log[0]["flight"], log[0]["who"]) == (record["id"], True, "operator")

    refused = arm(disarmed, level=0.3)
    assert (refused.status_code, problem(refused)["code"]) == (409, "trigger_armed")
    disarmed.delete("/api/trigger").raise_for_status()
    trigger = viewer.get("/api/state").json()["trigger"]
    assert (trigger["phase"], trigger["ended"]) == ("ended", "operator disarmed it")
    disarmed.delete("/api/trigger").raise_for_status()  # a second time: nothing is armed


def test_an_armed_trigger_uses_the_formula_at_the_time_of_arming(disarmed: httpx.Client, viewer: httpx.Client) -> None:
    body = {"expression": "(q_ref + 1) * 2", "unit": "rad"}
    disarmed.put("/api/formulas/shifted", json=body).raise_for_status()
    disarmed.put("/api/references", json={"q_ref": 0.0, "S_ref": 10.0}).raise_for_status()
    wait_for(disarmed, "references", {"q_ref": 0.0, "S_ref": 10.0, "in_force": True})
    armed = arm(disarmed, signal="shifted", level=2.2, before_s=0.1, after_s=0.1).raise_for_status().json()
    assert (armed["says"], armed["unit"]) == (f"shifted rising through {Angle(2.2)}", "rad")
    disarmed.delete("/api/formulas/shifted").raise_for_status()
    disarmed.put("/api/references", json={"q_ref": 0.2, "S_ref": 10.0}).raise_for_status()
    until_state(viewer, lambda state: state["trigger"]["captured"] == 1, "nothing was captured")
    refused = arm(disarmed, signal="shifted")
    assert (refused.status_code, problem(refused)["code"]) == (422, "unknown_signal")


@pytest.mark.parametrize(
    ("order", "code"),
    [
        ({"signal": "F_C"}, "unknown_signal"),
        ({"condition": "inside"}, "bad_window"),
        ({"condition": "outside", "upper": 0.1}, "bad_window"),
        ({"upper": 0.3}, "bad_window"),
    ],
)
def test_invalid_triggers_are_rejected(disarmed: httpx.Client, order: dict[str, Any], code: str) -> None:
    refused = arm(disarmed, **order)
    assert (refused.status_code, problem(refused)["code"]) == (422, code)
    if code == "unknown_signal":
        assert problem(refused)["message"].startswith(messages.unknown_signal(signal="F_C", nearest="F_"))
        assert "F_B" in problem(refused)["legal"]


@pytest.mark.parametrize("order", [{"before_s": 60.1}, {"after_s": 0.0}, {"captures": 0}, {"captures": 101}])
def test_bounds(disarmed: httpx.Client, order: dict[str, Any]) -> None:
    assert arm(disarmed, **order).status_code == 422


def test_a_viewer_cannot_arm_or_disarm_the_trigger(viewer: httpx.Client) -> None:
    assert arm(viewer).status_code == 403
    assert viewer.delete("/api/trigger").status_code == 403
    assert service_state(viewer) is None or service_state(viewer)["phase"] == "ended"


def service_state(client: httpx.Client) -> Any:
    return client.get("/api/state").json()["trigger"]


def test_a_restart_of_the_service_disarms_the_trigger_and_is_logged(tmp_path_factory: pytest.TempPathFactory) -> None:
    folder = tmp_path_factory.mktemp("trigger")
    with running_service(folder, params="ideal") as first, client_with(first, "token") as client:
        arm(client, signal="F_A", condition="above", level=45.0).raise_for_status()
    with running_service(folder, params="ideal") as second, client_with(second, "token") as client:
        assert service_state(client) is None

        def read_entries() -> list[str]:
            entries = client.get("/api/log", params={"words": "trigger"}).json()["entries"]
            return [entry["text"] for entry in entries]

        wanted = messages.trigger_disarmed_by_restart(condition="F_A above 45 N", who="operator")
        assert until(lambda: read_entries() if wanted in read_entries() else None)[0] == wanted
