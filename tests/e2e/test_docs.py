"""The page shows every document with its links and a search; the setup steps link to the documents."""

import re
from pathlib import Path

from playwright.sync_api import Page, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.layout import document_scrolls_by
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.test_accessibility import PHONE, in_both_schemes

SHARED = load_texts("components")

TEXTS = load_texts("pages/docs")
DOCS = Path(__file__).parents[2] / "docs"


def headings(name: str) -> list[str]:
    """Return the headings of a document as displayed, without markup and without code blocks."""
    (file,) = DOCS.rglob(f"{name}.md")
    text = re.sub(r"^```.*?^```", "", file.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    found = re.findall(r"^#{1,4} (.+)$", text, flags=re.MULTILINE)
    return [re.sub(r"\[([^]]*)\]\([^)]*\)", r"\1", one).replace("`", "").replace("*", "").strip() for one in found]


def in_sight(page: Page, title: str) -> None:
    expect(page.get_by_role("article").get_by_role("heading", name=title, exact=True)).to_be_in_viewport()


def test_documents_are_shown_linked_and_searched_on_the_page(same_operator: Operator) -> None:
    operator, page = same_operator, same_operator.page
    operator.settled_mode()
    page.keyboard.press("d")
    contents = page.get_by_role("navigation", name=TEXTS["documents"], exact=True)
    for name in ("first-hour", "faults", "fidelity", "notation"):
        contents.get_by_role("link", name=headings(name)[0], exact=True).click()
        expect(page).to_have_url(re.compile(f"#/docs/{name}$"))
        expect(contents.locator("[aria-current=page]")).to_have_text(headings(name)[0])
        shown = page.get_by_role("article").get_by_role("heading")
        expect(shown).to_have_text(headings(name))

    page.get_by_role("textbox", name=TEXTS["search"], exact=True).fill("safety module trip")
    count = page.get_by_role("status", name=TEXTS["found"], exact=True)
    expect(count).to_have_text(re.compile(r"^\d+ sections?"))
    first = page.get_by_role("main").get_by_role("listitem").get_by_role("link").first
    title = first.inner_text().rsplit(": ", 1)[-1]
    first.click()
    in_sight(page, title)
    expect(contents).to_be_visible()  # the search is closed

    page.goto(f"{operator.service.url}/#/docs/rig")
    page.get_by_role("article").get_by_role("link", name="faults.md", exact=True).first.click()
    in_sight(page, "A card and its wires")
    page.goto(f"{operator.service.url}/#/docs/no-such-thing")
    expect(page.get_by_role("main")).to_contain_text(TEXTS["notFound"].format(name="no-such-thing"))


def test_the_documents_page_is_accessible_and_fits_small_windows(same_operator: Operator) -> None:
    page = same_operator.page
    page.goto(f"{same_operator.service.url}/#/docs/notation")  # wide tables
    expect(page.get_by_role("article").get_by_role("heading").first).to_be_visible()
    for size in (PHONE, DESKTOP):
        page.set_viewport_size(size)
        found: dict[str, list[str]] = {}
        in_both_schemes(page, found, str(size))
        assert {name: found[name] for name in found if found[name]} == {}
        assert document_scrolls_by(page) == 0


def test_setup_steps_link_to_their_documents(same_operator: Operator) -> None:
    operator, page = same_operator, same_operator.page
    page.get_by_role("button", name="Setup", exact=True).click()
    steps = page.get_by_role("list", name=SHARED["setupSteps"], exact=True)
    told = page.request.get(f"{operator.service.url}/api/checklist").json()["steps"]
    expect(steps.get_by_role("listitem")).to_have_count(len(told))
    for row, step in enumerate(told):
        expect(steps.get_by_role("listitem").nth(row)).to_contain_text(step["detail"])
    steps.get_by_role("link", name=SHARED["setupHowTo"].replace("{step}", SHARED["tuning"]), exact=True).click()
    in_sight(page, "Tune")
