"""The page of a viewer shows VIEW and offers only commands that the service accepts."""

import re

from playwright.sync_api import Browser, Page, Response, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.layout import survey
from tests.e2e.operator import Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

IDENTIFY_TEXTS = load_texts("pages/identify")
EXPERIMENT_TEXTS = load_texts("pages/experiments")
STUDY_TEXTS = load_texts("pages/studies")
BANKS = load_texts("pages/banks")
RUNS = load_texts("pages/runs")
OPERATE = load_texts("pages/operate")
LOG = load_texts("pages/log")

PAGES = ("operate", "bring-up", "identify", "banks", "experiments", "runs", "system", "system/developer")
SEEN = {
    "operate": f"{OPERATE['activeValues']}|{OPERATE['active']}",
    "bring-up": "The bring-up requires a rig",
    "identify": f"{IDENTIFY_TEXTS['bits']}|{re.escape(IDENTIFY_TEXTS['forOperators'])}",
    "banks": BANKS["active"].replace("{tuning}", "λ_q"),
    "experiments": EXPERIMENT_TEXTS["loopSettings"].format(tuning="λ_q"),
    "studies": f"{STUDY_TEXTS['noStudies']}|{STUDY_TEXTS['study']}",
    "runs": f"{RUNS['noRuns']}|session",
    "log": LOG["entries"],
    "system": r"sqlite, .* MB",
    "system/developer": "force_limit",
}
"""What stands on a page once the service has told it; before that there is nothing to look through."""

WORDS = "buttons => buttons.map(one => one.getAttribute('aria-label') || one.innerText)"
SHARED = load_texts("components")
SYSTEM = load_texts("pages/system")
COMMANDING = (
    "Pretension|Run|Compliance|Soft stop|Off|Reset|Start .*|Add to queue|Start queue|"
    f"Pause after this run|{BANKS['activate']} .*|Import.*"
    f"|{SYSTEM['backUp']}|{SYSTEM['check']}|{SYSTEM['clearAll']}|{SYSTEM['injectNamed'].replace('{name}', '.*')}"
    "|Save note|Build .*|Apply|Save|Take control"
)


def signed_in_as_viewer(browser: Browser, service: Service) -> tuple[Page, list[str]]:
    """Return the page of a viewer, and the list of its refused requests."""
    page = browser.new_context(viewport=DESKTOP).new_page()
    refused: list[str] = []

    def note(answer: Response) -> None:
        if answer.status in (401, 403):
            refused.append(f"{answer.request.method} {answer.url}")

    page.goto(service.url)
    page.get_by_role("textbox", name="Token").fill((service.data / "viewer-token").read_text().strip())
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("img", name="Viewer")).to_have_text("VIEW")
    page.on("response", note)
    return page, refused


def test_the_page_of_a_viewer_offers_only_accepted_commands(browser: Browser, service: Service) -> None:
    page, refused = signed_in_as_viewer(browser, service)
    for name in PAGES:
        page.goto(f"{service.url}/#/{name}")
        expect(page.get_by_role("heading", level=1)).to_have_count(1)
        expect(page.get_by_role("button", name="STOP", exact=True)).to_be_enabled()
        expect(page.get_by_role("main")).to_contain_text(re.compile(SEEN[name]))
        for words in page.get_by_role("button").evaluate_all(WORDS):
            assert not _commands(words.strip()), f"{name} offers {words!r} to a viewer"
        assert page.get_by_role("slider").locator("visible=true").count() == 0 or name == "runs"
    page.goto(f"{service.url}/#/operate")
    page.get_by_role("img", name="Reachable map").click()
    page.get_by_role("button", name="Control: ").click()
    expect(page.get_by_text(SHARED["anyoneStops"])).to_be_visible()
    assert page.locator("[role=menuitem]:not([aria-disabled])").all_inner_texts() == ["Change name", "Sign out"]
    assert refused == []
    page.context.close()


def _commands(words: str) -> bool:
    return re.fullmatch(COMMANDING, words) is not None


def words_and_moves_are_apart(page: Page) -> bool:
    placed = survey(page, {"words": "[role=tooltip]", "moves": "[aria-label='Change mode'] button"})
    return bool(placed["words"]) and not any(
        words.overlaps(move) for words in placed["words"] for move in placed["moves"]
    )


def test_tooltips_of_modes_do_not_cover_buttons(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.settled_mode()
    moves = page.get_by_role("group", name="Change mode").get_by_role("button")
    expect(moves).to_have_count(5)
    for move in moves.all():
        move.hover()
        words = page.get_by_role("tooltip")
        expect(words).to_be_visible()
        # at one moment, because a new line above would move both
        operator.wait(lambda: words_and_moves_are_apart(page))
        page.mouse.move(5, 5)
        expect(words).to_have_count(0)
