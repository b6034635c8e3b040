"""The start of an experiment: compliance first moves the joint to 0, and the forecast contains the time for it."""

import asyncio
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from backend.execution.runner import ExperimentRig, RunRequest, RunResult, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.forecast import forecast_duration, read_initial_state
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import LoopSettings
from backend.realtime.commands import Accepted, SetMode, SetReferences
from backend.realtime.modes import Mode
from backend.recording.reader import read_recorded_columns
from backend.storage.database import open_database
from plant.parameters import load_parameters
from tests.experiments.judging import LEAD_IN_S

PLAN = build_ready_plan("compliance", profile="steps", hold_s=0.5, F_push=10.0)


@pytest.fixture
def station(tmp_path: Path) -> Iterator[ExperimentRig]:
    database = open_database(tmp_path)
    with open_headless_rig(database, load_parameters("ideal"), LoopSettings()) as made:
        yield made
    database.close()


async def brought_off_centre(station: ExperimentRig) -> None:
    assert isinstance(await station.loop.send(SetMode(Mode.PRETENSION)), Accepted)
    for _ in range(200):
        await station.loop.advance(0.1)
        if isinstance(await station.loop.send(SetMode(Mode.RUN, 0)), Accepted):
            break
    await station.loop.send(SetReferences(math.radians(15.0), 10.0))
    await station.loop.advance(3.0)


def test_compliance_from_off_centre_moves_to_0_first_and_takes_as_long_as_forecast(
    station: ExperimentRig,
) -> None:
    async def work() -> tuple[RunResult, float, float]:
        await brought_off_centre(station)
        start = read_initial_state(station.loop.ring.newest())
        assert start.q == pytest.approx(math.radians(15.0), abs=0.02)
        told_s, began = forecast_duration(PLAN, station.parameters, start).duration_s, station.loop.ring.count
        outcome = await run_experiment(station, RunRequest(PLAN, LoopSettings(), "A. Operator"))
        return outcome, told_s, (station.loop.ring.count - began) / 1000.0

    outcome, told_s, took_s = asyncio.run(work())
    assert outcome.run.end_state == "completed"
    columns, _ = read_recorded_columns(station.database, outcome.run.id)
    lead_in = slice(0, round(LEAD_IN_S * 1000))
    assert np.abs(columns["q"][lead_in]).max() < 0.01
    # The way from 10 N to S_ref = 10 N·m/rad takes 17.4 N; nothing else moves before the first push.
    assert max(columns[name][lead_in].max() for name in ("F_A", "F_B")) < 18.5
    assert told_s == pytest.approx(took_s, abs=0.4)
