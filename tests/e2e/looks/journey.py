"""Bring one service through all its states, and pass each page to a callback."""

import re

from playwright.sync_api import Browser, expect

from tests.e2e.browser import DESKTOP
from tests.e2e.looks.later import look_back, trip, watch
from tests.e2e.looks.pages import Look, settled, to_the_top, visit
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service
from tests.e2e.test_experiments_and_runs import DRY_RUN_TIMEOUT_MS
from tests.e2e.test_session import IDENTIFICATION_TIMEOUT_MS, build_and_activate_a_bank

IDENTIFY_TEXTS = load_texts("pages/identify")
EXPERIMENT_TEXTS = load_texts("pages/experiments")
OPERATE = load_texts("pages/operate")
SHARED = load_texts("components")

STUDY = """format: 1
name: small
title: Small map
settings: {q_duration_s: 0.5, S_duration_s: 0.5, S_high: 12.0}
axes:
  - {over: lam_q, values: [0.5, 0.65, 0.8]}
  - {over: lam_S, values: [0.5, 0.7, 0.9]}
"""
EMPTY = ("operate", "bring-up", "identify", "banks", "experiments", "studies", "runs", "log", "system")
"""Pages of a service that has just been started for the first time."""


def journey(browser: Browser, service: Service, look: Look) -> None:
    """Bring a service with an empty data folder from the sign-in through each kind of work to the trip."""
    signing_in(browser, service, look)
    context = browser.new_context(viewport=DESKTOP)
    operator = Operator(context.new_page(), service)
    first_time(operator, look)
    pretension(operator, look)
    run = identification(operator, look)
    bank(operator, run, look)
    experiment(operator, look)
    following(operator, look)
    overlays(operator, look)
    look_back(operator, look)
    trip(operator, look)
    watch(browser, service, look)
    context.close()


def signing_in(browser: Browser, service: Service, look: Look) -> None:
    context = browser.new_context(viewport=DESKTOP)
    page = context.new_page()
    page.goto(service.url)
    token = page.get_by_role("textbox", name="Token")
    expect(token).to_be_visible()
    look(page, "sign-in")
    token.fill("not-the-token")
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("alert")).to_be_visible()
    look(page, "sign-in-refused")
    context.close()


def first_time(operator: Operator, look: Look) -> None:
    """Show the page to a new person: the tour, the request for a name, empty lists."""
    page = operator.page
    page.goto(operator.service.link)
    expect(page.get_by_role("banner")).to_be_visible()
    asked = page.get_by_role("button", name=SHARED["continueAs"].replace("{role}", "operator"), exact=True)
    skip = page.get_by_role("button", name="Skip tour", exact=True)
    expect(skip).to_be_visible()
    look(page, "tour")
    skip.click()
    if asked.count():
        look(page, "name-asked")
        asked.click()
    begin_a_study(operator)
    for name in EMPTY:
        visit(operator, name)
        look(page, f"{name}-idle")
    for name in ("docs", "glossary", "system/developer"):
        visit(operator, name)
        look(page, name.rpartition("/")[2])


def begin_a_study(operator: Operator) -> None:
    answer = operator.page.request.post(f"{operator.service.url}/api/studies", data={"text": STUDY})
    assert answer.ok, answer.text()


def pretension(operator: Operator, look: Look) -> None:
    visit(operator, "operate")
    operator.press("Pretension")
    operator.expect_mode("pretension")
    look(operator.page, "operate-pretension")
    operator.bring_up()


def identification(operator: Operator, look: Look) -> str:
    """Identify at 20 N and return the name of the run."""
    page = operator.page
    visit(operator, "identify")
    operator.fill(IDENTIFY_TEXTS["bits"], 6)
    prediction = page.get_by_role("status", name=IDENTIFY_TEXTS["forecastStatus"], exact=True)
    expect(prediction).to_contain_text("encoder counts", timeout=MOTION_TIMEOUT_MS)
    look(page, "identify-ready")
    operator.press(IDENTIFY_TEXTS["start"])
    expect(page.get_by_role("region", name=OPERATE["running"], exact=True)).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    to_the_top(page)
    look(page, "identify-running")
    visit(operator, "operate")
    look(page, "operate-identify")
    visit(operator, "identify")
    result = page.get_by_role("region", name="Result", exact=True)
    expect(result).to_contain_text("Gq", timeout=IDENTIFICATION_TIMEOUT_MS)
    settled(page)
    to_the_top(page)
    look(page, "identify-result")
    return page.get_by_role("table", name=IDENTIFY_TEXTS["runs"], exact=True).get_by_role("link").first.inner_text()


def bank(operator: Operator, run: str, look: Look) -> None:
    build_and_activate_a_bank(operator, run)
    settled(operator.page)
    look(operator.page, "banks-active")


def experiment(operator: Operator, look: Look) -> None:
    """Start a tracking run with another run queued: dry run, execution, result; then the editor of sequences."""
    page = operator.page
    operator.bring_up()
    visit(operator, "experiments")
    operator.fill("Hold time of each position reference [s]", 6)
    operator.fill("Hold time of each stiffness reference [s]", 6)
    form = page.get_by_role("form", name="Tracking of position and stiffness", exact=True)
    with page.expect_response(lambda answer: answer.url.endswith("/dry-run"), timeout=DRY_RUN_TIMEOUT_MS):
        form.get_by_role("button", name=EXPERIMENT_TEXTS["dryRun"], exact=True).click()
    settled(page)
    page.get_by_role("region", name=EXPERIMENT_TEXTS["dryRun"], exact=True).scroll_into_view_if_needed()
    look(page, "experiments-dry-run")
    form.get_by_role("button", name=EXPERIMENT_TEXTS["addToQueue"], exact=True).click()
    operator.press("Start tracking of position and stiffness")
    operator.expect_mode("experiment")
    expect(page.get_by_role("figure", name="Planned profile")).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    to_the_top(page)
    look(page, "experiments-running")
    visit(operator, "operate")
    look(page, "operate-experiment")
    visit(operator, "experiments")
    expect(page.get_by_role("table", name="Criteria", exact=True)).to_be_visible(timeout=2 * MOTION_TIMEOUT_MS)
    settled(page)
    to_the_top(page)
    look(page, "experiments-result")
    operator.press(EXPERIMENT_TEXTS["startQueue"])
    operator.wait(lambda: len(ended_of(operator, "tracking")) == 2)
    own = page.get_by_role("region", name=EXPERIMENT_TEXTS["ownExperiments"], exact=True)
    own.get_by_role("combobox", name=EXPERIMENT_TEXTS["startFrom"]).select_option("sample sequence")
    expect(own.get_by_role("region", name=EXPERIMENT_TEXTS["preview"], exact=True)).to_contain_text(
        EXPERIMENT_TEXTS["valid"].split("}")[1].split("{")[0].strip(), timeout=DRY_RUN_TIMEOUT_MS
    )
    own.scroll_into_view_if_needed()
    look(page, "experiments-composed")


def ended_of(operator: Operator, kind: str) -> list[str]:
    """Return the end states of the runs of this kind."""
    runs = operator.page.request.get(f"{operator.service.url}/api/runs?kind={kind}").json()["runs"]
    return [run["end_state"] for run in runs if run["end_state"] != "running"]


def following(operator: Operator, look: Look) -> None:
    """Show mode Run between two angles, then with a staged tuning."""
    page = operator.page
    operator.be_in_run()
    expect(page.get_by_role("slider", name="λ_q", exact=True)).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    for target in (25.0, -25.0):
        operator.enter("q_ref value [°]", target)
        operator.wait_for_samples(4000)
    look(page, "operate-run")
    for name in EMPTY[1:]:
        visit(operator, name)
        look(page, f"{name}-run")
    visit(operator, "operate")
    page.get_by_role("button", name="Statistics").click()
    page.get_by_role("switch", name="Stage changes").check()
    operator.enter("λ_q value [s]", 0.45)
    expect(page.get_by_role("group", name=OPERATE["preview"].format(symbol="λ_q"), exact=True)).to_contain_text(
        OPERATE["sensitivityPeak"]
    )
    look(page, "operate-staged")
    page.get_by_role("region", name=OPERATE["tuningChanges"]).get_by_role("button", name="Discard", exact=True).click()
    page.get_by_role("switch", name="Stage changes").uncheck()
    page.get_by_role("button", name="Statistics").click()


def overlays(operator: Operator, look: Look) -> None:
    """Show the overlays of a page: setup steps, shortcuts, people, notifications, explanations."""
    page = operator.page
    page.keyboard.press("c")
    expect(page.get_by_role("list", name=SHARED["setupSteps"])).to_be_visible()
    look(page, "set-up")
    page.keyboard.press("Escape")
    page.keyboard.press("?")
    expect(page.get_by_role("dialog", name=SHARED["shortcuts"])).to_be_visible()
    look(page, "shortcuts")
    page.keyboard.press("Escape")
    for name, of in (("control", re.compile("^Control: ")), ("notifications", "Notifications")):
        page.get_by_role("button", name=of).click()
        expect(page.get_by_role("menu")).to_have_css("opacity", "1")
        look(page, name)
        page.keyboard.press("Escape")
        expect(page.get_by_role("menu")).to_have_count(0)
    page.get_by_role("figure", name="Joint stiffness").get_by_role("button", name="S_ref", exact=True).focus()
    expect(page.get_by_role("tooltip")).to_be_visible()
    look(page, "explanation")
    page.keyboard.press("Escape")
