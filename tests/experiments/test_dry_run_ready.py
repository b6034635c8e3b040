"""A process that got ready for dry runs has loaded the machine code that one takes."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import pytest

from backend.experiments.plans.loop_settings import LoopSettings
from backend.experiments.plans.stored_plan import ready_plan
from backend.experiments.playing.dry_run import dry_run, get_ready
from backend.experiments.playing.runner import Order
from backend.storage.runs import EndState
from plant import compiled
from plant.parameters import load_parameters


def loaded_by_a_dry_run(folder: Path, ready: bool) -> int:
    parameters, settings = load_parameters("lab"), LoopSettings()
    if ready:
        get_ready(parameters, settings)
    before = len(compiled._KNOWN)
    order = Order(ready_plan("tracking", q_duration_s=1.0, S_duration_s=1.0), settings, "Ana")
    played = dry_run(parameters, order, None, ("q",), 10, folder)
    assert played.run.end_state == EndState.COMPLETED
    return len(compiled._KNOWN) - before


@pytest.mark.parametrize("ready", [True, False])
def test_the_first_dry_run_loads_no_machine_code(tmp_path: Path, ready: bool) -> None:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as fresh:
        loaded = fresh.submit(loaded_by_a_dry_run, tmp_path, ready).result()
    assert (loaded == 0) is ready
