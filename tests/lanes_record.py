"""A plugin of pytest for `tests.lanes`: writes down which tests there are and how each that was run came out."""

from pathlib import Path

import pytest


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--record", type=Path, help="folder for the names of the tests and their outcomes")


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Record(config.getoption("--record")))


class Record:
    """Outcomes of one session; with several processes, those of the one that gathers them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._outcomes: dict[str, str] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        (self._folder / "there").write_text("".join(f"{item.nodeid}\n" for item in items), encoding="utf-8")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.outcome == "failed" or self._outcomes.get(report.nodeid, "passed") == "passed":
            self._outcomes[report.nodeid] = report.outcome

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if not hasattr(session.config, "workerinput"):
            lines = (f"{outcome} {test}\n" for test, outcome in self._outcomes.items())
            (self._folder / "outcomes").write_text("".join(lines), encoding="utf-8")
