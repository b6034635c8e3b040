"""The log at level info names start, stop, processes, connections and modes; by default it has none of them."""

import logging
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from backend.logs import EVENT, LINES_PER_WINDOW, Level, RateLimit, configure_logging
from tests.api.conftest import client_with, wait_for
from tests.api.test_endings import wait_for_end
from tests.e2e.service import running_service


def lines_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, level: str | None) -> list[str]:
    """Return the lines of level info of a service that went to pretension and was ended."""
    if level is not None:
        monkeypatch.setenv("SINEW_LOG_LEVEL", level)
    with running_service(tmp_path, params="ideal") as service:
        with client_with(service, "token") as operator:
            operator.post("/api/mode", json={"mode": "pretension"}).raise_for_status()
            wait_for(operator, "pretension_done", True)
        os.kill(service.pid, signal.SIGTERM)
        wait_for_end(service)
    return [line for line in service.log.read_text().splitlines() if " INFO " in line]


def test_info_names_what_happens_with_its_identifiers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = lines_of(tmp_path, monkeypatch, "info")
    text = "\n".join(lines)
    started = re.search(r"Loop process (\d+) started", text)
    assert started is not None
    assert f"Loop process {started[1]}: ended with status 0" in text
    assert re.search(r"The service started: plant simulator, data folder \S+, address http://127\.0\.0\.1:\d+", text)
    assert re.search(r"mode: off → pretension by operator", text)
    assert "The service stopped: " in text


def test_by_default_it_has_warnings_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("SINEW_LOG_LEVEL", raising=False)
    lines = lines_of(tmp_path, monkeypatch, None)
    assert lines == []


def test_events_are_written_however_many_there_are() -> None:
    def written(extra: dict[str, bool]) -> int:
        limit, log = RateLimit(lambda: 0.0), logging.getLogger("test")
        record = log.makeRecord("test", logging.INFO, "here.py", 1, "a line", (), None, extra=extra)
        return sum(limit.filter(record) for _ in range(100))

    assert (written({}), written(EVENT)) == (LINES_PER_WINDOW, 100)


@pytest.fixture
def loggers() -> Iterator[None]:
    """Loggers as they were, after a test that changes them."""
    changed = [logging.getLogger(name) for name in ("", "backend", "plant")]
    before = [(logger.level, logger.handlers[:]) for logger in changed]
    yield
    for logger, (level, handlers) in zip(changed, before, strict=True):
        logger.setLevel(level)
        logger.handlers[:] = handlers


@pytest.mark.usefixtures("loggers")
@pytest.mark.parametrize(
    ("level", "written"),
    [
        ("info", ["backend.x INFO", "backend.x WARNING", "asyncio WARNING"]),
        ("warning", ["backend.x WARNING", "asyncio WARNING"]),
        ("error", []),
    ],
)
def test_a_level_holds_for_libraries_too(level: Level, written: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    configure_logging(level)
    for name in ("backend.x", "asyncio"):
        logging.getLogger(name).info("%s INFO", name)
        logging.getLogger(name).warning("%s WARNING", name)
    assert [line.rsplit(": ", 1)[1] for line in capsys.readouterr().err.splitlines()] == written
