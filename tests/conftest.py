"""What all tests share: property tests that are the same on each run; which tests are of which lane."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import settings

import backend  # noqa: F401  # before any test loads numpy: BLAS takes one thread, as in the service
from backend.workers import SAFE_PATH

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    # As in whatever a script has started in its background: what the tests start would never hear of Ctrl+C either.
    signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("sinew", deadline=None, derandomize=True, database=None)
settings.load_profile("sinew")

TESTS = Path(__file__).parent
collect_ignore = [] if "FUZZ_EXAMPLES" in os.environ else ["fuzz"]
"""Thousands of requests are a lane of their own, `make fuzz`."""
ONLY_COMPUTES = {
    "analysis",
    "banks",
    "bench",
    "commissioning",
    "cli",
    "closed_loop",
    "control",
    "docs",
    "execution",
    "models",
    "experiments",
    "exports",
    "identification",
    "realtime",
    "migrations",
    "mutate",
    "packaging",
    "plant",
    "recording",
    "reports",
    "storage",
    "studies",
    "tuning",
    "wire",
    "test_forks.py",
    "test_repository.py",
    "test_lanes.py",
    "test_units.py",
    "test_errors.py",
}
"""What a busy machine makes slower but not wrong, but for modules that say of themselves that they are live. Else,
new folders too, tests are taken to be live."""

LIVE = "mark.live"
"""How such a module says it."""

PAGE = "e2e"
"""Tests with a browser, which takes most of a core."""

SESSION_LONG = {"api", "fuzz"}
"""Their one service stays up until the end: so they come last, and it is in nobody's way."""


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--truth-seed", type=int, help="of the robot at the page (tests/e2e/truth); drawn afresh if left out"
    )
    parser.addoption("--truth-go-on", action="store_true", help="collect what is untrue, do not end at the first")
    parser.addoption("--truth-deeds", type=int, help="how much that robot does; 300 deeds if left out")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave alone what a lane has nothing of: to import it takes seconds."""
    if TESTS not in collection_path.parents:
        return None
    place = collection_path.relative_to(TESTS).parts[0]
    live, page = place not in ONLY_COMPUTES or _says_live(collection_path), place == PAGE
    unasked = {"not live": place not in ONLY_COMPUTES, "page": not page, "live and not page": page or not live}
    return unasked.get(config.getoption("markexpr")) or None


def _says_live(path: Path) -> bool:
    """Return whether a module says of itself, or of a test, that it is live; a folder may have such a module."""
    return path.suffix != ".py" or LIVE in path.read_text(encoding="utf-8")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if folder(item) not in ONLY_COMPUTES:
            item.add_marker(pytest.mark.live)
        if folder(item) == PAGE:
            item.add_marker(pytest.mark.page)
    items.sort(key=lambda item: folder(item) in SESSION_LONG)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Let what a test has printed pass from one process to another, also where it printed an unpaired surrogate."""
    report.sections = [(name, text.encode("utf-8", "backslashreplace").decode()) for name, text in report.sections]


@pytest.fixture(autouse=True)
def _environment_is_restored() -> Iterator[None]:
    """Restore PYTHONSAFEPATH after each test: the product sets it for all children that it starts later."""
    before = os.environ.get(SAFE_PATH)
    yield
    if before is None:
        os.environ.pop(SAFE_PATH, None)
    else:
        os.environ[SAFE_PATH] = before


def folder(item: pytest.Item) -> str:
    return item.path.relative_to(TESTS).parts[0]
