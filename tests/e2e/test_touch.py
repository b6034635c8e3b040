"""Contact detection on the page: the card shows the active settings, and a contact is displayed."""

import re
from typing import Any

import pytest
from playwright.sync_api import expect

from tests.e2e import forms
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts

OPERATE = load_texts("pages/operate")
PUSHING = OPERATE["pushing"].partition("{")[0]
THEME = load_texts("theme")

PUSH_N = 6.0
SWEEP_TIMEOUT_MS = 120_000
"""Each of the five points waits for rest, a few seconds of the loop's time."""


def test_contact_detection_is_calibrated_armed_triggered_and_released(same_operator: Operator) -> None:
    operator, page = same_operator, same_operator.page
    operator.be_in_run()

    def in_force() -> dict[str, Any]:
        state = page.evaluate("fetch('./api/state').then(answer => answer.json())")
        return dict(state["touch"])

    card = page.get_by_role("group", name="Touch", exact=True)
    said = page.locator("#told-of-touch")
    expect(said).to_contain_text(OPERATE["notCalibrated"])
    arm = card.get_by_role("button", name=OPERATE["enableReaction"], exact=True)
    expect(arm).to_be_disabled()
    assert in_force() == {"contact_N": 0.0, "learned": [], "felt": None, "sweep": None}
    operator.wait_for_samples(4000)  # until one second after the stiffness is at rest
    forms.pressed(page, card.get_by_role("button", name=OPERATE["calibrate"], exact=True), "/api/touch")
    (point,) = in_force()["learned"]
    expect(said).to_contain_text(OPERATE["calibratedAt"].format(stiffnesses=f"{point['S']:.1f}"))
    expect(page.get_by_text(re.compile(rf"^F_ext \S+ ± {point['std_N']:.2f} N$"))).to_be_visible()
    operator.enter(OPERATE["threshold"], 2.5)
    sent, answered = forms.pressed(page, arm, "/api/touch")
    assert sent["contact_N"] == answered["contact_N"] == in_force()["contact_N"] == 2.5
    expect(said).to_contain_text(OPERATE["reactionEnabled"].format(force="2.5"))

    operator.enter("Push [N]", PUSH_N)
    operator.press("Push")
    pushed = page.get_by_text(PUSHING)
    expect(pushed).to_be_visible()  # it is also hidden before the push is reported
    operator.expect_mode("compliance")
    felt = in_force()["felt"]
    assert 2.5 < felt["F_ext_hat"] < PUSH_N
    expect(said).to_contain_text(OPERATE["contact"].format(force=f"{felt['F_ext_hat']:.1f}"))
    expect(pushed).to_be_hidden(timeout=MOTION_TIMEOUT_MS)
    operator.press("Run")
    operator.expect_mode("run")
    expect(said).not_to_contain_text(OPERATE["contact"].partition("{")[0])
    forms.pressed(page, card.get_by_role("button", name=OPERATE["disableReaction"], exact=True), "/api/touch")
    operator.press("Push")
    operator.wait(lambda: abs(operator.reading(THEME["externalForce"], "F_ext_hat") - PUSH_N) < 0.5)
    assert operator.settled_mode() == "run"
    forms.pressed(page, card.get_by_role("button", name=OPERATE["clearBias"], exact=True), "/api/touch")
    expect(said).to_contain_text(OPERATE["notCalibrated"])


def test_the_calibration_over_S_runs_automatically_and_can_be_stopped(same_operator: Operator) -> None:
    operator, page = same_operator, same_operator.page
    operator.be_in_run()

    def state() -> dict[str, Any]:
        return dict(page.evaluate("fetch('./api/state').then(answer => answer.json())"))

    expect(page.get_by_text(PUSHING)).to_be_hidden()  # the push of the previous test
    held = state()["references"]
    card = page.get_by_role("group", name="Touch", exact=True)
    said, table = page.locator("#told-of-touch"), page.get_by_role("table", name=OPERATE["calibration"])
    begin = card.get_by_role("button", name=OPERATE["calibrateOverS"], exact=True)
    sent, _ = forms.pressed(page, begin, "/api/touch")
    assert sent == {"learn": False, "forget": False, "sweep": "begin"}
    expect(said).to_contain_text(OPERATE["sweepRunning"].format(point=1, points=5, S="8.0"))
    expect(card.get_by_role("button", name=OPERATE["calibrate"], exact=True)).to_be_disabled()
    second = OPERATE["sweepRunning"].format(point=2, points=5, S="9.8")
    expect(said).to_contain_text(second, timeout=SWEEP_TIMEOUT_MS)
    operator.wait(lambda: table.get_by_role("row").count() >= 2)
    sent, _ = forms.pressed(page, card.get_by_role("button", name=OPERATE["stopCalibration"], exact=True), "/api/touch")
    assert sent["sweep"] == "stop"
    operator.wait(lambda: not state()["touch"]["sweep"]["under_way"])
    ended = state()["touch"]["sweep"]  # a point takes a second: on a busy machine the press may apply to a later one
    at = {2: "9.8", 3: "11.5", 4: "13.3"}[ended["point"]]
    expect(said).to_contain_text(
        OPERATE["sweepEnded"].format(point=ended["point"], points=5, S=at, reason="stopped on request")
    )
    operator.wait(lambda: state()["references"] == held)

    forms.pressed(page, begin, "/api/touch")
    expect(table.get_by_role("row")).to_have_count(6, timeout=SWEEP_TIMEOUT_MS)
    expect(begin).to_be_visible()
    operator.wait(lambda: state()["references"] == held)
    learned = state()["touch"]["learned"]
    shown = [row.inner_text().split() for row in table.get_by_role("row").all()[1:]]
    minus = str.maketrans("\u2212", "-")
    assert [[float(cell.translate(minus)) for cell in row] for row in shown] == [
        pytest.approx([point["S"], point["F"], point["std_N"]], abs=0.051) for point in learned
    ]
    expect(said).to_contain_text(f"{OPERATE['calibratedAt'].partition('{')[0]}{learned[0]['S']:.1f}, ")
    assert learned[0]["S"] == pytest.approx(8.0, abs=0.2)
