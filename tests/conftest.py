"""What all tests share: property tests that are the same on each run; which tests want the machine to themselves."""

import os
from pathlib import Path

import pytest
from hypothesis import settings

import backend  # noqa: F401  # before any test loads numpy: BLAS takes one thread, as in the service

settings.register_profile("sinew", deadline=None, derandomize=True, database=None)
settings.load_profile("sinew")

TESTS = Path(__file__).parent
collect_ignore = [] if "FUZZ_EXAMPLES" in os.environ else ["fuzz"]
"""Thousands of requests are a lane of their own, `make fuzz`."""
ONLY_COMPUTES = {
    "bench",
    "bring_up",
    "cli",
    "closed_loop",
    "controllers",
    "docs",
    "documents",
    "experiments",
    "exports",
    "identification",
    "loop",
    "migrations",
    "mutate",
    "packaging",
    "plant",
    "recording",
    "reports",
    "storage",
    "studies",
    "tick",
    "tuning",
    "wire",
    "test_forks.py",
    "test_house.py",
    "test_reading.py",
    "test_refusal.py",
}
"""What a busy machine makes slower but not wrong, but for modules that say of themselves that they are live. Else,
new folders too, tests are taken to be live."""


PAGE = "e2e"
"""Tests with a browser, which takes most of a core."""

BESIDE = {
    ".": "data_folder first_curve lanes supervision",
    "api": (
        "access announced auth background bad_input banks_and_springs bodies bounds bring_up bring_up_proof "
        "card_faults chain contract control dry_run_places endings faults forms hangup history invalid journal "
        "kept_tuning left_behind lent_tuning live names observation offload operate orders pace places push queue "
        "hand_over killed_experiment "
        "queue_problem run_library same_metrics scene security sign_in stream studies system tokens tuning turns units "
        "waits walk_back"
    ),
    "cli": "queue",
    "foxglove": "door publisher server",
    "loop": "supervisor",
    "packaging": "wheel",
    PAGE: (
        "absent accessibility charts experiments_and_runs homing in_sight layout map other_plants people refusals "
        "report_page scene studies tuning two_pages units viewer"
    ),
    "scene": "page portless pose shapes",
    "storage": "two_stations",
}
"""Live modules by their folder that were tried, and are green, on cores that had other work too. All others are taken
to want the machine for themselves, until they have been tried. These were, and stay alone:

- api/door: a median of answers to STOP, which is promised within 0.3 s
- loop/heartbeat, pacer, virtual_card; plant/network_rig, rig_watched: beats, ticks and watchdogs of tens of ms
- api/workers: reports are made politely (nice), so they wait for whatever else is busy
"""

SESSION_LONG = {"api", "fuzz"}
"""Their one service stays up until the end: so they come last, and it is in nobody's way."""


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave alone, where only what computes is asked for, what is live anyway: to import it takes seconds."""
    live = collection_path.parent == TESTS and collection_path.name not in ONLY_COMPUTES
    return True if live and config.getoption("markexpr") == "not live" else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if folder(item) not in ONLY_COMPUTES:
            item.add_marker(pytest.mark.live)
        if item.get_closest_marker("live"):
            if folder(item) == PAGE:
                item.add_marker(pytest.mark.page)
            if not beside(item):
                item.add_marker(pytest.mark.alone)
    items.sort(key=lambda item: folder(item) in SESSION_LONG)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Let what a test has printed pass from one process to another, also where it printed half a character."""
    report.sections = [(name, text.encode("utf-8", "backslashreplace").decode()) for name, text in report.sections]


def folder(item: pytest.Item) -> str:
    return item.path.relative_to(TESTS).parts[0]


def beside(item: pytest.Item) -> bool:
    where = item.path.relative_to(TESTS).parent.as_posix()
    return item.path.stem.removeprefix("test_") in BESIDE.get(where, "").split()
