"""Shared state for the tests of a file: one open page, and a joint in mode Run.

The page Operate draws the live stream, which needs most of a processor. Tests of other pages therefore sign in there,
and a script operates the joint.
"""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from playwright.sync_api import Browser, Page, expect

from tests.api.conftest import client_with, until_state
from tests.e2e.browser import DESKTOP, Watched
from tests.e2e.conftest import attended
from tests.e2e.operator import Operator
from tests.e2e.service import Service


class SharedPage:
    """An operator with a page that all tests of a file use."""

    def __init__(self, browser: Browser, service: Service, address: str) -> None:
        context = browser.new_context(viewport=DESKTOP, accept_downloads=True)
        self._watched = Watched(context.new_page())
        self._service = service
        sign_in_at(self._watched.page, service, address)

    @contextmanager
    def turn_of(self, request: pytest.FixtureRequest) -> Iterator[Operator]:
        """Yield the page to one test; fail the test if the console reports errors.

        Overlays are closed and an edited box loses the focus before the test. Control is released after it, so that a
        script can move the joint for the next test.
        """
        with attended(self._watched, self._service, request) as watched:
            watched.page.keyboard.press("Escape")
            watched.page.evaluate("document.activeElement?.blur()")
            yield Operator(watched.page, self._service)
            give_up_control(watched.page)

    def close(self) -> None:
        self._watched.page.context.close()
        assert self._watched.complaints == []


@contextmanager
def shared_page(browser: Browser, service: Service, address: str) -> Iterator[SharedPage]:
    """Sign in at an address; close the page after the tests of the file."""
    shared = SharedPage(browser, service, address)
    yield shared
    shared.close()


def give_up_control(page: Page) -> None:
    """Release control if this page has it."""
    mine = page.get_by_role("button", name="Control: you", exact=True)
    if mine.count() == 0:
        return
    page.keyboard.press("Escape")
    mine.click()
    page.get_by_role("menuitem", name="Give up control").click()
    expect(mine).to_have_count(0)


def sign_in_at(page: Page, service: Service, address: str, name: str = "") -> None:
    """Sign in and open a page by the part of its address after #/; without a name, the role serves as the name."""
    page.add_init_script("if (location.origin !== 'null') localStorage.setItem('sinew-goes-by-role', '')")
    token = (service.data / "token").read_text(encoding="utf-8").strip()
    assert page.request.post(f"{service.url}/api/session", data={"token": token, "name": name}).ok
    page.goto(f"{service.url}/#/{address}")
    expect(page.get_by_role("banner")).to_be_visible()


def bring_to_run(service: Service, q_ref: float = 0.0) -> None:
    """Change to mode Run and move the joint towards an angle [rad], from any earlier state; control is free."""
    with client_with(service, "token") as script:
        state = until_state(
            script, lambda told: told["holder"] is None and told["mode"] != "stopping", "a page before holds control"
        )
        if state["mode"] == "tripped":
            script.post("/api/reset").raise_for_status()
        if state["mode"] != "run":
            if not state["pretension_done"]:
                script.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
                until_state(script, lambda told: bool(told["pretension_done"]), "pretension is never held")
            script.post("/api/mode", json={"mode": "run"}).raise_for_status()
            until_state(script, lambda told: told["mode"] == "run", "it does not come to run")
        script.put("/api/references", json={"q_ref": q_ref, "S_ref": 10.0}).raise_for_status()
        script.delete("/api/control").raise_for_status()
