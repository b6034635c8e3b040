"""One real service for the fuzz tests, in a state in which most operations are possible."""

import os
from collections.abc import Iterator

import pytest

from tests.e2e.service import running_service
from tests.fuzz.target import Target, store_runs

EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "4"))
"""Generated requests for each operation and kind of token."""
SEED = int(os.environ.get("FUZZ_SEED", "1"))


def pytest_report_header() -> str:
    return f"fuzz: FUZZ_EXAMPLES={EXAMPLES} FUZZ_SEED={SEED}"


@pytest.fixture(scope="session")
def target(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Target]:
    data = tmp_path_factory.mktemp("fuzz")
    store_runs(data)
    with running_service(data, params="ideal") as service:
        made = Target(service)
        yield made
        made.close()


@pytest.fixture(autouse=True)
def _unharmed(target: Target) -> Iterator[None]:
    """After each test, the service has logged no traceback, has the same processes, and responds."""
    before = target.log_size()
    yield
    said = target.log_since(before)
    assert "Traceback" not in said, said[-8000:]
    assert target.alive()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    for line in Target.summary:
        terminalreporter.write_line(f"fuzz: {line}")
