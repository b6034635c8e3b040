"""Trials that revert by themselves, the saved tuning of a bank, and the printed formula next to the correct one."""

import math
import time
from collections.abc import Iterator

import httpx
import pytest

from backend.tuning.gains import make_motor_loops, motor_model
from backend.tuning.robustness import motor_robustness
from plant.parameters import load_parameters
from tests.api.conftest import problem, wait_for

START = {"lam_q": 0.5, "lam_S": 0.42, "lam_motor": 0.0854, "b": 0.0, "interpolate": False}


@pytest.fixture(autouse=True)
def starting_tuning(off: httpx.Client) -> Iterator[None]:
    off.put("/api/tuning", json=START).raise_for_status()
    yield
    off.put("/api/tuning", json=START).raise_for_status()


def test_a_trial_is_reverted_without_a_connected_page(off: httpx.Client) -> None:
    state = off.post("/api/tuning/trial", json={"lam_q": 0.7, "duration_s": 1.0}).raise_for_status().json()
    assert state["tuning"]["lam_q"] == 0.7
    assert state["trial"]["lam_q"] == 0.5
    assert 0.0 < state["trial"]["remaining_s"] <= 1.0
    time.sleep(0.8)  # no page is connected meanwhile
    after = wait_for(off, "trial", None)
    assert after["tuning"]["lam_q"] == 0.5


def test_a_trial_of_a_trial_reverts_to_the_tuning_before_both(off: httpx.Client) -> None:
    off.post("/api/tuning/trial", json={"lam_q": 0.7, "duration_s": 60.0}).raise_for_status()
    off.post("/api/tuning/trial", json={"lam_q": 0.8, "lam_S": 0.6, "duration_s": 60.0}).raise_for_status()
    state = off.delete("/api/tuning/trial").raise_for_status().json()
    assert (state["tuning"]["lam_q"], state["tuning"]["lam_S"], state["trial"]) == (0.5, 0.42, None)
    assert off.delete("/api/tuning/trial").status_code == 409


def test_a_confirmed_or_replaced_trial_does_not_revert(off: httpx.Client) -> None:
    off.post("/api/tuning/trial", json={"lam_q": 0.7, "duration_s": 60.0}).raise_for_status()
    assert off.post("/api/tuning/trial/keep").raise_for_status().json()["tuning"]["lam_q"] == 0.7
    off.post("/api/tuning/trial", json={"lam_q": 0.8, "duration_s": 60.0}).raise_for_status()
    off.put("/api/tuning", json={"lam_q": 0.9}).raise_for_status()
    state = off.get("/api/state").json()
    assert (state["tuning"]["lam_q"], state["trial"]) == (0.9, None)


def test_saves_and_starts_are_rejected_during_a_trial(off: httpx.Client) -> None:
    off.post("/api/tuning/trial", json={"lam_q": 0.7, "duration_s": 60.0}).raise_for_status()
    refused = off.put("/api/tuning/saved")
    assert (refused.status_code, problem(refused)["message_code"]) == (409, "trial_in_progress")
    refused = off.post("/api/experiments", json={"name": "tracking"})
    assert refused.status_code == 409
    assert "trial" in str(problem(refused)["message"])
    refused = off.post("/api/tuning/trial", json={"lam_q": 0.1, "duration_s": 5.0})
    assert problem(refused)["quantity"] == "lam_q"


def test_the_saved_tuning_is_the_active_tuning_at_the_time_of_saving(off: httpx.Client) -> None:
    off.put("/api/tuning", json={"lam_q": 0.61, "interpolate": True}).raise_for_status()
    saved = off.put("/api/tuning/saved").raise_for_status().json()
    off.put("/api/tuning", json={"lam_q": 0.9}).raise_for_status()
    assert off.get("/api/tuning/saved").json() == saved
    assert (saved["lam_q"], saved["interpolate"], saved["who"]) == (0.61, True, "operator")
    off.put("/api/tuning", json=START).raise_for_status()
    off.put("/api/tuning/saved").raise_for_status()


def test_the_preview_has_the_printed_and_the_corrected_formula(off: httpx.Client) -> None:
    query = {"lam_q": 0.5, "lam_S": 0.42, "u_plan": 0.0, "S": 10.0}  # in mode off the present S changes
    preview = off.get("/api/tuning/preview", params={**query, "printed": True}).raise_for_status().json()
    position = preview["position"]
    assert position["stable"]
    assert len(position["printed"]["y"]) == len(position["printed"]["t"]) > 0
    assert not position["printed"]["stable"]  # erratum E6: K and T of the full model allow no k_p = 2/(K λ)
    without = off.get("/api/tuning/preview", params=query).raise_for_status().json()
    assert without["position"] == {**position, "printed": None}


def test_an_unsent_voltage_limit_is_previewed_by_its_step(off: httpx.Client) -> None:
    def step(**more: float | str) -> dict[str, float]:
        query = {"lam_q": 0.5, "lam_S": 0.42, "S": 10.0, **more}  # in mode off the present S changes
        found = off.get("/api/tuning/preview", params=query).raise_for_status().json()
        return {name: found["step_q"][name] for name in ("u_peak_V", "F_min_N", "rise_s")}

    in_force = off.get("/api/tuning").raise_for_status().json()
    assert in_force["motion"] == "lambda"
    present, large, small = step(), step(motion="time-optimal", u_plan=8.5), step(motion="time-optimal", u_plan=4.0)
    assert step(motion="lambda") == step(u_plan=0.0) == present
    assert step(u_plan=8.5) == large
    assert large["rise_s"] < small["rise_s"] < present["rise_s"]
    assert 8.0 < large["u_peak_V"] <= 10.0
    assert large["u_peak_V"] > small["u_peak_V"] + 3.0
    assert off.get("/api/tuning").json() == in_force
    refused = off.get("/api/tuning/preview", params={"lam_q": 0.5, "lam_S": 0.42, "u_plan": 9.5})
    assert refused.status_code == 422
    assert "u_plan" in refused.text


def test_a_preview_uses_the_requested_stiffness_and_rejects_one_out_of_range(off: httpx.Client) -> None:
    query = {"lam_q": 0.5, "lam_S": 0.42}
    soft, stiff = (
        off.get("/api/tuning/preview", params={**query, "S": S}).raise_for_status().json() for S in (8.24, 14.06)
    )
    assert (soft["S"], stiff["S"]) == (8.24, 14.06)
    assert soft["step_q"]["F_min_N"] < 10.1 < 30.0 < stiff["step_q"]["F_min_N"]
    assert soft["pushed"]["without"]["give"] > 1.5 * stiff["pushed"]["without"]["give"]
    assert off.get("/api/tuning/preview", params=query).raise_for_status().json()["S"] == 8.0  # off, slack: the softest
    refused = problem(off.get("/api/tuning/preview", params={**query, "S": 15.5}))
    assert (refused["quantity"], refused["maximum"], refused["unit"]) == ("S_ref", 15.0, "N·m/rad")


def test_the_preview_of_the_motor_loop_is_sampled_with_electrical_lag(off: httpx.Client) -> None:
    """Sampled and with its electrical lag (erratum E5); at 0.05 s the gain may fall to 4 % only, as stated."""
    query = {"lam_q": 0.5, "lam_S": 0.42}
    motor = off.get("/api/tuning/preview", params=query).raise_for_status().json()["motor"]
    assert motor == {
        "M_s": pytest.approx(1.413, abs=1e-3),
        "gain_margin": pytest.approx(24.8, abs=0.1),
        "gain_reduction_margin": None,
        "phase_margin_deg": pytest.approx(46.6, abs=0.1),
    }
    view = off.put("/api/tuning", json={"lam_motor": 0.05}).raise_for_status().json()
    assert (view["lam_motor_min"], view["lam_motor_max"]) == (0.05, 0.2)
    motor = off.get("/api/tuning/preview", params=query).raise_for_status().json()["motor"]
    off.put("/api/tuning", json=START).raise_for_status()
    assert motor["M_s"] == pytest.approx(1.512, abs=1e-3)
    assert motor["gain_margin"] == pytest.approx(14.0, abs=0.1)
    assert motor["gain_reduction_margin"] == pytest.approx(0.040, abs=1e-3)


def test_the_service_gives_lambda_for_a_sensitivity_or_the_reason_for_none(viewer: httpx.Client) -> None:
    found = viewer.get("/api/tuning/robust", params={"M_s": 1.4}).raise_for_status().json()
    assert 0.40 < found["lam_q"]["lam"] < 0.45
    assert found["lam_motor"] == {"lam": pytest.approx(0.0933, abs=2e-4), "reason": ""}
    found = viewer.get("/api/tuning/robust", params={"M_s": 1.7}).raise_for_status().json()
    assert found["lam_motor"]["lam"] is None
    assert "not attainable" in found["lam_motor"]["reason"]
    assert viewer.get("/api/tuning/robust", params={"M_s": 1.0}).status_code == 422


def test_preferences_belong_to_a_person_and_are_checked(operator: httpx.Client, viewer: httpx.Client) -> None:
    liked = viewer.get("/api/preferences").raise_for_status().json()
    liked |= {"colours": {"q": "#123456"}, "hidden": ["u_A"], "window_s": 60.0}
    assert viewer.put("/api/preferences", json=liked).raise_for_status().json() == liked
    assert viewer.get("/api/preferences").json() == liked
    assert operator.get("/api/preferences").json()["colours"] != liked["colours"]
    assert viewer.put("/api/preferences", json={"colours": {"q": "red"}}).status_code == 422


@pytest.mark.parametrize("lam_motor", [0.05, 0.0854, 0.15])
def test_the_motor_loop_is_computed_at_every_offered_lambda(off: httpx.Client, lam_motor: float) -> None:
    """The values next to λ_motor in the form of an experiment are those of the sampled loop."""
    answer = off.get("/api/tuning/motor", params={"lam_motor": lam_motor}).raise_for_status().json()
    parameters = load_parameters("ideal")
    expected = motor_robustness(motor_model(parameters, "A"), make_motor_loops(parameters, lam_motor).A)
    assert answer["M_s"] == pytest.approx(expected.M_s, rel=1e-6)
    assert answer["gain_margin"] == pytest.approx(expected.gain_margin, rel=1e-6)
    assert answer["phase_margin_deg"] == pytest.approx(math.degrees(expected.phase_margin), rel=1e-6)
    assert (answer["gain_reduction_margin"] or 0.0) == pytest.approx(expected.gain_reduction, rel=1e-6)


def test_margins_of_a_motor_loop_outside_the_range_are_rejected(off: httpx.Client) -> None:
    refused = off.get("/api/tuning/motor", params={"lam_motor": 0.01})
    assert refused.status_code == 422
    assert problem(refused)["quantity"] == "lam_motor"
    assert problem(refused)["minimum"] == pytest.approx(0.05)
