"""Complete experiments on the simulator: loop, recorder, database and evaluation."""

import asyncio
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from backend.analysis.step_metrics import compute_tracking_metrics
from backend.banks.builder import BankError, build_bank, build_tuning_command, list_point_models
from backend.errors import OutOfRangeError
from backend.execution.progress import RunPhase
from backend.execution.runner import ExperimentRig, NotReadyError, RunRequest, RunResult, create_run, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import ActuatorIdentificationPlan, LoopSettings, Plan
from backend.faults import Fault
from backend.realtime.commands import Accepted, Reset, Stop
from backend.recording.reader import read_recorded_columns
from backend.storage import identifications, results, runs
from backend.storage.database import open_database
from backend.storage.orm import UnknownRecordError
from plant.parameters import load_parameters

SETTINGS = LoopSettings(seed=3)
HASTY = build_ready_plan("tracking", q_duration_s=0.6, S_duration_s=0.5)


@pytest.fixture
def parameters() -> str:
    return "ideal"


@pytest.fixture
def station(parameters: str, tmp_path: Path) -> Iterator[ExperimentRig]:
    database = open_database(tmp_path)
    with open_headless_rig(database, load_parameters(parameters), SETTINGS) as made:
        yield made
    database.close()


def perform(
    station: ExperimentRig, plan: Plan, during: Callable[[RunPhase, float], Awaitable[None]] | None = None
) -> RunResult:
    async def work() -> RunResult:
        waiting: list[asyncio.Task[None]] = []

        def notify(doing: RunPhase, elapsed_s: float) -> None:
            if during is not None:
                waiting.append(asyncio.ensure_future(during(doing, elapsed_s)))

        outcome = await run_experiment(station, RunRequest(plan, SETTINGS, "A. Operator", "a note"), notify)
        await asyncio.gather(*waiting)
        return outcome

    return asyncio.run(work())


@pytest.mark.parametrize("parameters", ["lab"])
def test_a_run_is_stored_whole_with_its_settings_and_its_result(station: ExperimentRig) -> None:
    outcome = perform(station, HASTY)
    run, result = outcome.run, outcome.evaluation.result
    assert (run.end_state, run.end_detail, run.who, run.note) == ("completed", "", "A. Operator", "a note")
    assert run.settings["plan"]["q_duration_s"] == 0.6
    assert run.settings["loop"]["seed"] == 3
    assert {"name": "lam_q", "symbol": "λ_q", "unit": "s", "value": 0.5}.items() <= next(
        item for item in run.settings["declared"] if item["name"] == "lam_q"
    ).items()
    assert run.parameters["geometry"]["r_j"] == {
        "value": 0.075,
        "unit": "m",
        "source": station.parameters.sources["geometry.r_j"],
    }

    columns, missed = read_recorded_columns(station.database, run.id)
    assert missed == 0
    assert columns["t"].size == round(HASTY.program().duration_s * 1000)
    assert np.allclose(np.diff(columns["t"]), 1e-3)
    assert columns["q_ref"][0] == 0.0
    assert columns["S_ref"][0] == 10.0

    assert result is not None
    assert result.metrics.complete
    assert result.metrics.steps is not None
    assert len(result.metrics.steps) == 17
    figures = {item.name: item.value for item in result.metrics.figures if item.value is not None}
    assert figures["max_tension_N"] == pytest.approx(max(columns["F_A"].max(), columns["F_B"].max()))
    with station.database.reading() as session:
        assert results.newest(session, run.id) == result


@pytest.mark.parametrize(
    ("parameters", "overshoot", "deviation_S", "tension"), [("ideal", 1, 0.1, 5), ("lab", 2, 0.2, 4)]
)
def test_tracking_meets_its_criteria(
    station: ExperimentRig, overshoot: float, deviation_S: float, tension: float
) -> None:
    plan = build_ready_plan("tracking", q_duration_s=4.0, S_duration_s=4.0)
    outcome = perform(station, plan)
    assert outcome.evaluation.result is not None
    figures = {item.name: item.value for item in outcome.evaluation.result.metrics.figures if item.value is not None}
    assert figures["overshoot_q_percent"] < overshoot
    assert figures["overshoot_S_percent"] < overshoot
    assert figures["deviation_S"] < deviation_S
    assert figures["min_tension_N"] > tension
    assert [item.passed for item in outcome.evaluation.result.criteria] == [True] * 4
    columns, _ = read_recorded_columns(station.database, outcome.run.id)
    count = station.parameters.sensors.joint_step
    to_the_count = compute_tracking_metrics(columns, plan.program(), plan.phases(), q_count=count).overall
    assert figures["reach_q_s"] == to_the_count.reach_q_s
    exact = compute_tracking_metrics(columns, plan.program(), plan.phases()).overall
    assert (figures["reach_q_s"] == exact.reach_q_s) == (count == 0.0)


@pytest.mark.parametrize(
    ("command", "end_state", "detail"),
    [
        (Stop(hard=True), "stopped", "stop_pressed"),
        (Stop(hard=False), "stopped", "stop_pressed"),
        (Stop(Fault.OPERATOR_LOST, hard=False), "link_lost", "operator_lost"),
        (Stop(Fault.FORCE_LIMIT), "tripped", "force_limit"),
        (Stop(Fault.SERVICE_ENDED, hard=False), "stopped", "service ended"),
    ],
)
def test_a_run_that_ends_early_is_closed_with_its_data(
    station: ExperimentRig, command: Stop, end_state: str, detail: str
) -> None:
    sent = False

    async def interfere(doing: RunPhase, elapsed_s: float) -> None:
        nonlocal sent
        if doing is RunPhase.PROGRAM and elapsed_s >= 2.0 and not sent:
            sent = True
            await station.loop.send(command)

    outcome = perform(station, HASTY, interfere)
    assert sent
    assert outcome.run.end_state == end_state
    assert detail in outcome.run.end_detail
    assert outcome.run.end_detail
    result = outcome.evaluation.result
    assert result is not None
    assert not result.metrics.complete
    assert 2.0 <= result.metrics.played_s < 3.5
    assert len(result.criteria) == 4
    assert not any(item.passed for item in result.criteria)
    columns, _ = read_recorded_columns(station.database, outcome.run.id)
    assert columns["t"].size == round(result.metrics.played_s * 1000)

    with pytest.raises(NotReadyError, match="reset"):
        create_run(station, RunRequest(HASTY, LoopSettings(), "A. Operator"))
    assert isinstance(asyncio.run(station.loop.send(Reset())), Accepted)
    asyncio.run(station.loop.advance(0.01))
    assert create_run(station, RunRequest(HASTY, LoopSettings(), "A. Operator")).id > outcome.run.id


def test_identification_finds_the_geometric_gains_and_feeds_a_bank(station: ExperimentRig) -> None:
    outcome = perform(station, ActuatorIdentificationPlan(tension_N=20.0))
    found = outcome.evaluation.identification
    assert found is not None, outcome.evaluation.problem
    assert found.run_id == outcome.run.id
    assert found.options["tension_N"] == 20.0
    assert found.data["samples"] == 20_320
    assert found.model["G_q"]["first_order"]["K"] == pytest.approx(0.05, rel=0.03)
    assert found.model["G_S"]["first_order"]["K"] == pytest.approx(0.721, rel=0.03)
    assert found.model["S_nominal"] == pytest.approx(10.55, abs=0.02)

    bank = build_bank(station.database, station.parameters, "first", [found.run_id], "A. Operator")
    with pytest.raises(BankError, match="apart"):
        build_bank(station.database, station.parameters, "twice", [found.run_id, found.run_id], "A. Operator")
    with pytest.raises(BankError, match="needs at least one"):
        build_bank(station.database, station.parameters, "none", [], "A. Operator")
    (entry,) = bank.entries
    with station.database.reading() as session:
        run_id = identifications.get(session, entry.identification_id or 0).run_id or 0
        assert runs.get(session, run_id).kind == "actuator_identification"
    (point,) = list_point_models(bank)
    assert point.T_q == found.model["G_q"]["first_order"]["T"]
    command = build_tuning_command(station.parameters, LoopSettings(lam_q=0.6), bank)
    assert (command.lam_q, len(command.entries)) == (0.6, 1)
    assert command.entries[0].S_nominal == point.S_nominal


@pytest.mark.parametrize("parameters", ["lab"])
def test_compliance_agrees_with_the_commanded_stiffness_once_the_sensor_delay_is_out(station: ExperimentRig) -> None:
    outcome = perform(station, build_ready_plan("compliance", pushes=2, hold_s=1.0))
    result = outcome.evaluation.result
    assert result is not None
    figures = {item.name: item.value for item in result.metrics.figures if item.value is not None}
    assert figures["rmse_aligned_N"] < 0.5
    assert figures["delay_s"] == pytest.approx(station.parameters.sensors.force_delay, abs=0.004)
    assert figures["stiffness_felt"] == pytest.approx(10.0, rel=0.03)
    assert figures["largest_push_N"] > 5.0
    assert result.criteria
    assert all(item.passed for item in result.criteria)


def test_an_identification_that_ends_early_gives_no_model(station: ExperimentRig) -> None:

    async def stop(doing: RunPhase, elapsed_s: float) -> None:
        if doing is RunPhase.PROGRAM and elapsed_s >= 3.0:
            await station.loop.send(Stop())

    outcome = perform(station, ActuatorIdentificationPlan(), stop)
    assert outcome.run.end_state == "stopped"
    assert outcome.evaluation.identification is None
    assert "ended early" in outcome.evaluation.problem
    with station.database.reading() as session:
        assert identifications.find(session) == []


def test_settings_that_are_not_safe_never_reach_a_loop(tmp_path: Path) -> None:
    database = open_database(tmp_path)
    with (
        pytest.raises(OutOfRangeError, match=r"λ_q|position loop") as refused,
        open_headless_rig(database, load_parameters("ideal"), LoopSettings(lam_q=0.2)),
    ):
        pytest.fail("a station was made")
    assert refused.value.minimum == pytest.approx(0.355, abs=0.02)
    with (
        pytest.raises(UnknownRecordError, match="bank 7"),
        open_headless_rig(database, load_parameters("ideal"), LoopSettings(bank=7)),
    ):
        pytest.fail("a station was made")
    database.close()
