"""Commands are never sent by accident: unconfirmed values, the wheel over a chart, controls of an observer."""

import re

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

OPERATE = load_texts("pages/operate")
SERVICE = load_texts("service")
SHARED = load_texts("components")

BOX = "q_ref value [°]"


def box(page: Page) -> Locator:
    return page.get_by_role("textbox", name=BOX, exact=True)


@pytest.mark.parametrize("how", ["click", "Tab", "Escape", "navigation"])
def test_an_unconfirmed_value_is_not_sent(same_operator: Operator, how: str) -> None:
    page = same_operator.page
    same_operator.be_in_run()
    same_operator.enter(BOX, 0.0)
    same_operator.wait(lambda: same_operator.state()["references"]["q_ref"] == 0.0)
    box(page).fill("25")
    expect(page.get_by_text(SHARED["unsent"].replace("{value}", "25.0°"))).to_be_visible()
    if how == "click":
        page.get_by_role("heading", name="Mode", exact=True).click()
    elif how == "navigation":
        same_operator.go("Log")
        same_operator.go("Operate")
    else:
        box(page).press(how)
    same_operator.wait_for_samples(500)
    assert same_operator.state()["references"]["q_ref"] == 0.0
    expect(box(page)).to_have_value("0.0")
    if how in ("click", "Tab"):
        expect(page.get_by_text(SHARED["wasNotSent"].replace("{value}", "25.0°"))).to_be_visible()


def test_a_decimal_comma_is_accepted_as_a_decimal_point(same_operator: Operator) -> None:
    same_operator.be_in_run()
    box(same_operator.page).fill("2,5")
    box(same_operator.page).press("Enter")
    same_operator.wait(lambda: abs(same_operator.state()["references"]["q_ref"] - 0.0436332) < 1e-6)
    same_operator.enter(BOX, 0.0)


def test_the_wheel_over_a_clicked_chart_scrolls_the_page(same_operator: Operator) -> None:
    page = same_operator.page
    same_operator.be_in_run()
    chart = page.get_by_role("figure", name="Joint position", exact=True)
    seen = page.get_by_role("status", name="View", exact=True)
    expect(seen).to_contain_text(OPERATE["following"].format(span="20.0"))
    page.mouse.click(*middle(chart))
    page.mouse.wheel(0, -400)
    same_operator.wait_for_samples(300)
    expect(seen).to_contain_text("20.0 s")
    page.keyboard.down("Control")
    page.mouse.wheel(0, -400)
    page.keyboard.up("Control")
    expect(seen).not_to_contain_text("20.0 s")
    page.mouse.dblclick(*middle(chart))


def middle(chart: Locator) -> tuple[float, float]:
    place = chart.bounding_box()
    assert place is not None
    return place["x"] + 0.5 * place["width"], place["y"] + 0.5 * place["height"]


def test_an_observer_sees_why_controls_are_disabled_and_takes_control_on_operate(
    same_operator: Operator, browser: Browser, service: Service
) -> None:
    same_operator.be_in_run()
    signing_in = {"token": (service.data / "token").read_text().strip(), "name": "Vera Other"}
    context = browser.new_context(viewport=DESKTOP)
    page = context.new_page()
    assert page.request.post(f"{service.url}/api/session", data=signing_in).ok
    page.goto(f"{service.url}/#/operate")
    moves = page.get_by_role("group", name="Change mode").get_by_role("button")
    expect(moves).to_have_count(5)
    for place in range(5):
        expect(moves.nth(place)).to_have_attribute("aria-disabled", "true")
    expect(page.get_by_text(re.compile(re.escape(SERVICE["hasControl"].replace("{name}", "")))).first).to_be_visible()
    expect(box(page)).to_be_disabled()
    expect(page.get_by_role("textbox", name="λ_q value [s]", exact=True)).to_be_disabled()
    expect(page.get_by_role("switch", name=OPERATE["rejection"])).to_be_disabled()
    before = same_operator.state()["tuning"]["lam_q"]

    page.get_by_role("button", name="Take control", exact=True).first.click()
    expect(page.get_by_role("button", name="Control: you")).to_be_visible()
    expect(box(page)).to_be_enabled()
    expect(moves.filter(has_text="Compliance")).not_to_have_attribute("aria-disabled", "true")
    assert same_operator.state()["holder"]["name"] == "Vera Other"
    assert same_operator.state()["tuning"]["lam_q"] == before
    same_operator.take_control()
    expect(box(page)).to_be_disabled()
    context.close()
