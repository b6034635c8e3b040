"""What is refused is told whole, in the operator's words and the unit that the person chose, with the place of it."""

import math
import re
from collections.abc import Iterator
from typing import Any

import httpx
import pytest

from tests.api.conftest import ended, problem

DEGREES_OF_A_RADIAN = 57.29577951308232

NUMBER = re.compile(r"\d+\.?\d*(?:e[-+]?\d+)?")
CODE_NAME = re.compile(r"\b[a-z]+(?:_[a-z0-9]+)+\b|\[\d+\]", re.IGNORECASE)
SYMBOL = re.compile(r"q_max|θ_A,ref|λ_q|M_s")
"""Symbols of the paper, which operators read."""

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
        "angle of the wall: 120° is outside ",
    ),
    ("PUT", "wall", {"wall": {"q_wall": 0.4, "k_wall": 1e6}}, ["wall", "k_wall"], "stiffness of the wall: "),
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
        "joint position steps between ±q_max: 'wide' is refused: it needs a number in °",
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
        "a step ends once a motor has turned by this much: 3600° is more than 687°",
    ),
]


@pytest.fixture
def liking(off: httpx.Client) -> Iterator[Any]:
    """A way to choose the unit of angles; the choice of before is back afterwards."""
    before = off.get("/api/preferences").json()

    def like(angles: str) -> None:
        off.put("/api/preferences", json=before | {"angles": angles}).raise_for_status()

    yield like
    off.put("/api/preferences", json=before).raise_for_status()


@pytest.mark.parametrize(("method", "path", "body", "place", "said"), REFUSED)
def test_a_refusal_is_whole_in_words_and_units_and_says_where(
    off: httpx.Client, liking: Any, method: str, path: str, body: dict[str, Any], place: list[str | int], said: str
) -> None:
    """No code name, no further unit, no number that nobody reads; in radians where the person asks for them."""
    refusal = told(off, method, path, body)
    message = str(refusal["message"])
    assert message.startswith(said), message
    path_told = refusal["path"]
    assert isinstance(path_told, list)
    assert path_told[-len(place) :] == place
    assert not re.search(r"(?<!/)\brad\b", message), message
    assert not CODE_NAME.search(SYMBOL.sub("", message)), message
    assert all(len(re.sub(r"e.*|\D", "", number).lstrip("0")) <= 6 for number in NUMBER.findall(message)), message

    liking("rad")
    in_radians = told(off, method, path, body)
    assert {**in_radians, "message": ""} == {**refusal, "message": ""}, "what programs read is in SI for everybody"
    assert "°" not in str(in_radians["message"])
    degrees, radians = (
        [float(number) for number in NUMBER.findall(str(text["message"]).partition(": ")[2])]
        for text in (refusal, in_radians)
    )
    if refusal["unit"] == "rad":
        converted = [DEGREES_OF_A_RADIAN * number for number in radians]
        assert degrees[:1] == pytest.approx(converted[:1], rel=2e-5)
        assert degrees == pytest.approx(converted, rel=1e-2)  # bounds in three digits, towards the inside
    else:
        assert degrees == radians


def told(client: httpx.Client, method: str, path: str, body: dict[str, Any]) -> dict[str, object]:
    answer = client.request(method, f"/api/{path}", json=body)
    assert answer.status_code == 422, answer.text
    return problem(answer)


def test_the_choice_is_kept_for_the_person_and_starts_with_degrees(
    off: httpx.Client, viewer: httpx.Client, liking: Any
) -> None:
    assert off.get("/api/preferences").json()["angles"] == "deg"
    liking("rad")
    assert off.get("/api/preferences").json()["angles"] == "rad"
    assert viewer.get("/api/preferences").json()["angles"] == "deg"


def test_a_report_is_in_the_unit_of_who_downloads_it(running: httpx.Client, liking: Any) -> None:
    """What the person prefers, unless the address says otherwise; the data beside it stay in SI."""
    run = running.get("/api/state").json()["recording_run"]
    running.post("/api/stop").raise_for_status()
    ended(running, run)

    def page(query: str = "") -> str:
        return running.get(f"/api/runs/{run}/report.html{query}").raise_for_status().text

    q_max = re.compile(r"geometry\.<i>q</i><sub>max</sub></td>\s*<td[^>]*>([^<]*)</td>\s*<td[^>]*>([^<]*)<")
    in_degrees = q_max.search(page())
    assert in_degrees is not None
    liking("rad")
    in_radians = q_max.search(page())
    assert in_radians is not None
    assert (in_degrees[2], in_radians[2]) == ("°", "rad")
    assert float(in_degrees[1]) == pytest.approx(DEGREES_OF_A_RADIAN * float(in_radians[1]), rel=1e-5)
    asked = q_max.search(page("?angles=deg"))
    assert asked is not None
    assert asked[0] == in_degrees[0]
    data = running.get(f"/api/runs/{run}/data.csv").raise_for_status().text
    liking("deg")
    assert running.get(f"/api/runs/{run}/data.csv").raise_for_status().text == data
