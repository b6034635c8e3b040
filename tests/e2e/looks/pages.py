"""Open pages by address, and wait until they are complete."""

from collections.abc import Callable

from playwright.sync_api import Page, expect

from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator

Look = Callable[[Page, str], None]
"""What is done with a page as it is now, whose page and state have this name; the page is left as it was found."""

WAITING = ("Loading …", "Loading…", "Comparing …", "Comparing…", "Predicting …", "Predicting…", "Drawing …")


def visit(operator: Operator, address: str) -> None:
    """Open a page by the part of its address after #/, and wait until it is complete."""
    operator.page.goto(f"{operator.service.url}/#/{address}")
    expect(operator.page.get_by_role("heading", level=1)).to_have_count(1)
    settled(operator.page)


def to_the_top(page: Page) -> None:
    """Scroll to the top of the page, because a click may have scrolled it."""
    page.evaluate("document.querySelectorAll('main, main *').forEach(one => one.scrollTop > 0 && one.scrollTo(0, 0))")


def settled(page: Page) -> None:
    """Wait until nothing is loading and the result is drawn."""
    expect(page.get_by_role("main")).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    page.wait_for_load_state("networkidle")
    for words in WAITING:
        expect(page.get_by_text(words, exact=True)).to_have_count(0, timeout=MOTION_TIMEOUT_MS)
    page.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")
