"""Dry runs, and the same experiment on the virtual card."""

import asyncio
import multiprocessing
from concurrent.futures import ProcessPoolExecutor
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from backend.execution.progress import RunPhase
from backend.execution.runner import ExperimentRig, RunRequest, RunResult, run_experiment
from backend.execution.simulation import dry_run, open_headless_rig, read_progress, warm_up_dry_run
from backend.experiments.library import build_ready_plan
from backend.experiments.parser import ExperimentError, parse_experiment
from backend.experiments.plans import (
    LoopSettings,
    MotorIdentificationPlan,
    Plan,
    SpringIdentificationPlan,
    build_experiment_plan,
)
from backend.models.run import ENTRY, EntryModel
from backend.realtime.commands import SetMode
from backend.realtime.modes import Mode
from backend.recording.reader import read_samples
from backend.storage.banks import Bank, BankEntry
from backend.storage.database import open_database
from backend.storage.runs import EndState
from backend.tuning.gains import designed_point
from plant import compilation
from plant.interface import SIMULATOR, PlantChoice, PlantError, PlantKind
from plant.parameters import load_parameters
from tests.refusals import refused

# A process prepared for dry runs has loaded all machine code that one needs.


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
def test_the_first_dry_run_of_a_prepared_process_loads_no_machine_code(tmp_path: Path, ready: bool) -> None:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as fresh:
        loaded = fresh.submit(loaded_by_a_dry_run, tmp_path, ready).result()
    assert (loaded == 0) is ready


def test_a_change_of_bank_loads_the_bank_with_that_number(tmp_path: Path) -> None:
    """The run has its own database, in which another bank could have this number."""
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


# Experiments on the virtual card give the same metrics as on the simulator, except for quantization.

VIRTUAL = PlantChoice(PlantKind.VIRTUAL_CARD)
PARAMETERS = load_parameters("lab")


ALIKE = {"rad": 0.004, "N": 0.1, "N·m/rad": 0.05, "s": 0.02, "V": 0.02, "%": 0.5, "1": 0.05, "rad/(V·s)": 0.01}
"""Two counts of the joint's encoder, two codes of a load cell and its noise, drawn two ticks later; what follows."""

# One second on the card takes as long as three on the simulator, so similar experiments are omitted.
PLANS: dict[str, Plan] = {
    "tracking": build_ready_plan("tracking", q_duration_s=2.0, S_duration_s=2.0),
    "compliance": build_ready_plan("compliance", pushes=3, hold_s=1.0),
    "motors": MotorIdentificationPlan(levels=2),
    "springs": SpringIdentificationPlan(sweep_s=4.0, cycles=1),
}


def performed(
    folder: Path, plan: Plan, plant: PlantChoice, held_s: float = 0.0, loop: LoopSettings | None = None
) -> tuple[RunResult, dict[str, np.ndarray]]:
    """Return outcome and samples of an experiment that starts ``held_s`` [s] after pretension began."""
    settings, database = loop or LoopSettings(), open_database(folder)

    async def played(station: ExperimentRig) -> RunResult:
        if held_s > 0.0:
            await station.loop.send(SetMode(Mode.PRETENSION))
            await station.loop.advance(held_s)
        return await run_experiment(station, RunRequest(plan, settings, "Ana"))

    with open_headless_rig(database, PARAMETERS, settings, plant) as station:
        outcome = asyncio.run(played(station))
    with database.reading() as session:
        columns = read_samples(session, outcome.run.id).columns
    database.close()
    return outcome, columns


def figures(outcome: RunResult) -> dict[str, tuple[float | None, str]]:
    assert outcome.evaluation.result is not None
    return {figure.name: (figure.value, figure.unit) for figure in outcome.evaluation.result.metrics.figures}


@pytest.mark.parametrize("name", PLANS)
def test_an_experiment_gives_the_same_results_on_simulator_and_virtual_card(tmp_path: Path, name: str) -> None:
    simulated, without_card = performed(tmp_path / "simulator", PLANS[name], SIMULATOR)
    virtual, with_card = performed(tmp_path / "card", PLANS[name], VIRTUAL)
    assert (simulated.run.plant, virtual.run.plant) == ("simulator", "virtual card")
    assert simulated.run.end_state == virtual.run.end_state == "completed"
    ours, theirs = figures(virtual), figures(simulated)
    assert ours.keys() == theirs.keys()
    for figure, (value, unit) in ours.items():
        expected = theirs[figure][0]
        assert (value is None) == (expected is None), figure
        if value is not None and expected is not None:
            assert value == pytest.approx(expected, abs=ALIKE[unit], rel=0.02), figure
    np.testing.assert_allclose(with_card["q"], without_card["q"], atol=ALIKE["rad"])
    # Recorded voltages and counts match the recorded signals through the supplied wiring file.
    np.testing.assert_allclose(with_card["F_A"], 10.0 * with_card["V_A"], rtol=1e-5)
    np.testing.assert_allclose(with_card["n_q"], np.round(with_card["n_q"]))
    assert np.isnan(without_card["V_A"]).all()


def test_a_rig_is_rejected_in_a_batch(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    rig = PlantChoice(PlantKind.RIG)
    with (
        refused(PlantError, "plant_runs_in_real_time", plant=rig.name),
        open_headless_rig(database, PARAMETERS, LoopSettings(), rig),
    ):
        pass
    database.close()
