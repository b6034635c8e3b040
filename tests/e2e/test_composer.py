"""An experiment composed on the page, by keyboard and by drag, against the service's dry run and the recorded run."""

import re
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from tests.e2e import forms
from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.service import Service
from tests.e2e.test_experiments_and_runs import DRY_RUN_TIMEOUT_MS
from tests.e2e.test_own_experiments import metrics_of

PLAYED_TIMEOUT_MS = 3 * MOTION_TIMEOUT_MS
"""A run of 12 s and its result."""

CURRENT = "Preview of what stands here; nothing moves."


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


def previewed(own: Locator) -> str:
    """The sentence of the preview, once it is of what stands there."""
    preview = own.get_by_role("region", name="Preview", exact=True)
    expect(preview.get_by_role("status", name="State of the preview")).to_have_text(CURRENT, timeout=DRY_RUN_TIMEOUT_MS)
    return str(preview.get_by_text("can be run:").inner_text())


def order(own: Locator) -> list[str]:
    """Kinds of the parts in the order in which they stand, each with its number."""
    kinds = own.get_by_role("combobox", name=re.compile(r"^Kind of part"))
    return [f"{str(one.get_attribute('aria-label')).split()[-1]} {one.input_value()}" for one in kinds.all()]


def get(page: Page, service: Service, path: str) -> Any:
    answer = page.request.get(f"{service.url}{path}")
    assert answer.ok, answer.text()
    return answer.json()


def test_a_sequence_is_composed_previewed_kept_run_and_made_again(browser: Browser, service: Service) -> None:  # noqa: PLR0915  # one story
    page = browser.new_context(viewport=DESKTOP).new_page()  # whose console may complain of what is refused
    operator = Operator(page, service)
    operator.sign_in()
    operator.be_in_run()
    operator.go("Experiments")
    own = page.get_by_role("region", name="Own experiments", exact=True)
    own.get_by_role("combobox", name="Begin with").select_option("sample sequence")
    own.get_by_role("textbox", name="Name", exact=True).fill("composed")
    own.get_by_role("textbox", name="Title", exact=True).fill("Composed")
    assert order(own) == ["1.1 step", "1.2 ramp", "1.3 hold"]

    # by keyboard: the button that moved a part keeps the focus, so that it can be pressed again
    own.get_by_role("button", name="Move down part 1.1", exact=True).focus()
    page.keyboard.press("Enter")
    expect(own.get_by_role("button", name="Move down part 1.2", exact=True)).to_be_focused()
    expect(own.get_by_role("status", name="Moved")).to_have_text("Part 1.1 is part 1.2 now.")
    assert order(own) == ["1.1 ramp", "1.2 step", "1.3 hold"]
    own.get_by_role("button", name="Move up part 1.2", exact=True).focus()
    page.keyboard.press("Enter")
    expect(own.get_by_role("button", name="Move up part 1.1", exact=True)).to_be_focused()
    assert order(own) == ["1.1 step", "1.2 ramp", "1.3 hold"]

    # a loop, and a part dragged into it
    own.get_by_role("button", name="Repeat part 1.2", exact=True).click()
    assert order(own) == ["1.1 step", "1.2 repeat", "1.2.1 ramp", "1.3 hold"]
    hold = own.get_by_role("listitem", name="Part 1.3", exact=True).get_by_title("Drag")
    hold.drag_to(own.get_by_role("button", name="Add part 1.2.2", exact=True))
    expect(own.get_by_role("combobox", name="Kind of part 1.2.2", exact=True)).to_have_value("hold")
    assert order(own) == ["1.1 step", "1.2 repeat", "1.2.1 ramp", "1.2.2 hold"]
    own.get_by_role("button", name="Copy part 1.2.1", exact=True).click()
    own.get_by_role("textbox", name="q_ref [°] of part 1.2.1", exact=True).fill("-10")
    own.get_by_role("textbox", name="q_ref [°] of part 1.2.2", exact=True).fill("200")
    row = own.get_by_role("listitem", name="Part 1.2.2", exact=True)
    expect(own.get_by_role("alert")).to_have_text(re.compile("200° is outside"))  # once: its loop says nothing of it
    expect(row.get_by_role("alert")).to_be_visible()
    own.get_by_role("textbox", name="q_ref [°] of part 1.2.2", exact=True).fill("20")
    expect(row).to_contain_text("ramps q to 20° in 2 s")
    sentence = previewed(own)
    expect(row).to_contain_text("at 4 to 12 s, q from −10°, 15°/s")
    expect(row.get_by_role("alert")).to_have_count(0)

    # its own criterion, in the words and the number of the preview
    own.get_by_role("button", name="Add criterion").click()
    own.get_by_role("combobox", name="Figure of criterion 2").select_option("peak_voltage_V")
    own.get_by_role("textbox", name="Bound [V] of criterion 2").fill("0.5")
    assert previewed(own) == sentence.replace("1 criterion", "2 criteria")
    verdicts = own.get_by_role("table", name="Criteria of the preview").get_by_role("row")
    expect(verdicts.nth(2)).to_contain_text("fail")

    own.get_by_role("button", name="Keep", exact=True).click()
    expect(own.get_by_role("status", name="Refusal")).to_contain_text("Kept as composed@1")
    form = page.get_by_role("form", name="Composed", exact=True)
    with page.expect_response(lambda answer: answer.url.endswith("/dry-run"), timeout=DRY_RUN_TIMEOUT_MS) as answered:
        form.get_by_role("button", name="Dry run", exact=True).click()
    figures = metrics_of(answered.value)
    volts, low, high = (figures[name] for name in ("peak_voltage_V", "min_tension_N", "max_tension_N"))
    assert sentence.endswith(f"{volts:#.3g} V at most, tensions {low:#.3g} to {high:#.3g} N.")
    expect(verdicts.nth(2)).to_contain_text(f"{volts:#.3g}")

    # the next version says what is other about it
    own.get_by_role("textbox", name="Time [s] of part 1.2.3", exact=True).fill("1")
    own.get_by_text("Versions of composed: 1").click()
    versions = own.get_by_role("table", name="Versions of composed")
    expect(versions).to_contain_text("without “in a loop: holds the references for 2 s”")
    expect(versions).to_contain_text("with “in a loop: holds the references for 1 s”")
    own.get_by_role("button", name="Keep", exact=True).click()
    expect(own.get_by_role("status", name="Refusal")).to_contain_text("Kept as composed@2")
    expect(versions.get_by_role("row").nth(1)).to_contain_text("the same")
    listed = get(page, service, "/api/experiments/own/composed/versions")["experiments"]
    assert [(one["version"], one["who"]) for one in listed] == [(2, "operator"), (1, "operator")]
    own.get_by_role("button", name="Open version 1").click()
    expect(own.get_by_role("textbox", name="Time [s] of part 1.2.3", exact=True)).to_have_value("2")
    previewed(own)

    # what is recorded is what was composed, and comes back as such
    _, started = forms.pressed(page, form.get_by_role("button", name="Start composed", exact=True), "/api/experiments")
    run = started["id"]
    result = page.get_by_role("region", name="Result", exact=True)
    expect(result).to_contain_text(f"Composed, run {run},", timeout=MOTION_TIMEOUT_MS)
    expect(result).to_contain_text("of 2 criteria", timeout=PLAYED_TIMEOUT_MS)
    page.goto(f"{service.url}/#/runs/{run}")
    page.get_by_role("link", name="Make an experiment of this").click()
    expect(own.get_by_role("textbox", name="Name", exact=True)).to_have_value(f"as_run_{run}")
    words = [row.inner_text() for row in own.get_by_role("listitem", name=re.compile(r"^Part ")).all()]
    told = [
        "from the next motion on λ_q",
        "jumps q to 0°",
        *["ramps q to −10° in 2 s", "ramps q to 20° in 2 s", "holds the references for"] * 2,
    ]
    assert all(part in row for part, row in zip(told, words, strict=True)), words
    previewed(own)
    page.context.close()
