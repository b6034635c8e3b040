"""Two tabs of one browser, a reload, an ended session: which page has control, and STOP on each."""

from typing import Any

import pytest
from fastapi import Response
from playwright.sync_api import Browser, Page, expect
from starlette.requests import HTTPConnection

from backend.auth.authentication import Authentication
from backend.auth.sessions import TokenFiles
from backend.server.security import read_credentials, set_session_cookie
from tests.e2e.browser import DESKTOP
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

SHARED = load_texts("components")

SERVICE = load_texts("service")


def holder(page: Page) -> str:
    shown = page.get_by_role("button", name="Control: ").get_attribute("aria-label", timeout=MOTION_TIMEOUT_MS)
    return str(shown).removeprefix("Control: ")


def test_a_duplicated_tab_has_no_control_and_a_reload_retains_it(operator: Operator) -> None:
    page = operator.page
    operator.sign_in()
    operator.go("Log")  # a page without live charts
    operator.take_control()
    page.get_by_role("button", name="STOP", exact=True).click()
    operator.expect_mode("tripped")
    with page.expect_popup() as opened:
        page.evaluate("window.open(location.href)")
    copy = Operator(opened.value, operator.service)
    copy.expect_mode("tripped")
    assert copy.page.evaluate("sessionStorage.length") == 0
    operator.take_control()  # opening the copy may block the page so long that it loses control
    expect(copy.page.get_by_role("button", name="Control: operator")).to_be_visible()
    expect(copy.page.get_by_role("button", name="Reset", exact=True)).to_be_disabled()
    expect(copy.page.get_by_role("button", name="Take control", exact=True)).to_be_visible()
    assert holder(page) == "you"

    operator.wait(lambda: goes_on_after_a_reload(operator))
    expect(page.get_by_role("button", name="Control: you")).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    operator.press("Reset")
    operator.expect_mode("off")

    copy.take_control()
    expect(page.get_by_role("button", name="Control: operator")).to_be_visible()
    lost = page.get_by_role("alert", name=SHARED["controlLost"])
    expect(lost).to_contain_text(SERVICE["lossTakenOver"].replace("{name}", "operator"))
    copy.page.close()
    lost.get_by_role("button", name="Take control").click()
    expect(page.get_by_role("button", name="Control: you")).to_be_visible()
    expect(lost).to_have_count(0)


def goes_on_after_a_reload(operator: Operator) -> bool:
    """Reload a page with control; on a busy machine it may lose control by the delay."""
    operator.take_control()
    before = operator.state()["holder"]["epoch"]
    operator.page.reload()
    after: dict[str, Any] | None = None

    def is_decided() -> bool:
        nonlocal after
        after = operator.state()["holder"]
        return after is None or after["epoch"] != before

    operator.wait(is_decided)
    return after is not None


def lapsed_cookie(service: Service) -> tuple[str, str]:
    """Return a cookie with a valid signature for an unknown session."""
    asks = HTTPConnection({"type": "http", "headers": [(b"host", service.url.removeprefix("http://").encode())]})
    files = TokenFiles(service.data)
    authentication, answer = Authentication(files), Response()
    set_session_cookie(
        authentication, asks, answer, authentication.sign_in(read_credentials(asks), files.tokens.operator, "Ana")
    )
    name, _, value = answer.headers["set-cookie"].partition(";")[0].partition("=")
    return name, value


@pytest.mark.parametrize("lapsed", [True, False])
def test_a_signed_out_page_shows_stop(browser: Browser, service: Service, lapsed: bool) -> None:
    context = browser.new_context(viewport=DESKTOP)
    if lapsed:
        name, value = lapsed_cookie(service)
        context.add_cookies([{"name": name, "value": value, "url": service.url}])
    page = context.new_page()
    page.goto(service.url)
    expect(page.get_by_role("heading", name="Sign in to Sinew")).to_be_visible()
    page.get_by_role("button", name="STOP", exact=True).click()
    said = page.get_by_role("alert", name="STOP", exact=True)
    expect(said).to_contain_text(
        "Zero volts in"
        if lapsed
        else "STOP NOT CONFIRMED: use the stop at the machine. nothing was stopped, because you are not signed in"
    )
    context.close()


def test_an_ended_session_is_reported_and_the_page_resumes_after_sign_in(browser: Browser, service: Service) -> None:
    context = browser.new_context(viewport=DESKTOP)
    page = context.new_page()
    page.goto(service.link)
    expect(page.get_by_role("banner")).to_be_visible()
    page.evaluate("fetch('./api/session', {method: 'DELETE'})")
    expect(page.get_by_role("heading", name="Sign in to Sinew")).to_be_visible(timeout=MOTION_TIMEOUT_MS)
    page.get_by_role("textbox", name="Token").fill((service.data / "token").read_text().strip())
    page.get_by_role("button", name="Sign in").click()
    expect(page.get_by_role("banner")).to_be_visible()
    context.close()
