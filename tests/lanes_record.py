"""A plugin of pytest for `tests.lanes`: writes down which tests there are and how each that was run came out.

Without ``--thorough`` there are not those that `tests/thorough.toml` names, unless a file or a test of it is asked for.
"""

from pathlib import Path

import pytest

from tests.tiers import is_thorough, whole_files

ROOT = Path(__file__).parents[1]


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--record", type=Path, help="folder for the names of the tests and their outcomes")
    parser.addoption("--thorough", action="store_true", help="those of tests/thorough.toml too")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leave files alone of which no test is run: to import them takes time."""
    if config.getoption("--thorough") or not collection_path.is_relative_to(ROOT):
        return None
    name = str(collection_path.relative_to(ROOT))
    return (name in whole_files() and not asked_for(name, config)) or None


def asked_for(test: str, config: pytest.Config) -> bool:
    """Return whether a file of tests, or one of its tests, was named on the command line."""
    names = (arg.partition("::")[0] for arg in config.args if arg.partition("::")[0].endswith(".py"))
    return any((config.invocation_params.dir / name).resolve() == ROOT / test.partition("::")[0] for name in names)


def pytest_configure(config: pytest.Config) -> None:
    config.pluginmanager.register(Record(config.getoption("--record"), config.getoption("--thorough")))


class Record:
    """Outcomes of one session; with several processes, those of the one that gathers them."""

    def __init__(self, folder: Path, thorough: bool) -> None:
        self._folder, self._thorough = folder, thorough
        self._outcomes: dict[str, str] = {}

    @pytest.hookimpl(tryfirst=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        if not self._thorough:
            left = [item for item in items if is_thorough(item.nodeid) and not asked_for(item.nodeid, config)]
            if left:
                config.hook.pytest_deselected(items=left)
                items[:] = [item for item in items if item not in set(left)]
        (self._folder / "there").write_text("".join(f"{item.nodeid}\n" for item in items), encoding="utf-8")

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.outcome == "failed" or self._outcomes.get(report.nodeid, "passed") == "passed":
            self._outcomes[report.nodeid] = report.outcome

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if not hasattr(session.config, "workerinput"):
            lines = (f"{outcome} {test}\n" for test, outcome in self._outcomes.items())
            (self._folder / "outcomes").write_text("".join(lines), encoding="utf-8")
