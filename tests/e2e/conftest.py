"""Fixtures of the browser tests: one service per module, one fresh page per test, screenshots of what failed."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from tests.e2e.browser import DESKTOP, Watched, chromium
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.service import Service, running_service

FAILURES = Path(__file__).parents[2] / ".cache" / "e2e"
expect.set_options(timeout=MOTION_TIMEOUT_MS)
"""Playwright's own patience of 5 s is that of a machine with nothing else to do."""

REPORT = pytest.StashKey[pytest.TestReport]()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Iterator[None]:
    report = yield
    if report.when == "call":
        item.stash[REPORT] = report
    return report


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    # Playwright's synchronous interface keeps an event loop running: it ends with the module, so that other tests of
    # this process can run their own.
    with chromium() as running:
        yield running


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("data")) as running:
        yield running


@pytest.fixture
def operator(browser: Browser, service: Service, request: pytest.FixtureRequest) -> Iterator[Operator]:
    """A person at a page of their own; the test fails when the page's console complained."""
    context = browser.new_context(viewport=DESKTOP, accept_downloads=True)
    watched = Watched(context.new_page())
    yield Operator(watched.page, service)
    report = request.node.stash.get(REPORT, None)
    if watched.complaints or (report is not None and report.failed):
        FAILURES.mkdir(parents=True, exist_ok=True)
        picture = FAILURES / f"{request.node.name}.png"
        watched.page.screenshot(path=picture)
        print(f"what the page showed: {picture}\nwhat the service said:\n{service.log.read_text(encoding='utf-8')}")
    context.close()
    assert watched.complaints == []
