"""Every absent value has a reason that is shown and announced: on a new page, in mode Run, and for a viewer."""

import re

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.test_viewer import PAGES, SEEN, signed_in_as_viewer

IDENTIFY_TEXTS = load_texts("pages/identify")
OPERATE = load_texts("pages/operate")

BARE = """() => {
  const found = [];
  const texts = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (texts.nextNode()) {
    const holder = texts.currentNode.parentElement;
    if (!/^\\s*[\\u2013\\u2014-]\\s*$/.test(texts.currentNode.textContent) || holder.closest("style, script")) continue;
    if (!holder.title || holder.getAttribute("aria-label") !== holder.title) found.push(holder.outerHTML);
  }
  for (const cell of document.querySelectorAll("td, dd")) {
    if (cell.textContent.trim() === "" && cell.childElementCount === 0) found.push(cell.parentElement.outerHTML);
  }
  return found;
}"""


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


def test_nothing_is_absent_without_a_reason(operator: Operator, browser: Browser, service: Service) -> None:
    page = operator.page
    operator.sign_in()
    look_through(page, service)
    page.goto(f"{service.url}/#/operate")
    staged = page.get_by_role("table", name=OPERATE["tuningTable"])
    expect(staged.get_by_role("img", name=OPERATE["nothingStaged"])).to_have_text(["–", "–"])
    operator.be_in_run()
    look_through(page, service, ("operate", "runs"))
    viewer, _ = signed_in_as_viewer(browser, service)
    look_through(viewer, service)
    viewer.context.close()


def look_through(page: Page, service: Service, names: tuple[str, ...] = PAGES) -> None:
    for name in names:
        page.goto(f"{service.url}/#/{name}")
        expect(page.get_by_role("heading", level=1)).to_have_count(1)
        expect(page.get_by_role("main")).to_contain_text(re.compile(SEEN[name]), timeout=MOTION_TIMEOUT_MS)
        for waiting in ("Loading …", "Loading…", IDENTIFY_TEXTS["predicting"]):
            expect(page.get_by_text(waiting, exact=True)).to_have_count(0, timeout=MOTION_TIMEOUT_MS)
        assert page.evaluate(BARE) == [], name
