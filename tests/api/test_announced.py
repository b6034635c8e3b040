"""What the service announces of an identification, against what its loop then does: length, progress, and the bank."""

import asyncio
from pathlib import Path

import pytest

from backend.execution.progress import RunPhase
from backend.realtime.commands import Accepted, SetMode
from backend.realtime.modes import Mode
from backend.recording.reader import read_envelope
from backend.schemas.identification import ActuatorRequest
from backend.schemas.state import TaskView
from backend.services.banks import StoredBanks
from backend.storage import banks
from backend.storage.banks import BankEntry
from backend.storage.database import open_database
from plant.parameters import load_parameters
from tests.api.stepped_service import OPERATOR, Here, Parts, stepped

ORDER = ActuatorRequest(tensions_N=[10.0, 40.0], bits=5, periods=2, settle_s=1.0)
MODEL = {"K_q": 0.05, "T_q": 0.342, "K_S": 0.7209, "T_S": 0.342}


def test_runs_in_turn_take_as_long_and_go_as_far_as_announced(tmp_path: Path) -> None:
    database = open_database(tmp_path)

    async def ordered(parts: Parts) -> None:
        assert isinstance(await parts.supervisor.send(SetMode(Mode.PRETENSION)), Accepted)
        await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
        told = await parts.ordered_runs.predict_identification(ORDER, asyncio.to_thread)
        began = parts.supervisor.ring.count
        seen: list[TaskView] = []
        first = await parts.ordered_runs.start_identification(ORDER, OPERATOR.name)
        while parts.live_state.task is not None:
            if not seen or parts.live_state.task != seen[-1]:
                seen.append(parts.live_state.task)
            await asyncio.sleep(0)
        await parts.supervisor.advance_until(lambda: parts.state().pretension_done, 20.0)
        took_s = (parts.supervisor.ring.count - began) / 1000.0
        # The service looks ten times a second whether a run is over, and whether the next one can start.
        assert told.duration_s == pytest.approx(took_s, abs=0.6)
        for run in (first, first + 1):
            shown = [task for task in seen if task.run == run]
            elapsed = [task.elapsed_s for task in shown]
            assert elapsed == sorted(elapsed)
            played = [task for task in shown if task.phase is RunPhase.PROGRAM]
            assert len({task.duration_s for task in played}) == 1
            assert shown[0].duration_s == pytest.approx(played[0].duration_s, abs=0.3)
            assert played[-1].elapsed_s == pytest.approx(played[-1].duration_s, abs=0.3)
            view = parts.identifications.load_identification(run)
            assert view.estimate is not None, view.message
        with database.reading() as session:
            ends = [read_envelope(session, run, 1, ("q",)) for run in (first, first + 1)]
        furthest = max(float(envelope.maximum["q"].max()) for envelope in ends)
        assert told.q_high - 0.06 < furthest < told.q_high
        view = parts.identifications.load_identification(first)
        with database.session() as session:
            entries = [BankEntry(8.24, MODEL, view.estimate), BankEntry(12.43, MODEL)]
            bank = banks.add(session, "bench", entries, OPERATOR.name)
        banks_of = StoredBanks(database, Here(lambda _cause: None), lambda: parts.live_state.tuning)
        made, imported = banks_of.load_bank(bank.id).entries
        # θ_B = 0: both springs share what motor A winds, so that the joint stands at x/r_j, x = 23.49 mm at 10 N.
        assert made.q_nominal == pytest.approx(0.02349 / 0.075, abs=2e-3)
        assert imported.q_nominal is None

    try:
        stepped(database, load_parameters("ideal"), ordered)
    finally:
        database.close()
