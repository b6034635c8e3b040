"""Operation of the simulator through the interface, in the units that a person chose."""

import math
import re
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests.api.conftest import ended, problem, until, wait_for

# Operation of the simulator through the interface: commands, refusals and active settings.


def test_an_illegal_mode_is_rejected_with_the_legal_modes(off: httpx.Client) -> None:
    refused = off.post("/api/mode", json={"mode": "run"})
    assert refused.status_code == 409
    assert problem(refused)["legal"] == ["pretension"]
    assert off.get("/api/state").json()["mode"] == "off"


def test_run_is_rejected_until_pretension_is_done(off: httpx.Client) -> None:
    def request_run_too_early() -> httpx.Response | None:
        for path in ("stop", "reset"):
            off.post(f"/api/{path}").raise_for_status()
        off.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
        answer = off.post("/api/mode", json={"mode": "run"})
        return None if answer.is_success else answer

    refused = until(request_run_too_early)  # tendons that were recently taut take half a second, also on a busy machine
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
    ("path", "body", "quantity", "value", "unit", "expected"),
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
def test_a_value_out_of_range_is_rejected_with_its_bounds(
    running: httpx.Client, path: str, body: dict[str, float], quantity: str, value: float, unit: str, expected: str
) -> None:
    before = running.get("/api/state").json()
    refused = running.put(path, json=body)
    assert refused.status_code == 422
    refusal = problem(refused)
    assert (refusal["quantity"], refusal["value"], refusal["unit"]) == (quantity, value, unit)
    minimum, maximum = refusal["minimum"], refusal["maximum"]
    assert isinstance(minimum, float)
    assert isinstance(maximum, float)
    assert not minimum <= value <= maximum
    assert str(refusal["message"]).startswith(expected)
    assert refusal["path"] == [quantity]
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
def test_an_invalid_body_is_rejected_with_its_field(running: httpx.Client, body: str) -> None:
    refused = running.put("/api/references", content=body, headers={"Content-Type": "application/json"})
    assert refused.status_code == 422
    assert problem(refused)["message"]
    assert "torque" not in body or "torque" in str(problem(refused)["message"])


def test_a_new_lambda_leaves_the_other_settings_unchanged(running: httpx.Client) -> None:
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


def test_references_are_rejected_in_modes_without_loops(off: httpx.Client) -> None:
    assert off.put("/api/references", json={"q_ref": 0.1, "S_ref": 10.0}).status_code == 409


def test_stop_is_confirmed_latched_and_requires_a_reset(running: httpx.Client) -> None:
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


def test_an_identification_is_predicted_in_advance(operator: httpx.Client) -> None:
    prediction = operator.post("/api/identifications/prediction", json={"tension_N": 20.0}).json()
    assert prediction["q_counts"] == pytest.approx(57.0, abs=1.0)
    assert prediction["enough_motion"]
    naive = {"tension_N": 20.0, "chip_s": 0.001, "amplitude_rad": 0.5, "bits": 12}
    prediction = operator.post("/api/identifications/prediction", json=naive).json()
    assert not prediction["enough_motion"]
    assert prediction["q_counts"] < 5
    assert "longer chip" in prediction["message"]
    assert math.isfinite(prediction["u_peak_V"])


def test_unknown_rows_are_not_found(operator: httpx.Client) -> None:
    for path in ("runs/999999", "banks/999999", "identifications/999999", "experiments/999999"):
        refused = operator.get(f"/api/{path}")
        assert refused.status_code == 404
        assert "999999" in str(problem(refused)["message"])


# A refusal has a complete message in the operator's terms and chosen unit, and the path of the value.

DEGREES_OF_A_RADIAN = 57.29577951308232

NUMBER = re.compile(r"\d+\.?\d*(?:e[-+]?\d+)?")
CODE_NAME = re.compile(r"\b[a-z]+(?:_[a-z0-9]+)+\b|\[\d+\]", re.IGNORECASE)
SYMBOL = re.compile(r"q_max|θ_A,ref|λ_q|M_s")
"""Symbols of the paper, which operators know."""

REFUSED: list[tuple[str, str, dict[str, Any], list[str | int], str]] = [
    (
        "PUT",
        "references",
        {"q_ref": 2 * math.pi / 3, "S_ref": 10},
        ["q_ref"],
        "position reference: 120° is outside -",
    ),
    ("PUT", "references", {"q_ref": "much", "S_ref": 10}, ["q_ref"], "joint position reference: "),
    ("PUT", "references", {"q_ref": 0, "S_ref": 40}, ["S_ref"], "stiffness reference: 40 N·m/rad is outside "),
    ("PUT", "tuning", {"lam_q": 0.1}, ["lam_q"], "λ_q: 0.1 s is outside "),
    ("POST", "push", {"F_push": 1000}, ["F_push"], "push: 1000 N is outside "),
    (
        "PUT",
        "wall",
        {"wall": {"q_wall": 2 * math.pi / 3}},
        ["wall", "q_wall"],
        "angle of the obstacle: 120° is outside ",
    ),
    ("PUT", "wall", {"wall": {"q_wall": 0.4, "k_wall": 1e6}}, ["wall", "k_wall"], "stiffness of the obstacle: "),
    (
        "POST",
        "experiments/queue",
        {"name": "tracking", "settings": {"q_amplitude": 2 * math.pi / 3}},
        ["q_amplitude"],
        "joint position steps between ±q_max: 120° is outside 0.573 to 80.2°",
    ),
    (
        "POST",
        "experiments/dry-run",
        {"name": "tracking", "settings": {"q_amplitude": "wide"}},
        ["q_amplitude"],
        "joint position steps between ±q_max: 'wide' is refused: a number is required in °",
    ),
    (
        "POST",
        "experiments/dry-run",
        {"name": "tracking", "settings": {"S_low": 14, "S_high": 9}},
        ["S_low"],
        "lower level of the stiffness pulses: 14 N·m/rad is more than 9 N·m/rad; keep it below the upper level",
    ),
    (
        "POST",
        "experiments/queue",
        {
            "name": "sequence",
            "settings": {
                "segments": '[{"duration_s":4,"q_ref":0,"S_ref":10},{"duration_s":4,"q_ref":0,"S_ref":10},'
                f'{{"duration_s":4,"q_ref":{2 * math.pi / 3},"S_ref":10}}]'
            },
        },
        ["segments", 2, "q_ref"],
        "segment 3, position reference: 120° is outside -80.",
    ),
    (
        "POST",
        "identifications/prediction",
        {"kind": "actuator", "amplitude_rad": math.pi},
        ["amplitude_rad"],
        "amplitude of the binary sequence on θ_A,ref: 180° is more than 114°",
    ),
    (
        "POST",
        "identifications/prediction",
        {"kind": "motor", "travel_rad": 20 * math.pi},
        ["travel_rad"],
        "rotation of a motor after which a step ends: 3600° is more than 687°",
    ),
]


@pytest.fixture
def angle_unit(off: httpx.Client) -> Iterator[Any]:
    """Sets the unit of angles; the previous unit is restored afterwards."""
    before = off.get("/api/preferences").json()

    def like(angles: str) -> None:
        off.put("/api/preferences", json=before | {"angles": angles}).raise_for_status()

    yield like
    off.put("/api/preferences", json=before).raise_for_status()


@pytest.mark.parametrize(("method", "path", "body", "place", "expected"), REFUSED)
def test_a_refusal_has_text_units_and_field(
    off: httpx.Client,
    angle_unit: Any,
    method: str,
    path: str,
    body: dict[str, Any],
    place: list[str | int],
    expected: str,
) -> None:
    """No code name, no other unit, no unnecessary number; radians if the person chose them."""
    refusal = read_refusal(off, method, path, body)
    message = str(refusal["message"])
    assert message.startswith(expected), message
    path_told = refusal["path"]
    assert isinstance(path_told, list)
    assert path_told[-len(place) :] == place
    assert not re.search(r"(?<!/)\brad\b", message), message
    assert not CODE_NAME.search(SYMBOL.sub("", message)), message
    assert all(len(re.sub(r"e.*|\D", "", number).lstrip("0")) <= 6 for number in NUMBER.findall(message)), message

    angle_unit("rad")
    in_radians = read_refusal(off, method, path, body)
    assert {**in_radians, "message": ""} == {**refusal, "message": ""}, "what programs read is in SI for everybody"
    assert "°" not in str(in_radians["message"])
    degrees, radians = (
        [float(number) for number in NUMBER.findall(str(text["message"]).partition(": ")[2])]
        for text in (refusal, in_radians)
    )
    if refusal["unit"] == "rad":
        converted = [DEGREES_OF_A_RADIAN * number for number in radians]
        assert degrees[:1] == pytest.approx(converted[:1], rel=2e-5)
        assert degrees == pytest.approx(converted, rel=1e-2)  # bounds with three digits, rounded inwards
    else:
        assert degrees == radians


def read_refusal(client: httpx.Client, method: str, path: str, body: dict[str, Any]) -> dict[str, object]:
    answer = client.request(method, f"/api/{path}", json=body)
    assert answer.status_code == 422, answer.text
    return problem(answer)


def test_the_unit_of_angles_is_stored_per_person_and_defaults_to_degrees(
    off: httpx.Client, viewer: httpx.Client, angle_unit: Any
) -> None:
    assert off.get("/api/preferences").json()["angles"] == "deg"
    angle_unit("rad")
    assert off.get("/api/preferences").json()["angles"] == "rad"
    assert viewer.get("/api/preferences").json()["angles"] == "deg"


def test_a_report_uses_the_angle_unit_of_the_downloading_person(running: httpx.Client, angle_unit: Any) -> None:
    """The unit that the person prefers, unless the URL gives another; the embedded data are in SI."""
    run = running.get("/api/state").json()["recording_run"]
    running.post("/api/stop").raise_for_status()
    ended(running, run)

    def page(query: str = "") -> str:
        return running.get(f"/api/runs/{run}/report.html{query}").raise_for_status().text

    q_max = re.compile(r"geometry\.<i>q</i><sub>max</sub></td>\s*<td[^>]*>([^<]*)</td>\s*<td[^>]*>([^<]*)<")
    in_degrees = q_max.search(page())
    assert in_degrees is not None
    angle_unit("rad")
    in_radians = q_max.search(page())
    assert in_radians is not None
    assert (in_degrees[2], in_radians[2]) == ("°", "rad")
    assert float(in_degrees[1]) == pytest.approx(DEGREES_OF_A_RADIAN * float(in_radians[1]), rel=1e-5)
    asked = q_max.search(page("?angles=deg"))
    assert asked is not None
    assert asked[0] == in_degrees[0]
    data = running.get(f"/api/runs/{run}/data.csv").raise_for_status().text
    angle_unit("deg")
    assert running.get(f"/api/runs/{run}/data.csv").raise_for_status().text == data
