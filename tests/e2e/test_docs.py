"""What is written is read where one works: every document, its links, a search; the set-up leads into it."""

import re
from pathlib import Path
from typing import Literal

import pytest
from playwright.sync_api import Browser, Page, ViewportSize, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.layout import document_scrolls_by
from tests.e2e.operator import Operator
from tests.e2e.service import Service
from tests.e2e.test_accessibility import PHONE, violations

DOCS = Path(__file__).parents[2] / "docs"


def headings(name: str) -> list[str]:
    """Return the headings of a file as they are read, without the marks of its markup; code is none."""
    text = re.sub(r"^```.*?^```", "", (DOCS / f"{name}.md").read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    found = re.findall(r"^#{1,4} (.+)$", text, flags=re.MULTILINE)
    return [re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", one).replace("`", "").replace("*", "").strip() for one in found]


def in_sight(page: Page, title: str) -> None:
    expect(page.get_by_role("article").get_by_role("heading", name=title, exact=True)).to_be_in_viewport()


def test_what_is_written_is_read_and_found_in_the_dashboard(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.settled_mode()
    page.keyboard.press("d")
    contents = page.get_by_role("navigation", name="Documents", exact=True)
    for name in ("first-hour", "faults", "fidelity", "notation"):
        contents.get_by_role("link", name=headings(name)[0], exact=True).click()
        expect(page).to_have_url(re.compile(f"#/docs/{name}$"))
        expect(contents.locator("[aria-current=page]")).to_have_text(headings(name)[0])
        shown = page.get_by_role("article").get_by_role("heading")
        expect(shown).to_have_text(headings(name))

    page.get_by_role("textbox", name="Search in all of them", exact=True).fill("hands module cut")
    count = page.get_by_role("status", name="Found", exact=True)
    expect(count).to_have_text(re.compile(r"^\d+ places?"))
    first = page.get_by_role("main").get_by_role("listitem").get_by_role("link").first
    title = first.inner_text().rsplit(": ", 1)[-1]
    first.click()
    in_sight(page, title)
    expect(contents).to_be_visible()  # the search is over

    page.goto(f"{operator.service.url}/#/docs/rig")
    page.get_by_role("article").get_by_role("link", name="faults.md", exact=True).first.click()
    in_sight(page, "A card and its wires")
    page.goto(f"{operator.service.url}/#/docs/no-such-thing")
    expect(page.get_by_role("main")).to_contain_text("There is no document “no-such-thing”")


def test_the_set_up_tells_how(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    page.get_by_role("button", name="Set-up", exact=True).click()
    steps = page.get_by_role("list", name="Steps of the set-up", exact=True)
    told = page.request.get(f"{operator.service.url}/api/checklist").json()["steps"]
    expect(steps.get_by_role("listitem")).to_have_count(len(told))
    for row, step in enumerate(told):
        expect(steps.get_by_role("listitem").nth(row)).to_contain_text(step["detail"])
    steps.get_by_role("link", name="Tuning: how, and why", exact=True).click()
    in_sight(page, "Tune")


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_everybody_can_read_it(
    browser: Browser, service: Service, size: ViewportSize, scheme: Literal["light", "dark"]
) -> None:
    context = browser.new_context(viewport=size, color_scheme=scheme)
    page = context.new_page()
    Operator(page, service).sign_in()
    page.goto(f"{service.url}/#/docs/notation")  # wide tables
    expect(page.get_by_role("article").get_by_role("heading").first).to_be_visible()
    assert violations(page) == []
    assert document_scrolls_by(page) == 0
    context.close()
