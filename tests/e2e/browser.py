"""Start Chromium, and record the errors of a page."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from playwright.sync_api import Browser, ConsoleMessage, Error, Page, Response, ViewportSize, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# Pages are put together by the processor, as Chromium does it by itself where there is no graphics card; only WebGL
# gets the slow substitute.
# Chromium's own address bar loads two pages for what it would suggest, beside each window: a second of a core. The last
# list said counts, so Playwright's own stands in it too.
UNUSED = (
    "WebUIOmniboxPopup,WebUIOmniboxAimPopup,AvoidUnnecessaryBeforeUnloadCheckSync,DestroyProfileOnBrowserClose,"
    "HttpsUpgrades,HttpsFirstBalancedModeAutoEnable,LensOverlay,MediaRouter,PaintHolding,ThirdPartyStoragePartitioning,"
    "AvoidCorsURLLoaderRestartOnRedirect,TcpPortRandomizationWin,OptimizationHints,NetworkTimeServiceQuerying,AimEnabled,"
    "PreconnectToSearch"
)
ARGUMENTS = (
    f"--disable-features={UNUSED}",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--disable-gpu-compositing",
    "--disable-accelerated-2d-canvas",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
# viser's client compiles a sorter for point clouds, of which the scene has none; the scene's policy forbids it.
EXPECTED = "Evaluating a string as JavaScript violates"
DESKTOP = ViewportSize(width=1440, height=900)
TABLET = ViewportSize(width=1024, height=768)


@contextmanager
def chromium() -> Iterator[Browser]:
    """Start the browser on the path, or the one that Playwright installed."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable(), args=list(ARGUMENTS))
        try:
            yield browser
        finally:
            browser.close()


def executable() -> str | None:
    """Return the path of the browser; None selects the one that Playwright installed."""
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@dataclass
class Watched:
    """A page and the messages that its console reported."""

    page: Page
    complaints: list[str] = field(default_factory=list)
    refused: list[Response] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.page.on("response", self._answered)
        self.page.on("console", self._console)
        self.page.on("pageerror", self._error)

    def refusals(self) -> str:
        """Return the messages of refused requests, for the report of a failed test."""
        return "\n".join(f"{one.request.method} {one.url}: {_body(one)}" for one in self.refused) or "nothing"

    def _answered(self, response: Response) -> None:
        if response.status >= 400:
            self.refused.append(response)

    def _console(self, message: ConsoleMessage) -> None:
        if message.type == "error":
            self._note(f"{message.text} ({message.location.get('url', '')})")

    def _error(self, error: Error) -> None:
        self._note(str(error))

    def _note(self, complaint: str) -> None:
        if not complaint.startswith(EXPECTED):
            self.complaints.append(complaint)


def _body(response: Response) -> str:
    try:
        return response.text()
    except Error as error:  # the page has gone on meanwhile, and its answers with it
        return f"{response.status}, its words are gone ({error.message.splitlines()[0]})"
