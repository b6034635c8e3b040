"""A browser without cookies shows a message; large cookies of other applications have no effect."""

import json
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, expect

from tests.e2e.browser import ARGUMENTS, DESKTOP, Watched, executable
from tests.e2e.operator import Operator
from tests.e2e.service import Service

BLOCKED = {"profile": {"default_content_setting_values": {"cookies": 2}}}
"""What Chromium keeps of a person who has blocked all cookies and data of sites."""


@pytest.fixture
def blocking(browser: Browser, tmp_path: Path) -> Iterator[BrowserContext]:
    profile = tmp_path / "profile" / "Default"
    profile.mkdir(parents=True)
    (profile / "Preferences").write_text(json.dumps(BLOCKED))
    context = browser.browser_type.launch_persistent_context(
        profile.parent, executable_path=executable(), args=list(ARGUMENTS), viewport=DESKTOP
    )
    with closing(context):
        yield context


def test_a_page_without_cookies_states_the_cause_and_the_remedy(blocking: BrowserContext, service: Service) -> None:
    watched = Watched(blocking.new_page())
    for address in (service.link, f"{service.url}/#/runs"):
        watched.page.goto(address)
        said = watched.page.get_by_role("alert")
        expect(said).to_contain_text("blocks cookies for 127.0.0.1")
        expect(said).to_contain_text("STOP does not work here")
    assert blocking.cookies() == []
    assert watched.complaints == []


def test_large_cookies_of_other_applications_do_not_prevent_the_sign_in(operator: Operator) -> None:
    operator.page.context.add_cookies(
        [{"name": f"other{number}", "value": "x" * 3000, "url": operator.service.url} for number in range(7)]
    )
    operator.sign_in()
    expect(operator.page.get_by_role("status", name="Link", exact=True)).to_have_attribute("data-health", "live")
    assert len(operator.page.context.cookies()) == 8
