"""Notifications: a hidden page notifies once of each event, with the text of the service."""

from collections.abc import Iterator
from contextlib import closing
from functools import partial

import httpx
import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from tests.api.conftest import client_with, until, until_state
from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS, kept
from tests.e2e.service import Service
from tests.e2e.sharing import bring_to_run, sign_in_at

SPY = """
window.told = [];
window.asked = 0;
window.Notification = class {
  static permission = 'default';
  static async requestPermission() {
    window.asked += 1;
    this.permission = 'granted';
    return this.permission;
  }
  constructor(title, options) {
    this.title = title;
    this.options = options;
    window.told.push(this);
  }
  close() {}
};
window.lookedAt = true;
Object.defineProperty(document, 'visibilityState', {get: () => window.lookedAt ? 'visible' : 'hidden'});
"""
SHORT = '[{"duration_s": 0.5, "q_ref": 0.1, "S_ref": 10}]'
DELIVERY_MS = 1500
"""Longer than a tab takes to hear of what another one has heard of."""
LOOK = "looked => { window.lookedAt = looked; document.dispatchEvent(new Event('visibilitychange')); }"
ASKED = "path => performance.getEntriesByType('resource').some(({name}) => name.endsWith(path))"
TOLD = "window.told.map(({title, options}) => [title, options.body, options.tag])"


@pytest.fixture
def tabs(browser: Browser, service: Service) -> Iterator[tuple[Page, Page, Service]]:
    """Two tabs of one person, in a browser that records notifications."""
    with closing(browser.new_context(viewport=DESKTOP)) as context:
        yield opened(context, service), opened(context, service), service


def opened(context: BrowserContext, service: Service) -> Page:
    page = context.new_page()
    page.add_init_script(SPY)
    sign_in_at(page, service, "studies")
    expect(page.get_by_role("status", name="Mode", exact=True)).not_to_have_text("unknown")
    return page


def choose(page: Page, name: str, preference: str) -> None:
    page.get_by_role("button", name="Notifications", exact=True).click()
    with page.expect_response(kept(preference, True)):
        page.get_by_role("menuitemcheckbox", name=name, exact=True).click()
    page.keyboard.press("Escape")


def notifications_of(*pages: Page) -> list[list[str]]:
    return sorted(one for page in pages for one in page.evaluate(TOLD))


def test_a_hidden_page_notifies_once_of_each_run_and_trip_and_links_to_it(
    tabs: tuple[Page, Page, Service],
) -> None:
    page, other, service = tabs
    assert page.evaluate("window.asked") == 0
    choose(page, "Notifications", "notify")
    assert page.evaluate("window.asked") == 1
    other.reload()  # the choice applies to all tabs of a person
    other.evaluate("Notification.permission = 'granted'")
    expect(other.get_by_role("status", name="Mode", exact=True)).not_to_have_text("unknown")

    with client_with(service, "token") as script:
        script.delete("/api/control")
        first = played(script, page, other)
        assert notifications_of(page, other) == []  # both tabs are visible

        page.evaluate(LOOK, False)
        second = played(script, page, other)
        page.wait_for_timeout(DELIVERY_MS)
        assert notifications_of(page, other) == []  # the other tab is visible

        other.evaluate(LOOK, False)
        third = played(script, page, other)
        wait_for_notifications(page, other, count=1)
        run = script.get(f"/api/runs/{third}").json()
        assert first < second < third == run["id"]
        assert run["end_state"] == "completed"
        words = run["kind"].replace("_", " ").capitalize()
        assert notifications_of(page, other) == [
            [f"{words}, run {third}: completed", run["title"], f"sinew-run-{third}"],
        ]

        bring_to_run(service, 0.1)
        script.post("/api/stop").raise_for_status()
        wait_for_notifications(page, other, count=2)
        page.wait_for_timeout(DELIVERY_MS)
        fault = script.get("/api/state").json()["fault"]
        starts = script.get("/api/state").json()["link"]["starts"]
        assert [one for one in notifications_of(page, other) if one[2].startswith("sinew-trip")] == [
            ["Stopped", f"{fault['message']} {fault['remedy']}", f"sinew-trip-{starts}-{fault['tick']}"],
        ]
        assert fault["code"] == "stop_pressed"
        script.post("/api/reset").raise_for_status()

        bring_to_run(service)
        script.post("/api/faults/injection", json={"kind": "no_number", "sensor": "q"}).raise_for_status()
        wait_for_notifications(page, other, count=3)
        tripped = script.get("/api/state").json()["fault"]
        cause = tripped["code"].replace("_", " ")
        assert tripped["code"] == "sensor_invalid"
        [told_of] = [one for one in notifications_of(page, other) if one[2] == f"sinew-trip-{starts}-{tripped['tick']}"]
        assert told_of[:2] == [f"Tripped: {cause}", f"{tripped['message']} {tripped['remedy']}"]
        script.delete("/api/faults/injection").raise_for_status()
        script.post("/api/reset").raise_for_status()

        click_notification(page, other, f"sinew-run-{third}", f"/#/runs/{third}")
        at_trip = click_notification(page, other, f"sinew-trip-{starts}-{fault['tick']}", "/#/flights/")
        [flight] = [one for one in script.get("/api/flights").json()["flights"] if one["tick"] == fault["tick"]]
        assert at_trip.url.endswith(f"/#/flights/{flight['id']}")


def played(script: httpx.Client, *pages: Page) -> int:
    """Run a short program until every page has received its end; return the number of its run."""
    order = {"name": "sequence", "settings": {"segments": SHORT}}
    run = int(script.post("/api/experiments", json=order).raise_for_status().json()["id"])
    until_state(script, lambda notifications_of: notifications_of["task"] is None, f"run {run} does not end")
    for page in pages:
        until(partial(page.evaluate, ASKED, f"/api/runs/{run}"))
    return run


def wait_for_notifications(*pages: Page, count: int) -> None:
    until(lambda: len(notifications_of(*pages)) >= count)


def click_notification(page: Page, other: Page, tag: str, to: str) -> Page:
    """Click the notification in its tab; return that tab."""
    click = "tag => window.told.filter(({options}) => options.tag === tag).map(one => one.onclick()).length"
    [found] = [one for one in (page, other) if one.evaluate(click, tag)]
    found.wait_for_url(f"**{to}*", timeout=MOTION_TIMEOUT_MS)
    return found
