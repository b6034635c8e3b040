"""Terms have tooltips with the texts of the service, and all terms are in the glossary."""

import math
import os
import re
from collections.abc import Iterator
from typing import Literal

import pytest
from playwright.sync_api import Browser, Locator, Page, ViewportSize, expect

from backend.faults import EXPLANATIONS, Fault
from backend.glossary.glossary import TermKind, build_glossary
from tests.api.conftest import client_with
from tests.e2e.browser import DESKTOP
from tests.e2e.layout import covered
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.sharing import SharedPage, bring_to_run, shared_page
from tests.e2e.test_accessibility import PHONE, violations
from tests.e2e.test_experiments_and_runs import SHORT

EXPERIMENT_TEXTS = load_texts("pages/experiments")
OPERATE = load_texts("pages/operate")
TEXTS = load_texts("pages/glossary")
SYSTEM = load_texts("pages/system")
STOP = "button[aria-label=STOP]"
ENTRIES = build_glossary()


@pytest.fixture(scope="module")
def shared(browser: Browser, service: Service) -> Iterator[SharedPage]:
    with shared_page(browser, service, "operate") as shared:
        yield shared


@pytest.fixture
def operator(shared: SharedPage, request: pytest.FixtureRequest) -> Iterator[Operator]:
    with shared.turn_of(request) as operator:
        yield operator


def tooltip(page: Page) -> Locator:
    return page.get_by_role("tooltip")


def term(page: Page, text: str, within: Locator | None = None) -> Locator:
    return (within or page).get_by_role("term").filter(has_text=re.compile(f"^{re.escape(text)}$")).first


def expect_tooltip_of(page: Page, key: str) -> None:
    """Expect one tooltip with the explanation of the service, with angles in the displayed unit."""
    entry = ENTRIES[key]
    expect(tooltip(page)).to_have_count(1)
    for words in (entry.meaning, entry.equation, entry.source, *(text for _, text in entry.more)):
        if "rad" not in words.split():
            expect(tooltip(page)).to_contain_text(words)


def test_terms_show_their_explanation_on_hover_and_on_focus(operator: Operator) -> None:
    page = operator.page
    operator.go("Operate")
    tuning = page.get_by_role("region", name="Tuning", exact=True)
    expect(page.get_by_role("slider", name="λ_q", exact=True)).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    term(page, "GM", tuning).scroll_into_view_if_needed()
    before = tuning.bounding_box()

    term(page, "Ms", tuning).hover()
    expect_tooltip_of(page, "quantity:M_s")
    assert covered(page, STOP) == []
    page.keyboard.press("Escape")
    expect(tooltip(page)).to_have_count(0)
    term(page, "GM", tuning).hover()
    expect_tooltip_of(page, "quantity:gain_margin")
    assert tuning.bounding_box() == before  # a tooltip moves nothing
    page.mouse.move(2, 450)
    expect(tooltip(page)).to_have_count(0)

    # Tab reaches one term of the card, the arrow keys the others
    assert tuning.get_by_role("term").evaluate_all("all => all.filter(one => one.tabIndex === 0).length") == 1
    first = term(page, "λq", tuning)
    first.focus()
    page.keyboard.press("Shift+Tab")
    page.keyboard.press("Tab")
    expect(first).to_be_focused()
    expect_tooltip_of(page, "signal:lam_q")
    page.keyboard.press("ArrowRight")
    expect_tooltip_of(page, "quantity:M_s")
    expect(term(page, "Ms", tuning)).to_have_attribute("aria-describedby", str(tooltip(page).get_attribute("id")))
    expect(term(page, "Ms", tuning)).to_have_accessible_description(re.compile("maximum sensitivity"))
    page.keyboard.press("Escape")
    expect(tooltip(page)).to_have_count(0)

    # legends and charts have tooltips
    operator.legend("Tendon force", "F_B").hover()
    expect_tooltip_of(page, "signal:F_B")
    term(page, "Joint stiffness").hover()
    expect(tooltip(page)).to_contain_text(ENTRIES["signal:S"].equation)
    expect(tooltip(page)).to_contain_text(ENTRIES["signal:S_ref"].meaning)


def test_the_tooltip_of_a_fault_agrees_with_the_state(operator: Operator) -> None:
    page = operator.page
    operator.press("STOP")
    fault = page.get_by_role("alert", name="Fault", exact=True)
    expect(fault).to_contain_text(EXPLANATIONS[Fault.STOP_PRESSED].message)
    with client_with(operator.service, "token") as script:
        latched = script.get("/api/state").json()["fault"]
    fault.get_by_role("term").hover()
    expect_tooltip_of(page, f"fault:{latched['code']}")
    expect(tooltip(page)).to_contain_text(latched["message"])
    expect(tooltip(page)).to_contain_text(latched["remedy"])
    page.mouse.move(2, 450)
    operator.press("Reset")
    operator.go("System")
    chain = page.get_by_role("region", name=SYSTEM["chain"], exact=True)
    chain.get_by_role("term").last.hover()
    expect_tooltip_of(page, "chain:safety_module")


def test_metrics_and_verdicts_of_a_result_have_tooltips(operator: Operator) -> None:
    page = operator.page
    with client_with(operator.service, "token") as script:
        script.post("/api/experiments/own", json={"text": SHORT}).raise_for_status()
    bring_to_run(operator.service)
    operator.go("Experiments")
    page.get_by_role("combobox", name=EXPERIMENT_TEXTS["kindOfExperiment"], exact=True).select_option("short@1")
    page.locator("main form").first.get_by_role("button", name=re.compile("^Start ")).click()
    done = page.get_by_role("region", name="Result", exact=True)
    expect(done.get_by_role("table", name="Metrics")).to_be_visible(timeout=3 * MOTION_TIMEOUT_MS)
    run = int(page.url.rsplit("/", 1)[1])
    with client_with(operator.service, "token") as script:
        result = script.get(f"/api/experiments/{run}").json()
    for metric in result["metrics"]:
        term(page, metric["label"], done).hover()
        expect(tooltip(page)).to_contain_text(ENTRIES[f"figure:{metric['name']}"].equation)
        if "rad" not in metric["definition"].split():
            expect(tooltip(page)).to_contain_text(metric["definition"])
    verdict = done.get_by_role("term").filter(has_text=result["verdict"])
    verdict.hover()
    expect_tooltip_of(page, f"outcome:{result['outcome']}")


def test_tooltips_of_fields_show_the_meaning_and_the_limits_of_the_service(operator: Operator) -> None:
    page = operator.page
    with client_with(operator.service, "token") as script:
        kinds = script.get("/api/identification-kinds").json()["kinds"]
        limits = script.get("/api/state").json()["limits"]
    operator.go("Identify")
    for kind in kinds:
        page.get_by_text(kind["title"], exact=True).first.click()
        for setting in kind["settings"]:
            page.locator(f"main form [name='{setting['name']}']").focus()
            expect(tooltip(page)).to_contain_text(setting["meaning"][1:])
            if setting["minimum"] is not None and setting["unit"] != "rad":
                expect(tooltip(page)).to_contain_text(f"{setting['minimum']:g} to {setting['maximum']:g}")
    page.keyboard.press("Escape")
    expect(tooltip(page)).to_have_count(0)
    bring_to_run(operator.service)
    operator.go("Operate")
    expect(page.get_by_role("textbox", name="S_ref value [N·m/rad]", exact=True)).to_be_enabled()
    for label, name, ends in (
        ("Push [N]", "push.F_push", f"−{limits['F_push_max']:g} to {limits['F_push_max']:g} N"),
        (OPERATE["threshold"], "touch.contact_N", f"{limits['F_contact_min']:g} to {limits['F_contact_max']:g} N"),
        (OPERATE["wallDamping"], "wall.c_wall", f"0 to {math.floor(1e2 * limits['c_wall_max']) / 1e2:g} s/m"),
        ("S_ref value [N·m/rad]", "references.S_ref", "N·m/rad"),
        ("λ_q value [s]", "tuning.lam_q", " s"),
    ):
        page.get_by_role("textbox", name=label, exact=True).focus()
        expect_tooltip_of(page, f"setting:{name}")
        expect(tooltip(page)).to_contain_text(ends)
        assert covered(page, STOP) == []
    page.keyboard.press("Escape")
    expect(tooltip(page)).to_have_count(0)


def test_the_glossary_finds_every_term(operator: Operator) -> None:
    page = operator.page
    page.keyboard.press("?")
    page.get_by_role("dialog", name="Keyboard shortcuts").get_by_role("link", name="Glossary").click()
    expect(page.get_by_role("heading", level=1, name="Glossary")).to_be_visible()
    expect(page.get_by_role("status", name=TEXTS["found"])).to_have_text(f"{len(ENTRIES)} entries")
    faults = page.get_by_role("region", name="Faults", exact=True)
    listed = sum(entry.kind is TermKind.FAULT for entry in ENTRIES.values())
    expect(faults.get_by_role("listitem")).to_have_count(listed)
    page.get_by_role("textbox", name=TEXTS["search"]).fill("card watchdog drives")
    expect(page.get_by_role("main")).to_contain_text(EXPLANATIONS[Fault.WATCHDOG].message)
    expect(page.get_by_role("region", name="Modes", exact=True)).to_have_count(0)
    page.get_by_role("textbox", name=TEXTS["search"]).fill("no such word")
    expect(page.get_by_role("status", name=TEXTS["found"])).to_have_text("0 entries")


@pytest.mark.parametrize(("scheme", "size"), [("light", PHONE), ("dark", DESKTOP)], ids=["light-phone", "dark-desktop"])
def test_tooltips_are_accessible_and_stay_inside_the_window(
    browser: Browser, service: Service, scheme: Literal["light", "dark"], size: ViewportSize
) -> None:
    by_touch = size == PHONE
    context = browser.new_context(viewport=size, color_scheme=scheme, has_touch=by_touch, reduced_motion="reduce")
    operator = Operator(context.new_page(), service)
    page = operator.page
    operator.sign_in()
    operator.go("Operate")
    expect(page.get_by_role("slider", name="λ_q", exact=True)).to_be_attached(timeout=MOTION_TIMEOUT_MS)
    for word in ("Ms", "PM", "Motor voltage"):
        term(page, word).tap() if by_touch else term(page, word).click()
        expect(tooltip(page)).to_be_in_viewport(ratio=1)
        assert covered(page, STOP) == []
        if (pictures := os.environ.get("GLOSSARY_PICTURES")) is not None:
            page.screenshot(path=f"{pictures}/{word.split()[0]}-{scheme}-{size['width']}.png")
        # a tooltip over a control does not reduce its target size
        assert [one for one in violations(page) if not one.startswith("target-size")] == []
        page.keyboard.press("Escape")  # on a phone it may cover the next word
        expect(tooltip(page)).to_have_count(0)
    assert violations(page) == []
    page.goto(f"{page.url.split('#')[0]}#/glossary")
    expect(page.get_by_role("status", name=TEXTS["found"])).to_be_visible()
    assert violations(page) == []
    if (pictures := os.environ.get("GLOSSARY_PICTURES")) is not None:
        page.screenshot(path=f"{pictures}/glossary-{scheme}-{size['width']}.png")
    assert page.evaluate("document.documentElement.scrollWidth - window.innerWidth") <= 0
    context.close()
