"""The page asks a person for a name once, lists all connected people, and signs out permanently."""

import re
from datetime import datetime

import httpx
import pytest
from playwright.sync_api import Browser, Page, expect

from backend.api.dependencies import PING_TIMEOUT_S
from backend.server.security import COOKIE
from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS
from tests.e2e.page_texts import load_texts
from tests.e2e.relay import relayed
from tests.e2e.service import Service

TEXTS = load_texts("components")

PATIENCE_S = 30.0


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


def test_the_page_asks_for_a_name_once_lists_all_people_and_signs_out(browser: Browser, service: Service) -> None:
    ana = browser.new_context(viewport=DESKTOP).new_page()
    ana.goto(service.link)
    question = ana.get_by_role("form", name="Your name")
    ana.get_by_role("button", name="Skip tour", exact=True).click(timeout=MOTION_TIMEOUT_MS)
    expect(question).to_contain_text(TEXTS["nameAsked"].replace("{role}", "operator"), timeout=MOTION_TIMEOUT_MS)
    question.get_by_role("textbox").fill("viewer")
    question.get_by_role("button", name=TEXTS["saveName"]).click()
    expect(question.get_by_role("status")).to_contain_text("the name of a role")
    question.get_by_role("textbox").fill("Ana")
    question.get_by_role("button", name=TEXTS["saveName"]).click()
    expect(question).to_have_count(0)
    ana.goto(service.link)  # the link again: the name is requested only once
    expect(ana.get_by_role("banner")).to_be_visible()
    ana.wait_for_load_state("networkidle")
    expect(question).to_have_count(0)
    ana.goto(f"{service.url}/#/studies")  # every page shows the list; live charts need a processor

    vic = browser.new_context(viewport=DESKTOP).new_page()
    vic.goto(f"{service.url}/#/studies")
    vic.get_by_role("textbox", name="Token").fill((service.data / "viewer-token").read_text().strip())
    vic.get_by_role("textbox", name="Your name").fill("Ana")
    vic.get_by_role("button", name="Sign in").click()
    expect(vic.get_by_role("img", name="Viewer")).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    expect(vic.get_by_role("form", name="Your name")).to_have_count(0)
    _take_control(ana)
    _expect_connected(vic, f"Ana {TEXTS['hasControl']}, 1 page", f"Ana (viewer), you {TEXTS['viewOnly']}, 1 page")
    _expect_connected(ana, "Ana, you has control, 1 page", f"Ana (viewer) {TEXTS['viewOnly']}, 1 page")

    (cookie,) = [one for one in ana.context.cookies() if one["name"].startswith(COOKIE)]
    ana.get_by_role("menuitem", name="Sign out").click()
    expect(ana.get_by_role("heading", name="Sign in to Sinew")).to_be_visible()
    carried = {"Cookie": f"{cookie['name']}={cookie['value']}"}
    assert httpx.get(f"{service.url}/api/state", headers=carried).status_code == 401
    assert httpx.post(f"{service.url}/api/stop", headers=carried).status_code == 401
    _expect_connected(vic, f"Ana (viewer), you {TEXTS['viewOnly']}, 1 page")
    # control was released, not lost: nothing stops
    assert vic.evaluate("fetch('./api/state').then(answer => answer.json()).then(state => state.holder)") is None
    ana.context.close()
    vic.context.close()


def _take_control(page: Page) -> None:
    page.get_by_role("button", name="Control: nobody").click()
    page.get_by_role("menuitem", name="Take control", exact=True).click()
    expect(page.get_by_role("button", name="Control: you")).to_be_visible()
    expect(page.get_by_role("group", name="Connected")).to_have_count(0)  # the menu is closed completely


def _expect_connected(page: Page, *listed: str, within_s: float = PATIENCE_S) -> None:
    people = page.get_by_role("group", name="Connected")
    if people.count() == 0:
        page.get_by_role("button", name="Control: ").click()
    lines = people.get_by_role("menuitem")
    words = [r"\s+".join(map(re.escape, f"{line}, since".split())) for line in listed]
    expect(lines).to_have_text([re.compile(f"^{one}") for one in words], use_inner_text=True, timeout=1000 * within_s)
    told = page.evaluate("fetch('./api/state').then(answer => answer.json()).then(state => state.people)")
    came = [datetime.fromisoformat(one["since"]).astimezone().strftime("%H:%M") for one in told]
    assert [line.rpartition("since ")[2] for line in lines.all_inner_texts()] == came


def test_a_suspended_page_is_removed_from_the_list_and_returns(browser: Browser, service: Service) -> None:
    with relayed(service) as (through, relay):
        ana, vic = (browser.new_context(viewport=DESKTOP).new_page() for _ in range(2))
        for page, url, token in ((ana, through.url, "token"), (vic, service.url, "viewer-token")):
            signing_in = {"token": (service.data / token).read_text().strip(), "name": "Ana" if page is ana else "Vic"}
            assert page.request.post(f"{url}/api/session", data=signing_in).ok
            page.goto(f"{url}/#/studies")
            expect(page.get_by_role("banner")).to_be_visible()
        _expect_connected(
            vic, f"Ana {TEXTS['canTakeControl']}, 1 page", f"Vic (viewer), you {TEXTS['viewOnly']}, 1 page"
        )
        relay.freeze()
        _expect_connected(vic, f"Vic (viewer), you {TEXTS['viewOnly']}, 1 page", within_s=PING_TIMEOUT_S + PATIENCE_S)
        relay.thaw()
        _expect_connected(
            vic, f"Ana {TEXTS['canTakeControl']}, 1 page", f"Vic (viewer), you {TEXTS['viewOnly']}, 1 page"
        )
        ana.context.close()
        vic.context.close()
