"""Studies through the interface, on the running service: started, polled, stopped, resumed, rejected."""

from collections.abc import Callable
from typing import Any

import httpx
import pytest

from backend.experiments.messages import not_yaml_or_json, unknown_format
from backend.studies.messages import unknown_plant_number
from tests.api.conftest import problem, until

HEAD = "format: 1\nname: short\ntitle: Short\nsettings: {q_duration_s: 0.5, S_duration_s: 0.5, S_high: 12.0}\n"
GRID = "axes:\n  - {over: lam_q, values: [0.5, 0.8]}\n  - {over: lam_S, values: [0.5, 0.7, 0.9]}\n"
LONG = "seeds: 3000\n"


def begin(client: httpx.Client, text: str) -> dict[str, Any]:
    return dict(client.post("/api/studies", json={"text": text}).raise_for_status().json())


def of(client: httpx.Client, study: int) -> dict[str, Any]:
    return dict(client.get(f"/api/studies/{study}").raise_for_status().json())


def reached(client: httpx.Client, study: int, state: str, least: int = 0) -> Callable[[], bool]:
    def is_it() -> bool:
        listed = client.get("/api/studies").raise_for_status().json()["studies"]
        found = next(one for one in listed if one["id"] == study)
        return bool(found["state"] == state and found["done"] >= least)

    return is_it


def test_a_study_is_computed_and_has_its_maps(operator: httpx.Client, viewer: httpx.Client) -> None:
    study = begin(operator, HEAD + GRID)
    assert (study["points"], study["who"] != "") == (6, True)
    until(reached(operator, study["id"], "done"))
    found = of(viewer, study["id"])
    assert found["study"]["ends"] == {"completed": 6}
    not_completed = found["shares"][0]
    assert (not_completed["name"], not_completed["count"], not_completed["of"]) == ("not_completed", 0, 6)
    assert [(axis["name"], axis["unit"], axis["values"]) for axis in found["axes"]] == [
        ("lam_q", "s", [0.5, 0.8]),
        ("lam_S", "s", [0.5, 0.7, 0.9]),
    ]
    drawn = next(one for one in found["maps"] if one["figure"] == "min_tension_N")
    assert (drawn["x"], drawn["y"], drawn["pick"]) == ("lam_q", "lam_S", "least")
    assert drawn["counts"] == drawn["runs"] == [[1, 1]] * 3
    assert [axis["symbol"] for axis in found["axes"]] == ["λ_q", "λ_S"]
    share = next(one for one in found["maps"] if one["figure"] == "not_completed")
    assert (share["pick"], share["cells"][0][0], share["intervals"][0][0][0]) == ("share", 0.0, 0.0)
    asked = viewer.get(f"/api/studies/{study['id']}", params={"pick": "mean"}).raise_for_status().json()
    assert {one["pick"] for one in asked["maps"]} == {"mean", "share"}
    assert viewer.get(f"/api/studies/{study['id']}", params={"pick": "spread"}).status_code == 422
    by_place = {(row["values"]["lam_q"], row["values"]["lam_S"]): row["figures"] for row in found["rows"]}
    assert drawn["cells"] == [[by_place[q, S]["min_tension_N"] for q in (0.5, 0.8)] for S in (0.5, 0.7, 0.9)]
    assert [one["name"] for one in found["figures"]][:2] == ["min_tension_N", "M_s_q_true"]


def test_a_text_of_a_study_is_checked_without_a_start(viewer: httpx.Client) -> None:
    def checked(text: str) -> dict[str, Any]:
        return dict(viewer.post("/api/studies/check", json={"text": text}).raise_for_status().json())

    before = viewer.get("/api/studies").json()
    good = checked(HEAD + GRID + "draws: 2\nspread: [{of: motor.K_m, relative: 0.1}]\n")
    assert (good["points"], good["problem"], good["path"]) == (12, "", [])
    assert good["document"]["axes"][1] == {"over": "lam_S", "values": [0.5, 0.7, 0.9]}
    refused = checked(HEAD + GRID.replace("0.8]", "9.0]"))
    assert (refused["points"], refused["path"]) == (None, ["axes", 0, "over"])
    assert "line 6" in refused["problem"]
    assert refused["document"]["axes"][0]["values"] == [0.5, 9.0]  # a form can show and correct it
    assert checked("format: [")["document"] is None
    assert checked("- 1")["document"] is None
    assert viewer.get("/api/studies").json() == before
    numbers = {one["name"]: one for one in viewer.get("/api/studies/numbers").raise_for_status().json()["numbers"]}
    assert numbers["motor.K_m"]["value"] > 0.0


def test_a_study_is_stopped_and_resumed_while_another_waits(operator: httpx.Client) -> None:
    first, second = begin(operator, HEAD + LONG)["id"], begin(operator, HEAD + LONG)["id"]
    until(reached(operator, first, "running", 2))
    assert reached(operator, second, "waiting")()
    operator.post(f"/api/studies/{second}/stop").raise_for_status()
    assert reached(operator, second, "stopped")()
    assert operator.post(f"/api/studies/{first}/stop").raise_for_status().json()["state"] in ("stopping", "stopped")
    until(reached(operator, first, "stopped"))
    done = of(operator, first)["study"]["done"]
    assert 2 <= done < 3000
    operator.post(f"/api/studies/{first}/resume").raise_for_status()
    until(reached(operator, first, "running", done + 1))
    operator.post(f"/api/studies/{first}/stop").raise_for_status()
    until(reached(operator, first, "stopped", done + 1))


@pytest.mark.parametrize(
    ("text", "line", "expected"),
    [
        (
            HEAD + "axes: [{over: lam_q, values: [9.0]}]",
            5,
            "tuning parameter of the position loop: 9 s is outside 0.01 to",
        ),
        (HEAD + "axes: [{over: motor.c9, values: [1.0]}]", 5, unknown_plant_number(name="motor.c9")),
        ("format: 3", 1, unknown_format(value=3, known=1)),
        ("]", 1, not_yaml_or_json(reason="")),
    ],
)
def test_an_invalid_study_is_rejected_with_its_line(
    operator: httpx.Client, text: str, line: int, expected: str
) -> None:
    answer = operator.post("/api/studies", json={"text": text})
    assert answer.status_code == 422
    found = problem(answer)
    assert found["line"] == line
    assert expected in found["message"]


def test_a_viewer_cannot_start_a_study_and_a_missing_study_is_reported(
    operator: httpx.Client, viewer: httpx.Client
) -> None:
    assert viewer.post("/api/studies", json={"text": HEAD + GRID}).status_code == 403
    for asked in (operator.get("/api/studies/999"), operator.post("/api/studies/999/resume")):
        assert asked.status_code == 404
        assert problem(asked)["message"] == "there is no study 999"
