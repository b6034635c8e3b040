"""Accessibility and layout of each page in each state of the service; STOP and the mode are always visible."""

import re
from functools import partial

import pytest
from playwright.sync_api import Browser, Page, ViewportSize

from tests.e2e.browser import DESKTOP, TABLET
from tests.e2e.layout import covered, cut, document_scrolls_by, sideways, stays
from tests.e2e.looks.journey import journey
from tests.e2e.service import Service
from tests.e2e.test_accessibility import PHONE, in_both_schemes

SIZES: dict[str, ViewportSize] = {
    "1920x1080": ViewportSize(width=1920, height=1080),
    "1024x768": TABLET,
    "390x844": PHONE,
    "1440x900": DESKTOP,
}
"""The usual one last: it is what the journey goes on with."""

ALWAYS = "button[aria-label=STOP], [role=status][aria-label=Mode]"
CUT = "main :is(button, label, th, h1, h2, h3, legend, figcaption span):not(.visually-hidden, .visually-hidden *)"


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


@pytest.mark.timeout(2400)  # all states of a service in real time; each wait has its own timeout
def test_every_page_in_every_state_passes_accessibility_and_layout_checks(browser: Browser, service: Service) -> None:
    wrong: dict[str, list[str]] = {}

    def look(page: Page, name: str) -> None:
        in_both_schemes(page, wrong, name)
        page.emulate_media(color_scheme="null", reduced_motion="null")
        for size_name, size in SIZES.items():
            page.set_viewport_size(size)
            wrong[f"{name} at {size_name}"] = stays(page, partial(misplaced, page))

    journey(browser, service, look)
    assert len(wrong) > 300
    assert {where: faults for where, faults in wrong.items() if faults} == {}


def misplaced(page: Page) -> list[str]:
    """Return the elements that are clipped, too wide or covered."""
    faults = [f"cut: {one}" for one in cut(page, CUT)]
    if (wide := sideways(page)) > 0:
        faults.append(f"{wide:g} px too wide")
    if (high := document_scrolls_by(page)) > 0:
        faults.append(f"the document scrolls by {high:g} px, and STOP with it")
    if page.get_by_role("button", name=re.compile("^STOP")).count():
        faults += [f"covered: {one}" for one in covered(page, ALWAYS)]
    return faults
