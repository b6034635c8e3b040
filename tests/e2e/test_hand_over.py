"""Requests and offers of control with reasons: the pages agree with the service and its log."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from playwright.sync_api import Browser, Locator, Page, expect

from backend.auth.handover import GONE_S
from tests.e2e.browser import DESKTOP, Watched
from tests.e2e.layout import survey
from tests.e2e.operator import MOTION_TIMEOUT_MS
from tests.e2e.page_texts import load_texts
from tests.e2e.service import Service

SERVICE = load_texts("service")

TEXTS = load_texts("components")

MOVES = {
    "header": "header button",
    "main": "main button, main input, main a",
    "ways": "nav a",
}


@pytest.fixture(scope="module")
def service(fresh_service: Service) -> Service:
    return fresh_service


class ConnectedOperator:
    """An operator with a name, at a page of their own browser."""

    def __init__(self, browser: Browser, service: Service, name: str) -> None:
        self.name = name
        self.service = service
        self.watched = Watched(browser.new_context(viewport=DESKTOP).new_page())
        self.page = self.watched.page
        signing_in = {"token": (service.data / "token").read_text().strip(), "name": name}
        assert self.page.request.post(f"{service.url}/api/session", data=signing_in).ok
        self.page.goto(f"{service.url}/#/studies")  # every page shows the notices; live charts need a processor
        expect(self.page.get_by_role("banner")).to_be_visible()
        skip = self.page.get_by_role("button", name="Skip tour", exact=True)
        preferences = self.page.request.get(f"{service.url}/api/preferences").json()
        if not preferences["toured"]:
            skip.click()

    @property
    def notice(self) -> Locator:
        return self.page.get_by_role("region", name=TEXTS["controlRequest"])

    def menu(self, item: str) -> None:
        """Choose an item of the control menu."""
        self.page.get_by_role("button", name="Control: ").click()
        self.page.get_by_role("menuitem", name=re.compile(f"^{re.escape(item)}")).click()
        expect(self.page.get_by_role("menu")).to_have_count(0)

    def press(self, button: str) -> None:
        self.page.get_by_role("button", name=button, exact=True).click()

    def give(self, reason: str) -> None:
        self.page.get_by_role("dialog").get_by_role("textbox").fill(reason)

    def expect_control(self, whose: str) -> None:
        expect(self.page.get_by_role("button", name=f"Control: {whose}", exact=True)).to_be_visible()

    def get_json(self, path: str) -> Any:
        answer = self.page.request.get(f"{self.service.url}{path}")
        assert answer.ok, answer.text()
        return answer.json()

    @property
    def holder(self) -> str | None:
        holder = self.get_json("/api/state")["holder"]
        return None if holder is None else str(holder["name"])

    def log(self, count: int) -> list[tuple[str, str]]:
        """Return the newest entries of the log, oldest first: person and text."""
        entries = self.get_json(f"/api/log?kind=note&limit={count}")["entries"]
        return [(one["who"], one["text"]) for one in reversed(entries)]


@contextmanager
def people(browser: Browser, service: Service, *names: str) -> Iterator[list[ConnectedOperator]]:
    there = [ConnectedOperator(browser, service, name) for name in names]
    try:
        yield there
        assert [one.watched.complaints for one in there] == [[] for _ in there]
    finally:
        for one in there:
            if one.holder == one.name:
                one.menu(TEXTS["giveUpControl"])
                one.expect_control("nobody")
            one.page.context.close()


def positions(page: Page) -> dict[str, Any]:
    return {name: [str(one) for one in boxes] for name, boxes in survey(page, MOVES).items()}


def test_requests_for_control_are_declined_or_granted_and_logged(browser: Browser, service: Service) -> None:
    with people(browser, service, "Ana", "Vera") as (ana, vera):
        ana.menu(TEXTS["takeControl"])
        ana.expect_control("you")
        vera.expect_control("Ana")
        before = positions(ana.page)

        vera.menu(TEXTS["askItem"].replace("{name}", "Ana"))
        vera.give("my λ sweep")
        vera.press(TEXTS["ask"])
        expect(ana.notice).to_contain_text("Vera asks for control: “my λ sweep”")
        expect(vera.notice).to_contain_text(SERVICE["asked"].replace("{name}", "Ana"))
        assert positions(ana.page) == before  # the layout has not moved
        (wish,) = ana.get_json("/api/state")["wishes"]
        assert (wish["name"], wish["by"], wish["reason"], wish["standing"]) == ("Vera", "Ana", "my λ sweep", "asked")

        ana.press(TEXTS["answer"])
        expect(ana.page.get_by_role("button", name=TEXTS["keepControl"])).to_be_disabled()  # a reason is required
        ana.give("ten minutes more")
        ana.press(TEXTS["keepControl"])
        expect(vera.notice).to_contain_text("Ana keeps control: “ten minutes more”")
        expect(ana.notice).to_have_count(0)
        assert ana.holder == "Ana"
        vera.press("OK")
        expect(vera.notice).to_have_count(0)

        vera.menu(TEXTS["askItem"].replace("{name}", "Ana"))
        vera.give("now it is my turn")
        vera.press(TEXTS["ask"])
        ana.press(TEXTS["answer"])
        ana.give("mind the wall")
        ana.press(TEXTS["handOver"])
        vera.expect_control("you")  # without a further question
        ana.expect_control("Vera")
        expect(vera.notice).to_contain_text("Ana has handed control over to you: “mind the wall”")
        expect(ana.notice).to_contain_text("You have handed control over to Vera.")
        expect(ana.page.get_by_role("alert", name=TEXTS["controlLost"])).to_have_count(0)
        assert vera.holder == "Vera"
        log = vera.log(6)
        assert log == [
            ("Ana", "control taken"),
            ("Vera", "asked Ana for control: my λ sweep"),
            ("Ana", "declined the request of Vera for control: ten minutes more"),
            ("Vera", "asked Ana for control: now it is my turn"),
            ("Ana", "handed control over to Vera: mind the wall"),
            ("Vera", "control handed over by Ana: now it is my turn"),
        ]
        ana.page.get_by_role("navigation", name="Main").get_by_role("link", name="Log").click()
        for who, text in log:
            expect(ana.page.get_by_role("row").filter(has_text=text).filter(has_text=who).first).to_be_visible()

        # after the handover, Ana may only send STOP
        assert ana.page.request.delete(f"{service.url}/api/control").status == 409
        ana.press("STOP")
        expect(ana.page.get_by_role("status", name=TEXTS["stopResult"])).to_contain_text("Zero volts in")
        vera.page.get_by_role("navigation", name="Main").get_by_role("link", name="Operate").click()
        vera.press("Reset")
        expect(vera.page.get_by_role("status", name="Mode", exact=True)).to_have_text("off", timeout=MOTION_TIMEOUT_MS)


def test_an_offer_of_control_is_accepted_or_declined(browser: Browser, service: Service) -> None:
    with people(browser, service, "Ana", "Vera") as (ana, vera):
        ana.menu(TEXTS["takeControl"])
        for reason in ("lunch", "lunch, really"):
            ana.menu(TEXTS["handOverItem"])
            choice = ana.page.get_by_role("combobox", name="To")
            assert choice.locator("option").all_inner_texts() == ["Vera"]
            ana.give(reason)
            ana.press(TEXTS["offerControl"])
            expect(vera.notice).to_contain_text(f"Ana offers you control: “{reason}”")
            expect(ana.notice).to_contain_text(SERVICE["offerSent"].replace("{name}", "Vera"))
            assert ana.holder == "Ana"
            if reason == "lunch":
                vera.press(TEXTS["decline"])
                expect(ana.notice).to_contain_text("Vera did not take control.")
                assert ana.holder == "Ana"
        vera.press("Take control")
        vera.expect_control("you")
        assert vera.holder == "Vera"
        assert vera.log(4) == [
            ("Ana", "offered control to Vera: lunch"),
            ("Vera", "declined the control offered by Ana"),
            ("Ana", "offered control to Vera: lunch, really"),
            ("Vera", "control handed over by Ana: lunch, really"),
        ]


def test_a_request_ends_when_its_page_closes_or_control_is_released(browser: Browser, service: Service) -> None:
    with people(browser, service, "Ana", "Vera", "Oda") as (ana, vera, oda):
        ana.menu(TEXTS["takeControl"])
        for one in (vera, oda):
            one.menu(TEXTS["askItem"].replace("{name}", "Ana"))
            one.give(f"I am {one.name}")
            one.press(TEXTS["ask"])
            expect(one.notice).to_contain_text(SERVICE["asked"].replace("{name}", "Ana"))
        expect(ana.notice).to_contain_text(re.compile(r"asks for control.*\+1"))
        oda.page.goto("about:blank")
        expect(ana.notice).to_contain_text("Vera asks for control: “I am Vera”")
        expect(ana.notice).not_to_contain_text("+1", timeout=MOTION_TIMEOUT_MS + GONE_S * 1000)
        # requests of earlier tests are listed for a while
        standings = {one["reason"]: one["standing"] for one in ana.get_json("/api/state")["wishes"]}
        assert standings.items() >= {"I am Vera": "asked", "I am Oda": "left"}.items()
        ana.menu(TEXTS["giveUpControl"])
        expect(vera.notice).to_contain_text(SERVICE["freed"].replace("{name}", "Ana"))
        assert vera.holder is None
        oda.page.goto(f"{service.url}/#/studies")
        expect(oda.page.get_by_role("banner")).to_be_visible()
