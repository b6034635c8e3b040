"""Operating the simulator through the interface: what is asked, what is refused, what is in force then."""

import math

import httpx
import pytest

from tests.api.conftest import ended, problem, until, wait_for


def test_an_illegal_move_is_refused_with_the_legal_ones(off: httpx.Client) -> None:
    refused = off.post("/api/mode", json={"mode": "run"})
    assert refused.status_code == 409
    assert problem(refused)["legal"] == ["pretension"]
    assert off.get("/api/state").json()["mode"] == "off"


def test_run_has_to_wait_for_the_pretension(off: httpx.Client) -> None:
    def asked_too_early() -> httpx.Response | None:
        for path in ("stop", "reset"):
            off.post(f"/api/{path}").raise_for_status()
        off.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
        answer = off.post("/api/mode", json={"mode": "run"})
        return None if answer.is_success else answer

    refused = until(asked_too_early)  # tendons that were taut a moment ago take half a second: a busy machine as well
    assert refused.status_code == 409
    assert "pretension" in str(problem(refused)["message"])
    state = wait_for(off, "pretension_done", True)
    assert "run" in state["legal_modes"]


def test_the_joint_follows_its_references(running: httpx.Client) -> None:
    assert running.put("/api/references", json={"q_ref": 0.4, "S_ref": 11.0}).json() == {"q_ref": 0.4, "S_ref": 11.0}
    state = wait_for(running, "references", {"q_ref": 0.4, "S_ref": 11.0, "in_force": True})
    assert state["recording_run"]
    assert state["fault"] is None


@pytest.mark.parametrize(
    ("path", "body", "quantity", "value", "unit", "said"),
    [
        ("/api/references", {"q_ref": 1.6, "S_ref": 10.0}, "q_ref", 1.6, "rad", "position reference: 91.6732° "),
        (
            "/api/references",
            {"q_ref": 0.0, "S_ref": 20.0},
            "S_ref",
            20.0,
            "N·m/rad",
            "stiffness reference: 20 N·m/rad ",
        ),
        ("/api/tuning", {"lam_q": 0.2}, "lam_q", 0.2, "s", "λ_q: 0.2 s "),
        ("/api/tuning", {"lam_S": 3.5}, "lam_S", 3.5, "s", "λ_S: 3.5 s "),
        ("/api/tuning", {"lam_motor": 0.01}, "lam_motor", 0.01, "s", "λ_motor: 0.01 s "),
    ],
)
def test_a_value_out_of_range_is_refused_with_its_bounds_and_changes_nothing(
    running: httpx.Client, path: str, body: dict[str, float], quantity: str, value: float, unit: str, said: str
) -> None:
    before = running.get("/api/state").json()
    refused = running.put(path, json=body)
    assert refused.status_code == 422
    told = problem(refused)
    assert (told["quantity"], told["value"], told["unit"]) == (quantity, value, unit)
    minimum, maximum = told["minimum"], told["maximum"]
    assert isinstance(minimum, float)
    assert isinstance(maximum, float)
    assert not minimum <= value <= maximum
    assert str(told["message"]).startswith(said)
    assert told["path"] == [quantity]
    after = running.get("/api/state").json()
    assert (after["references"], after["tuning"]) == (before["references"], before["tuning"])


@pytest.mark.parametrize(
    "body",
    [
        '{"q_ref": NaN, "S_ref": 10}',
        '{"q_ref": Infinity, "S_ref": 10}',
        '{"q_ref": 0.1}',
        '{"q_ref": 0.1, "S_ref": 10, "torque": 1}',
        '{"q_ref": "much", "S_ref": 10}',
        "{",
    ],
)
def test_nonsense_is_refused_and_names_what_is_wrong(running: httpx.Client, body: str) -> None:
    refused = running.put("/api/references", content=body, headers={"Content-Type": "application/json"})
    assert refused.status_code == 422
    assert problem(refused)["message"]
    assert "torque" not in body or "torque" in str(problem(refused)["message"])


def test_a_new_lambda_is_read_back_and_leaves_the_rest(running: httpx.Client) -> None:
    before = running.get("/api/tuning").json()
    answer = running.put("/api/tuning", json={"lam_q": 0.61}).json()
    assert answer == {**before, "lam_q": 0.61}
    assert running.get("/api/tuning").json() == answer
    running.put("/api/tuning", json={"lam_q": before["lam_q"]}).raise_for_status()


def test_the_preview_agrees_with_the_design(operator: httpx.Client) -> None:
    query = {"lam_q": 0.5, "lam_S": 0.42, "u_plan": 0.0}
    preview = operator.get("/api/tuning/preview", params=query).json()
    position, step = preview["position"], preview["step_q"]
    assert preview["motion"] == "lambda"
    assert position["M_s"] < 1.7
    assert position["lam_min"] == pytest.approx(0.355, abs=0.005)
    assert step["y"][-1] == pytest.approx(1.0, abs=0.02)
    assert step["t"][-1] >= 2.0
    slow = operator.get("/api/tuning/preview", params={**query, "lam_q": 1.0}).json()
    assert slow["position"]["M_s"] < position["M_s"]
    assert slow["step_q"]["rise_s"] > 1.8 * step["rise_s"]
    assert slow["step_q"]["u_peak_V"] < step["u_peak_V"] <= 10.0


def test_references_are_refused_where_nobody_follows_them(off: httpx.Client) -> None:
    assert off.put("/api/references", json={"q_ref": 0.1, "S_ref": 10.0}).status_code == 409


def test_stop_gives_its_proof_latches_and_needs_a_reset(running: httpx.Client) -> None:
    run = running.get("/api/state").json()["recording_run"]
    proof = running.post("/api/stop").raise_for_status().json()
    assert 0 <= proof["zero_tick"] - proof["arrived_tick"] <= 2
    state = running.get("/api/state").json()
    assert (state["mode"], state["fault"]["code"]) == ("tripped", "stop_pressed")
    assert state["fault"]["remedy"]
    assert state["stop_proof"] == proof
    assert running.post("/api/mode", json={"mode": "pretension"}).status_code == 409
    assert running.post("/api/stop").status_code == 200
    assert running.post("/api/reset").json()["mode"] == "off"
    stored = ended(running, run)
    assert (stored["end_state"], stored["end_reason"]) == ("stopped", "stop_pressed")
    assert stored["missing_samples"] == 0


def test_a_push_moves_the_joint_of_the_simulator(running: httpx.Client) -> None:
    assert running.post("/api/push", json={"F_push": 5.0}).json() == {"F_push": 5.0, "duration_s": 1.0}
    refused = running.post("/api/push", json={"F_push": 400.0})
    assert problem(refused)["unit"] == "N"
    running.post("/api/push", json={"F_push": 0.0}).raise_for_status()


def test_what_an_identification_will_do_is_told_before(operator: httpx.Client) -> None:
    told = operator.post("/api/identifications/prediction", json={"tension_N": 20.0}).json()
    assert told["q_counts"] == pytest.approx(57.0, abs=1.0)
    assert told["enough_motion"]
    naive = {"tension_N": 20.0, "chip_s": 0.001, "amplitude_rad": 0.5, "bits": 12}
    told = operator.post("/api/identifications/prediction", json=naive).json()
    assert not told["enough_motion"]
    assert told["q_counts"] < 5
    assert "longer chip" in told["message"]
    assert math.isfinite(told["u_peak_V"])


def test_unknown_rows_are_not_found(operator: httpx.Client) -> None:
    for path in ("runs/999999", "banks/999999", "identifications/999999", "experiments/999999"):
        refused = operator.get(f"/api/{path}")
        assert refused.status_code == 404
        assert "999999" in str(problem(refused)["message"])
