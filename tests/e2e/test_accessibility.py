"""axe-core finds no violation of WCAG A and AA on any page; keyboard, phone and reduced motion are supported."""

import re
from pathlib import Path
from typing import Literal

import pytest
from playwright.sync_api import Browser, Page, ViewportSize, expect

from tests.e2e.browser import TABLET
from tests.e2e.layout import document_scrolls_by
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.test_viewer import SEEN

SHARED = load_texts("components")

AXE = (Path(__file__).parents[2] / "frontend" / "node_modules" / "axe-core" / "axe.min.js").read_text(encoding="utf-8")
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa"]
PAGES = ("Operate", "Identify", "Banks", "Experiments", "Studies", "Runs", "Log", "System")
Scheme = Literal["light", "dark"]
SCHEMES: tuple[Scheme, ...] = ("light", "dark")
PHONE = ViewportSize(width=390, height=844)

ENDED = """() => document.getAnimations()
    .filter(one => Number.isFinite(one.effect.getComputedTiming().endTime)).forEach(one => one.finish())"""
"""Ends what fades in or out: half of it is no contrast that a person reads by."""


def violations(page: Page) -> list[str]:
    """Return the findings of axe on the current page: rule, reason, and elements."""
    if not page.evaluate("'axe' in window"):
        page.evaluate(AXE)
    page.evaluate(ENDED)
    found = page.evaluate(
        "rules => axe.run(document, {runOnly: {type: 'tag', values: rules}, iframes: false})"
        ".then(result => result.violations.map(one => `${one.id}: ${one.help}: ${one.nodes.slice(0, 4)"
        ".map(node => node.target.join(' ') + ' ' + (node.any[0]?.message ?? '')).join(' | ')}`))",
        RULES,
    )
    return list(found)


def in_both_schemes(page: Page, found: dict[str, list[str]], name: str) -> None:
    """Check the page in light and in dark mode, without transitions between them."""
    for scheme in SCHEMES:
        in_scheme(page, scheme)
        found[f"{name}, {scheme}"] = violations(page)


def in_scheme(page: Page, scheme: Scheme) -> None:
    page.emulate_media(color_scheme=scheme, reduced_motion="reduce")
    expect(page.locator("html")).to_have_attribute("data-mantine-color-scheme", scheme)


@pytest.mark.parametrize("scheme", SCHEMES)
def test_no_page_violates_wcag_a_or_aa(same_operator: Operator, scheme: Scheme) -> None:
    operator, page = same_operator, same_operator.page
    operator.be_in_run()  # records a manual session for the lists
    in_scheme(page, scheme)
    found: dict[str, list[str]] = {}
    for name in PAGES:
        operator.go(name)
        expect(page.get_by_role("main")).to_contain_text(re.compile(SEEN[name.lower()]))
        found[name] = violations(page)
    operator.go("Runs")
    page.get_by_role("table", name=load_texts("pages/runs")["table"], exact=True).get_by_role("link").first.click()
    expect(page.get_by_role("region", name=load_texts("pages/runs")["lineage"], exact=True)).to_contain_text(
        load_texts("pages/runs")["software"]
    )
    found["one run"] = violations(page)
    page.keyboard.press("c")
    expect(page.get_by_role("list", name=SHARED["setupSteps"])).to_be_visible()
    found["set-up"] = violations(page)
    page.keyboard.press("Escape")
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name="Keyboard shortcuts")).to_be_visible()
    found["shortcuts"] = violations(page)
    page.keyboard.press("Escape")
    page.emulate_media(reduced_motion="null", color_scheme="null")
    assert {name: found[name] for name in found if found[name]} == {}


def test_stop_works_while_a_dialog_is_open(same_operator: Operator) -> None:
    operator, page = same_operator, same_operator.page
    operator.be_in_run()
    page.get_by_role("button", name="Keyboard shortcuts", exact=True).click()
    expect(page.get_by_role("dialog", name="Keyboard shortcuts")).to_be_visible()
    page.get_by_role("button", name="STOP", exact=True, include_hidden=True).click()
    page.keyboard.press("Escape")
    operator.expect_mode("tripped")


def test_the_keyboard_reaches_every_control_and_the_focus_is_visible(same_operator: Operator) -> None:
    operator, page = same_operator, same_operator.page
    operator.be_in_run()  # references can be set in mode Run
    expect(page.get_by_role("slider", name="λ_q", exact=True)).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    reached: set[str] = set()
    ends = presses = 0
    while ends < 2:  # one round through the page
        presses += 1
        assert presses < 300, "the focus does not come round"
        page.keyboard.press("Tab")
        name, outlined = page.evaluate(
            "() => { const at = document.activeElement; if (at === document.body) return [null, false];"
            " const style = getComputedStyle(at);"
            " return [at.getAttribute('aria-label') ?? at.textContent, style.outlineStyle !== 'none' ||"
            " style.boxShadow !== 'none' || at.closest('[data-size]') !== null] }"
        )
        if name is None:  # after the last control, the page has the focus
            ends += 1
            continue
        assert outlined, f"the focus on {name!r} cannot be seen"
        reached.add(name.strip())
    assert {"STOP", "Joint position", "Live", "Measure", "Save data", "λ_q", "Decrease λ_q", "q_ref"} <= reached


def test_small_screens_show_state_and_stop_without_scrolling_sideways(browser: Browser, service: Service) -> None:
    context = browser.new_context(viewport=PHONE, has_touch=True)
    operator = Operator(context.new_page(), service)
    page = operator.page
    operator.sign_in()
    operator.be_in_run()
    for size in (PHONE, TABLET):
        page.set_viewport_size(size)
        for name in PAGES:
            operator.go(name)
            overflow = page.evaluate("document.documentElement.scrollWidth - window.innerWidth")
            assert overflow <= 0, f"{name} is {overflow} px wider than the screen of {size}"
            assert document_scrolls_by(page) <= 0, f"{name} scrolls STOP out of sight at {size}"
            stop = page.get_by_role("button", name="STOP", exact=True)
            expect(stop).to_be_in_viewport(ratio=1)
            expect(page.get_by_role("status", name="Mode", exact=True)).to_be_in_viewport(ratio=1)
        stop.tap()
        operator.expect_mode("tripped")
        expect(page.get_by_role("alert", name="Fault", exact=True)).to_be_in_viewport()
        operator.press("Reset")
        operator.expect_mode("off")
    context.close()
