"""Actions of an operator on the page, by the accessible names of the controls."""

import math
import re
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from playwright.sync_api import Locator, Page, Response, expect

from tests.e2e.forms import REPORT_TIMEOUT_MS
from tests.e2e.service import Service

MOTION_TIMEOUT_MS = 120_000
"""Long enough for anything the loop does by itself, also on a machine that is busy with other things."""

LOOK_MS = 50


def kept(name: str, value: object) -> Callable[[Response], bool]:
    """Match the response to the request that stores this preference; earlier requests are in their own queue."""

    def is_it(answer: Response) -> bool:
        asked = answer.request
        if asked.method != "PUT" or not asked.url.endswith("/api/preferences"):
            return False
        assert asked.post_data_json is not None
        return bool(asked.post_data_json[name] == value)

    return is_it


class Operator:
    """One person with one page of one service."""

    def __init__(self, page: Page, service: Service) -> None:
        self.page = page
        self.page.set_default_timeout(MOTION_TIMEOUT_MS)  # buttons and downloads may respond slowly
        self.service = service

    def sign_in(self) -> None:
        """Open the sign-in link in a browser that has stored the choice to sign in without a name."""
        self.page.add_init_script("if (location.origin !== 'null') localStorage.setItem('sinew-goes-by-role', '')")
        self.page.goto(self.service.link)
        expect(self.page.get_by_role("banner")).to_be_visible()

    def go(self, name: str) -> None:
        """Open a page by its link in the navigation."""
        self.page.get_by_role("navigation", name="Main").get_by_role("link", name=name, exact=True).click()
        expect(self.page.get_by_role("heading", level=1, name=name)).to_be_attached()

    def press(self, name: str) -> None:
        """Press a button that is enabled."""
        button = self.page.get_by_role("button", name=name, exact=True)
        expect(button).not_to_have_attribute("aria-disabled", "true", timeout=MOTION_TIMEOUT_MS)
        button.click()

    def bring_up(self) -> None:
        """Establish the pretension, if needed, and change to mode Run."""
        self.go("Operate")
        if self.settled_mode() != "pretension":
            self.press("Pretension")
        self.press("Run")
        self.expect_mode("run")

    def be_in_run(self) -> None:
        """Change to mode Run from any state that the previous test left."""
        self.go("Operate")
        self.settled_mode()
        self.take_control()
        self.wait_for_samples(100)  # a soft stop for want of the page before this one may just have begun
        mode = self.settled_mode()
        if mode == "tripped":
            self.press("Reset")
            self.expect_mode("off")
        if mode != "run":
            self.bring_up()
        self.wait(lambda: not math.isnan(self.reading("Joint position", "q_ref")))

    def settled_mode(self) -> str:
        """Return the mode once page and service agree and no stop is in progress."""
        shown, told = self.page.get_by_role("status", name="Mode", exact=True), ""

        def is_settled() -> bool:
            nonlocal told
            told = str(self.state()["mode"])
            return shown.inner_text() == told != "stopping"

        self.wait(is_settled)
        return told

    def take_control(self) -> None:
        """Take control, also from a closed page that the service has not yet detected as lost."""
        whose = self.page.get_by_role("button", name=re.compile("^Control: "))
        take = self.page.get_by_role("menuitem", name=re.compile("^Take "))

        def is_mine() -> bool:
            return whose.get_attribute("aria-label") == "Control: you"

        if is_mine():
            return
        whose.click()
        # looked for and pressed at one moment: a page that was loaded again may be given its control back meanwhile
        self.wait(lambda: is_mine() or take.evaluate_all("found => found.map(one => one.click()).length") > 0)
        expect(whose).to_have_attribute("aria-label", "Control: you")
        self.page.keyboard.press("Escape")
        expect(self.page.get_by_role("menu")).to_have_count(0)

    def expect_mode(self, mode: str, timeout_ms: int = MOTION_TIMEOUT_MS) -> None:
        """Wait for the mode in the header."""
        expect(self.page.get_by_role("status", name="Mode", exact=True)).to_have_text(mode, timeout=timeout_ms)

    def fill(self, label: str, value: float) -> None:
        self.page.get_by_role("textbox", name=label, exact=True).fill(f"{value:g}")

    def enter(self, label: str, value: float) -> None:
        """Type a value into a number box and send it."""
        self.fill(label, value)
        self.page.get_by_role("textbox", name=label, exact=True).press("Enter")

    def wait(self, condition: Callable[[], bool], timeout_ms: int = MOTION_TIMEOUT_MS) -> None:
        """Check every few frames until the condition holds; more frequent checks load page, service and processor."""
        deadline = time.monotonic() + timeout_ms / 1000
        while not condition():
            assert time.monotonic() < deadline, "what was waited for did not happen"
            self.page.wait_for_timeout(LOOK_MS)

    def wait_for_samples(self, count: int) -> int:
        """Wait until the loop has written ``count`` more samples; return their number."""
        first = self._tick()
        self.wait(lambda: self._tick() - first >= count)
        return self._tick() - first

    def _tick(self) -> int:
        return int(self.state()["tick"])

    def state(self) -> dict[str, Any]:
        """Return the response to ``GET /api/state``."""
        found: dict[str, Any] = self.page.evaluate("fetch('./api/state').then(answer => answer.json())")
        return found

    def legend(self, figure: str, signal: str) -> Locator:
        """Return the button of a signal in the legend of a chart."""
        return self.page.get_by_role("figure", name=figure, exact=True).get_by_role("button", name=signal, exact=True)

    def reading(self, figure: str, signal: str) -> float:
        """Return the value of a signal in the legend of a chart; the middle of an envelope; NaN without a value."""
        chart = self.page.get_by_role("figure", name=figure, exact=True)
        shown = chart.locator(f"[data-role=value-{signal}]").inner_text().replace("\u2212", "-").removeprefix("≈ ")
        return math.nan if shown == "\u2013" else float(shown)

    def picture(self, figure: str) -> bytes:
        """Return a screenshot of a chart."""
        return self.page.get_by_role("figure", name=figure, exact=True).locator("canvas").first.screenshot()

    def download(self, link: str) -> Path:
        """Download the target of a link and return its path."""
        with self.page.expect_download(timeout=REPORT_TIMEOUT_MS) as download:
            self.page.get_by_role("link", name=link, exact=True).click()
        return download.value.path()
