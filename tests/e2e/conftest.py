"""Fixtures of the browser tests: one browser, one service, a new page per test, screenshots of failures."""

import sqlite3
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack, closing, contextmanager
from functools import partial
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from backend.schemas.preferences import DEFAULT_PREFERENCES
from tests.api.conftest import client_with, until
from tests.e2e.browser import DESKTOP, Watched, chromium
from tests.e2e.operator import MOTION_TIMEOUT_MS, Operator
from tests.e2e.service import Service, running_service

LAST_EVENTS = "SELECT at, kind, who, text FROM event ORDER BY id DESC LIMIT 30"
FOLDER = Path(__file__).parent
FAILURES = Path(__file__).parents[2] / ".cache" / "e2e"
expect.set_options(timeout=MOTION_TIMEOUT_MS)
"""Playwright's own patience of 5 s is that of a machine with nothing else to do."""

WITNESS = pytest.StashKey[Callable[[], str]]()
"""What tells of a page, while it is there, what a reader of a test that failed asks for."""


CLOSED_EARLY = pytest.StashKey[ExitStack]()
"""The shared service, as long as it is up."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order tests with the shared service first, so that other services do not run at the same time."""
    places = [place for place, item in enumerate(items) if item.path.is_relative_to(FOLDER)]
    ours = sorted((items[place] for place in places), key=lambda item: not _shares(item))
    for place, item in zip(places, ours, strict=True):
        items[place] = item


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> None:
    if _shares(item) and nextitem is not None and not _shares(nextitem) and CLOSED_EARLY in item.session.stash:
        item.session.stash[CLOSED_EARLY].close()


def _shares(item: pytest.Item) -> bool:
    return "shared_service" in getattr(item, "fixturenames", ())


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.failed and (witness := item.stash.get(WITNESS, None)):  # also after a timeout in a fixture
        report.sections.append(("page and service", witness()))
    return report


@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    # Playwright's synchronous interface keeps an event loop running: it ends with this folder, so that other tests of
    # this process can run their own.
    with chromium() as running:
        yield running


@pytest.fixture(scope="package")
def shared_service(tmp_path_factory: pytest.TempPathFactory, request: pytest.FixtureRequest) -> Iterator[Service]:
    with ExitStack() as up:
        running = up.enter_context(running_service(tmp_path_factory.mktemp("shared")))
        request.session.stash[CLOSED_EARLY] = up
        yield running


@pytest.fixture(scope="module")
def service(shared_service: Service) -> Service:
    """The service that the modules of this folder share, but for recordings as it is when it has started.

    One of its own is for those that count on an empty data folder, and for those with another plant.
    """
    with client_with(shared_service, "token") as script:
        until(lambda: script.get("/api/state").raise_for_status().json()["holder"] is None)  # earlier pages are closed
        script.post("/api/stop").raise_for_status()
        script.post("/api/reset").raise_for_status()
        script.put("/api/preferences", json=DEFAULT_PREFERENCES.model_dump()).raise_for_status()
        script.delete("/api/control").raise_for_status()
    return shared_service


@pytest.fixture(scope="module")
def fresh_service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    with running_service(tmp_path_factory.mktemp("data")) as running:
        yield running


@pytest.fixture
def operator(browser: Browser, service: Service, request: pytest.FixtureRequest) -> Iterator[Operator]:
    """An operator at a new page; the test fails if the console reports errors."""
    with (
        closing(browser.new_context(viewport=DESKTOP, accept_downloads=True)) as context,
        attended(Watched(context.new_page()), service, request) as watched,
    ):
        yield Operator(watched.page, service)


@pytest.fixture(scope="module")
def page_of_module(browser: Browser, service: Service) -> Iterator[Watched]:
    with closing(browser.new_context(viewport=DESKTOP, accept_downloads=True)) as context:
        watched = Watched(context.new_page())
        Operator(watched.page, service).sign_in()
        yield watched


@pytest.fixture
def same_operator(page_of_module: Watched, service: Service, request: pytest.FixtureRequest) -> Iterator[Operator]:
    """The operator and page of the previous test; loading a new page takes seconds of processor time."""
    with attended(page_of_module, service, request) as watched:
        yield Operator(watched.page, service)


@contextmanager
def attended(watched: Watched, service: Service, request: pytest.FixtureRequest) -> Iterator[Watched]:
    """Report the page when the test fails, and fail the test if the console reported errors."""
    request.node.stash[WITNESS] = partial(witnessed, watched, service, FAILURES / f"{request.node.name}.png")
    yield watched
    complaints, watched.complaints = watched.complaints, []  # the next test on the page must not report them
    seen = request.node.stash[WITNESS]() if complaints else ""
    del request.node.stash[WITNESS]
    assert complaints == [], seen


def witnessed(watched: Watched, service: Service, picture: Path) -> str:
    """Report the state of page and service, and store a screenshot if the page is open."""
    picture.parent.mkdir(parents=True, exist_ok=True)
    if not watched.page.is_closed():
        watched.page.screenshot(path=picture)
    with closing(sqlite3.connect(f"file:{service.data / 'sinew.db'}?mode=ro", uri=True)) as database:
        events = ["  ".join(row) for row in database.execute(LAST_EVENTS)]
    told = {
        "the page was refused": watched.refusals(),
        "the service said": service.log.read_text(encoding="utf-8"),
        "its journal, newest first": "\n".join(events),
    }
    return "\n".join([f"what the page showed: {picture}", *(f"{what}:\n{told[what]}" for what in told)])
