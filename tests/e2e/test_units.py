"""Angles are entered and shown in degrees or radians: refused in the unit at the field, and converted everywhere."""

import re

from playwright.sync_api import Browser, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

CHARTS = load_texts("charts")
FIELD = "Joint position steps between ±q_max"


def test_angles_are_refused_in_the_selected_unit_and_the_unit_applies_everywhere(
    browser: Browser, service: Service
) -> None:
    page = browser.new_context(viewport=DESKTOP).new_page()  # the console may report refused requests
    operator = Operator(page, service)
    operator.sign_in()
    operator.go("Experiments")
    box = page.get_by_label(f"{FIELD} [°]")
    expect(box).to_have_value("60")
    box.fill("120")
    page.get_by_role("button", name="Dry run", exact=True).click()
    refused = page.get_by_text(re.compile(r"joint position steps .*: 120° is outside 0\.573 to 80\.2°; choose"))
    expect(refused).to_be_visible()
    expect(box).to_have_attribute("aria-invalid", "true")
    expect(box).to_be_focused()
    described = (box.get_attribute("aria-describedby") or "").split()
    assert refused.get_attribute("id") in described

    page.get_by_role("button", name="Angles in degrees: ° / rad", exact=True).click()
    box = page.get_by_label(f"{FIELD} [rad]")
    expect(box).to_have_value("2.0944")
    expect(
        page.get_by_text(re.compile(r"joint position steps .*: 2\.09\d* rad is outside 0\.01 to 1\.4"))
    ).to_be_visible()
    in_degrees = page.get_by_text(re.compile(r"\d°(?! step)"))
    in_degrees = in_degrees.filter(has_not_text="phase margin")  # always in degrees
    expect(in_degrees).to_have_count(0)
    operator.go("Operate")
    expect(page.get_by_label("q_ref value [rad]")).to_be_visible()
    expect(page.get_by_text(f"S [N·m/rad] {CHARTS['versus']} q [rad]")).to_be_visible()
    expect(page.get_by_text("[°]")).to_have_count(0)

    page.reload()
    page.get_by_role("button", name="Angles in radians: ° / rad", exact=True).click()
    expect(page.get_by_label("q_ref value [°]")).to_be_visible()
    page.context.close()
