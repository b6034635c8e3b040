"""A trip that the bring-up provokes, and a stop of a recording, are planned: no alarm, no flight record."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from backend.faults import Fault
from backend.realtime.commands import Inject, SetMode
from backend.realtime.modes import Mode
from backend.recording.flight import FlightRecorder, Quota
from backend.schemas.state import MarkKind
from backend.services.event_log import MarkAdded
from backend.storage import flights
from backend.storage.database import Database, open_database
from plant.interface import InjectedFault, InjectedFaultKind, PlantChoice, PlantKind
from plant.parameters import load_parameters
from tests.api.stepped_service import Parts, stepped


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


@pytest.mark.parametrize("provoked", [Fault.NONE, Fault.SAFETY_MODULE, Fault.SLACK])
def test_only_the_trip_that_is_provoked_is_expected(database: Database, provoked: Fault) -> None:
    expected = provoked is Fault.SAFETY_MODULE

    async def work(parts: Parts) -> None:
        live_state, supervisor = parts.live_state, parts.supervisor
        recorder = FlightRecorder(database, lambda: supervisor.ring, Quota(9, 10**9), live_state.is_expected)
        supervisor.listen(recorder.on_event)
        marks: list[tuple[MarkKind, str]] = []
        parts.events.subscribe(MarkAdded, lambda added: marks.append((added.mark.kind, added.mark.text)))
        live_state.provoked_fault = provoked
        await supervisor.send(SetMode(Mode.PRETENSION))
        await supervisor.advance(0.1)
        await supervisor.send(Inject(InjectedFault(InjectedFaultKind.SAFETY_TRIP)))
        await supervisor.advance(0.1)

        fault = parts.state().fault
        assert fault is not None
        assert (fault.code, fault.expected) == (Fault.SAFETY_MODULE, expected)
        assert "F_A = " in fault.message
        (kind,) = [kind for kind, text in marks if "safety module" in text]
        assert kind is (MarkKind.NOTE if expected else MarkKind.TRIP)
        recorder.close()
        with database.reading() as session:
            assert len(flights.find(session)) == (0 if expected else 1)
        assert live_state.is_expected(Fault.NONE) is False

    stepped(database, load_parameters("ideal"), work)


def test_no_stop_of_a_recording_is_an_alarm_and_any_other_plant_error_is_one(database: Database) -> None:
    async def work(parts: Parts) -> None:
        for kind in PlantKind:
            parts.supervisor.setup = replace(parts.supervisor.setup, plant=PlantChoice(kind))
            for fault in (Fault.PLANT_ERROR, Fault.FORCE_LIMIT, Fault.STOP_PRESSED):
                assert parts.live_state.is_expected(fault) is (kind is PlantKind.REPLAY)

    stepped(database, load_parameters("ideal"), work)
