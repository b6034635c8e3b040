"""At 1440x900 the start button is visible with the longest form open, and covers no field."""

import re

from playwright.sync_api import Locator, Page, expect

from tests.e2e.layout import covered
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts

IDENTIFY_TEXTS = load_texts("pages/identify")
EXPERIMENT_TEXTS = load_texts("pages/experiments")
OPERATE = load_texts("pages/operate")

FIELDS = "main form input:not([type=hidden], [type=file]), main form select, main form summary"
IN_SIGHT = """
button => {
    const { left, top, right, bottom } = button.getBoundingClientRect();
    const hit = document.elementFromPoint((left + right) / 2, (top + bottom) / 2);
    return top >= 0 && left >= 0 && bottom <= innerHeight && right <= innerWidth && button.contains(hit);
}
"""
TO_THE_TOP = "document.querySelectorAll('main, main *').forEach(one => one.scrollTop > 0 && one.scrollTo(0, 0))"


def test_start_and_queue_are_visible_on_every_experiment_form(same_operator: Operator) -> None:
    operator, page = same_operator, same_operator.page
    operator.go("Experiments")
    kinds = page.get_by_role("combobox", name=EXPERIMENT_TEXTS["kindOfExperiment"])
    for kind in ("tracking", "compliance"):
        kinds.select_option(kind)
        form = page.locator("main form").first
        form.locator("summary").click()
        names = (re.compile("^Start "), EXPERIMENT_TEXTS["addToQueue"], EXPERIMENT_TEXTS["dryRun"])
        _in_sight(page, *(form.get_by_role("button", name=name) for name in names))


def test_start_is_visible_on_every_identification_form(same_operator: Operator) -> None:
    operator, page = same_operator, same_operator.page
    operator.go("Identify")
    for kind in ("Actuator", "Motors", "Springs"):
        page.get_by_role("radiogroup", name=IDENTIFY_TEXTS["kind"]).get_by_text(kind, exact=True).click()
        _in_sight(page, page.get_by_role("button", name=IDENTIFY_TEXTS["start"]))


def test_buttons_that_change_the_tuning_or_the_banks_are_visible(same_operator: Operator) -> None:
    operator, page = same_operator, same_operator.page
    operator.go("Operate")
    expect(page.get_by_role("slider", name="λ_q", exact=True)).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    page.get_by_role("switch", name="Stage changes").check()
    changes = page.get_by_role("region", name=OPERATE["tuningChanges"])
    names = ("Apply", "Try for", "Discard", "Revert to saved", "Save")
    _in_sight(page, *(changes.get_by_role("button", name=name, exact=True) for name in names))
    assert covered(page, "main section[aria-label=Tuning] :is(button, input:not([type=hidden]), [role=slider])") == []
    page.get_by_role("switch", name="Stage changes").uncheck()
    operator.go("Banks")
    _in_sight(page, page.get_by_role("button", name=load_texts("pages/banks")["importBank"]))


def _in_sight(page: Page, *buttons: Locator) -> None:
    page.evaluate(TO_THE_TOP)
    for button in buttons:
        assert button.evaluate(IN_SIGHT), button
    assert covered(page, FIELDS) == []


def test_the_buttons_do_not_cover_the_forecast_of_a_step(same_operator: Operator) -> None:
    """At 1440 × 900, the sticky buttons once covered its last line."""
    page = same_operator.page
    page.set_viewport_size({"width": 1440, "height": 900})
    same_operator.bring_up()
    skip = page.get_by_role("button", name="Skip tour", exact=True)
    if skip.is_visible():
        skip.click()
    forecast = page.get_by_role("status", name=OPERATE["forecastOfQ"], exact=True)
    expect(forecast).to_have_text(re.compile(r"90 % after \d"))
    told = forecast.bounding_box()
    decides = page.get_by_role("button", name="Revert to saved", exact=True).bounding_box()
    assert told is not None
    assert decides is not None
    assert told["y"] + told["height"] <= decides["y"]
