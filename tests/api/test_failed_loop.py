"""A loop that has failed by a mistake of its own is not reset: a new one is started."""

from pathlib import Path

import pytest

from backend.faults import Fault
from backend.realtime.supervisor import Supervisor
from backend.storage import events
from backend.storage.database import open_database
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Parts, stepped


def test_reset_starts_a_new_loop_after_a_mistake_of_the_loop(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    database = open_database(tmp_path)
    started: list[str] = []

    async def restart(_supervisor: Supervisor, purpose: str) -> None:
        started.append(purpose)

    def fail(*_: object) -> int:
        raise ZeroDivisionError("a gain of zero")

    async def work(parts: Parts) -> None:
        monkeypatch.setattr(parts.supervisor._stepped._loop._step, "detect_faults", fail)
        await parts.supervisor.advance_until(lambda: parts.live_state.fault is Fault.INTERNAL_ERROR, timeout_s=5.0)
        assert parts.supervisor.is_alive
        await parts.actuator.reset(OPERATOR.name)

    monkeypatch.setattr(Supervisor, "restart", restart)
    stepped(database, load_parameters("ideal"), work)
    with database.reading() as session:
        told = [event.text for event in events.find(session, limit=100)]
    database.close()
    assert len(started) == 1
    assert "loop started again" in told
    assert any("ZeroDivisionError" in text for text in told)
