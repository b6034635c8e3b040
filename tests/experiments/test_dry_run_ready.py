"""A process prepared for dry runs has loaded all machine code that one needs."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from pathlib import Path

import pytest

from backend.execution.progress import RunPhase
from backend.execution.runner import RunRequest
from backend.execution.simulation import dry_run, read_progress, warm_up_dry_run
from backend.experiments.library import build_ready_plan
from backend.experiments.parser import ExperimentError, parse_experiment
from backend.experiments.plans import LoopSettings, build_experiment_plan
from backend.models.run import ENTRY, EntryModel
from backend.storage.banks import Bank, BankEntry
from backend.storage.runs import EndState
from backend.tuning.gains import designed_point
from plant import compilation
from plant.parameters import load_parameters


def loaded_by_a_dry_run(folder: Path, ready: bool) -> int:
    parameters, settings = load_parameters("lab"), LoopSettings()
    if ready:
        warm_up_dry_run(parameters, settings)
    before = len(compilation._OVERLOADS)
    order = RunRequest(build_ready_plan("tracking", q_duration_s=1.0, S_duration_s=1.0), settings, "Ana")
    played = dry_run(parameters, order, (), ("q",), 10, folder)
    assert played.run.end_state == EndState.COMPLETED
    return len(compilation._OVERLOADS) - before


@pytest.mark.parametrize("ready", [True, False])
def test_the_first_dry_run_loads_no_machine_code(tmp_path: Path, ready: bool) -> None:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as fresh:
        loaded = fresh.submit(loaded_by_a_dry_run, tmp_path, ready).result()
    assert (loaded == 0) is ready


def test_a_change_of_bank_loads_the_bank_with_that_number(tmp_path: Path) -> None:
    """Played in a database of its own, where another bank could have taken the number."""
    lab = load_parameters("lab")
    text = (
        "format: 1\nname: tried\ntitle: Tried\nphases:\n  - name: all\n    title: All\n    parts:\n"
        "      - {do: step, q_ref: 0.0, S_ref: 10.0, duration_s: 1}\n      - {do: tuning, bank: 4}\n"
        "      - {do: hold, duration_s: 1}\n"
    )
    experiment, lines = parse_experiment(text)
    plan = build_experiment_plan(experiment, {}, lines=lines)
    made = designed_point(lab)
    model = ENTRY.write(EntryModel(K_q=made.K_q, T_q=made.T_q, K_S=made.K_S, T_S=made.T_S, tension_N=20.0))
    now = datetime.now(UTC)
    used = [Bank(number, f"bank {number}", 1, "", "A. Operator", now, (BankEntry(10.0, model),)) for number in (7, 4)]
    order = RunRequest(plan, LoopSettings(bank=7), "A. Operator")
    assert read_progress(tmp_path) == (RunPhase.STARTING, 0.0)
    played = dry_run(lab, order, used, ("q",), 10, tmp_path)
    assert played.run.end_state == "completed"
    assert read_progress(tmp_path) == (RunPhase.EVALUATION, 0.0)
    with pytest.raises(ExperimentError, match="line 9") as refused:
        dry_run(lab, order, used[:1], ("q",), 10, tmp_path / "without")
    assert "4" in str(refused.value)
