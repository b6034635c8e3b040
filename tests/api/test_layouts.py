"""Layouts of the charts: kept for each person as they were sent, refused in words where no chart could show them."""

from typing import Any

import httpx
import pytest

from backend.errors import RequestRejectedError
from backend.schemas.preferences import ChartLayout, check_preferences

ERRORS = {"title": "Errors", "signals": ["q - q_ref"], "over": None, "share": 1.5}
PLANE = {"title": "S over q", "signals": ["S", "S_ref"], "over": "q", "share": 2.0}


def layout(*panels: dict[str, Any], name: str = "Mine") -> dict[str, Any]:
    return {"version": 1, "name": name, "panels": list(panels)}


@pytest.mark.parametrize(
    ("layouts", "said"),
    [
        (
            [layout(ERRORS, {**ERRORS, "title": "Both", "signals": ["q", "S"]})],
            "panel “Both” of layout “Mine” has q in rad and S in N·m/rad: one panel has one unit; put them into",
        ),
        ([layout({**ERRORS, "signals": ["q_hat"]})], "panel “Errors” of layout “Mine”: there is no signal q_hat"),
        ([layout({**ERRORS, "signals": ["q - S"]})], "there is no signal q - S"),
        ([layout(ERRORS, {**PLANE, "over": "speed"})], "there is no signal speed"),
        (
            [layout({**ERRORS, "signals": ["q", "q"]})],
            "signal in panel “Errors” of layout “Mine”: “q” is there 2",
        ),
        ([layout(ERRORS, ERRORS)], "panel of layout “Mine”: “Errors” is there 2 times; once is enough"),
        ([layout(ERRORS), layout(PLANE, ERRORS)], "layout of the charts: “Mine” is there 2 times; once is enough"),
        ([layout(PLANE)], "layout “Mine” has no panel over time; add one"),
    ],
)
def test_what_no_chart_can_show_is_refused_in_words(layouts: list[dict[str, Any]], said: str) -> None:
    with pytest.raises(RequestRejectedError) as refused:
        check_preferences([ChartLayout.model_validate(one) for one in layouts])
    assert said in str(refused.value)


def test_an_axis_may_have_another_unit_than_what_is_drawn_over_it() -> None:
    check_preferences([ChartLayout.model_validate(layout(ERRORS, PLANE))])


def test_layouts_are_kept_for_a_person_and_a_refused_one_changes_nothing(
    operator: httpx.Client, viewer: httpx.Client
) -> None:
    before = viewer.get("/api/preferences").raise_for_status().json()
    theirs = operator.get("/api/preferences").raise_for_status().json()
    wanted = {**before, "layout": "Mine", "layouts": [layout(ERRORS, PLANE)], "hidden": ["q - q_ref"], "clock": True}
    assert viewer.put("/api/preferences", json=wanted).raise_for_status().json() == wanted
    bad = {**wanted, "layouts": [layout({**ERRORS, "signals": ["F_A", "u_A"]})]}
    refused = viewer.put("/api/preferences", json=bad)
    assert refused.status_code == 422
    assert refused.json()["error"]["code"] == "bad_layout"
    assert "F_A in N and u_A in V" in refused.json()["error"]["message"]
    assert viewer.get("/api/preferences").json() == wanted
    assert operator.get("/api/preferences").json() == theirs
    many = {**wanted, "layouts": [layout(ERRORS, name=f"n{number}") for number in range(21)]}
    assert viewer.put("/api/preferences", json=many).status_code == 422
    viewer.put("/api/preferences", json=before).raise_for_status()
