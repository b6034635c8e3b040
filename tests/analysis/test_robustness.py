"""The paper's load of 0.375 N·m, compared with the linear loop; an unmeasured metric does not pass."""

import asyncio
import math
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lsim

from backend.analysis import messages
from backend.analysis.disturbance_metrics import RETURN_SHARE, RobustnessColumns, compute_robustness_metrics
from backend.analysis.step_metrics import NoSamplesError, list_load_steps
from backend.execution.runner import RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.library import build_ready_plan, experiments_by_name
from backend.experiments.plans import ExperimentPlan, LoopSettings
from backend.realtime.commands import Accepted, Refused, RunProgram
from backend.realtime.modes import Mode
from backend.realtime.program import Law, Program, Segment, Shape
from backend.reports.build import build_report
from backend.reports.model import Report, Table
from backend.reports.run_data import RunData, load_source
from backend.storage.database import open_database
from backend.tuning.gains import make_motor_loops
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.experiments.judging import LEAD_IN_S, robustness_criteria
from tests.realtime.bench_top import BenchTop
from tests.reasons import assert_reason
from tests.refusals import refused

HOLD_S, LOAD_NM = 2.5, 0.375
PLAN = build_ready_plan("robustness", hold_s=HOLD_S, load_Nm=LOAD_NM)
STEPS = list_load_steps(PLAN.program())
LAM = LoopSettings().lam_motor
COUNT_RAD = 2.0 * np.pi / 8000


@pytest.fixture(scope="module")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


@pytest.fixture(scope="module")
def source(ideal: PlantParameters, tmp_path_factory: pytest.TempPathFactory) -> Iterator[RunData]:
    """Return a run that was executed, evaluated and stored as by the command line."""
    database = open_database(tmp_path_factory.mktemp("robustness"))
    with open_headless_rig(database, ideal, LoopSettings()) as station:
        outcome = asyncio.run(run_experiment(station, RunRequest(PLAN, LoopSettings(), "A. Operator")))
    yield load_source(database, outcome.run.id)
    database.close()


@pytest.fixture(scope="module")
def columns(source: RunData) -> RobustnessColumns:
    return source.columns


def linear_turn(parameters: PlantParameters, columns: RobustnessColumns, side: str, load_s: float) -> np.ndarray:
    """Return the rotation of a motor after ``load_s`` in its continuous loop with L/R, filter and reference."""
    motor, law = parameters.make_dynamics().motor_A, make_motor_loops(parameters, 0.0854).A
    behind = np.polymul([motor.tau_e, 1.0], [law.t_f, 1.0, 0.0])
    loop = np.polyadd(
        np.polymul([motor.J_m, motor.B_m, 0.0], behind), motor.K_t * np.array([law.k_d, law.k_p, law.k_i])
    )
    window = slice(round(load_s / T_s), round((load_s + HOLD_S) / T_s))
    reference = columns[f"theta_{side}_ref"][window]
    t = np.arange(reference.size) * T_s
    followed = lsim(([motor.K_t * law.k_i], loop), reference - reference[0], t)[1]
    return np.asarray(followed - lsim((LOAD_NM * behind, loop), np.ones(t.size), t)[1])


@pytest.mark.parametrize(("side", "load_s"), [("A", LEAD_IN_S), ("B", LEAD_IN_S + 2.0 * HOLD_S)])
def test_both_motors_respond_to_the_load_like_the_linear_loop(
    ideal: PlantParameters, columns: RobustnessColumns, side: str, load_s: float
) -> None:
    """The tolerance, a few percent of the largest rotation, covers tendons and sampling."""
    expected = linear_turn(ideal, columns, side, load_s)
    first = round(load_s / T_s)
    turned = columns[f"theta_{side}"][first : first + expected.size] - columns[f"theta_{side}"][first]
    assert np.max(np.abs(turned - expected)) < 0.05 * np.max(np.abs(expected))
    assert np.max(np.abs(expected)) > 0.05


def test_the_integral_part_compensates_the_load_within_the_voltage_limit(
    ideal: PlantParameters, columns: RobustnessColumns
) -> None:
    found = compute_robustness_metrics(columns, STEPS, 0.0)
    law, K_t = make_motor_loops(ideal, 0.0854).A, ideal.make_dynamics().motor_A.K_t
    for integral in (found.error_integral_A, found.error_integral_B):
        assert integral == pytest.approx(LOAD_NM / (K_t * law.k_i), rel=0.05)
    assert found.back_s is not None
    assert found.peak_voltage_V < ideal.motor.u_max
    assert all(item.passed for item in robustness_criteria(found, LAM))


def test_the_load_acts_at_the_planned_time(columns: RobustnessColumns) -> None:
    error = np.abs(columns["theta_A_ref"] - columns["theta_A"])
    before, after = round(LEAD_IN_S / T_s), round((LEAD_IN_S + 0.3) / T_s)
    assert np.max(error[before - 1000 : before]) < 0.02 * np.max(error[before:after])


def test_a_lasting_or_unresolvable_deviation_passes_no_criterion(columns: RobustnessColumns) -> None:
    lasting = {**columns, "theta_A": columns["theta_A"] + 0.1 * (np.arange(columns["q"].size) > LEAD_IN_S / T_s)}
    coarse = compute_robustness_metrics(columns, STEPS, 1.0)
    for found, code, values in (
        (compute_robustness_metrics(lasting, STEPS, 0.0), "motor_not_back", {"duration_s": HOLD_S}),
        (coarse, "motor_moved_too_little", {"minimum_counts": 20.0}),
    ):
        back = robustness_criteria(found, LAM)[0]
        assert (back.passed, back.figure) == ((None, None) if found is coarse else (False, HOLD_S))
        assert_reason(back.reason, code, **values)


@pytest.mark.parametrize("lam", [0.05, LAM, 0.2])
def test_the_bound_is_twice_the_recovery_time_of_the_linear_loop_at_any_lambda(
    ideal: PlantParameters, lam: float
) -> None:
    law, motor = make_motor_loops(ideal, lam).A, ideal.make_dynamics().motor_A
    behind = np.polymul([motor.tau_e, 1.0], [law.t_f, 1.0, 0.0])
    rest = motor.K_t * np.array([law.k_d, law.k_p, law.k_i])
    loop = np.polyadd(np.polymul([motor.J_m, motor.B_m, 0.0], behind), rest)
    t = np.arange(0.0, 40.0 * lam, T_s)
    turned = np.abs(lsim((behind, loop), np.ones(t.size), t)[1])
    back_s = t[np.flatnonzero(turned > 0.05 * turned.max())[-1]]
    bound = build_ready_plan("robustness").experiment.criteria[0].below
    assert bound == "18 * lam_motor"
    assert 18.0 * lam == pytest.approx(2.0 * back_s, rel=0.02)


def test_a_motor_at_rest_off_its_reference_fails_and_its_deviation_is_reported(tmp_path: Path) -> None:
    """With ``lab``, the loaded motors rest off their references while q and S are at theirs."""
    plan = build_ready_plan("robustness", hold_s=3.5)
    with closing(open_database(tmp_path)) as database:
        with open_headless_rig(database, load_parameters("lab"), LoopSettings()) as station:
            outcome = asyncio.run(run_experiment(station, RunRequest(plan, LoopSettings(), "A. Operator")))
        source = load_source(database, outcome.run.id)
    assert source.result is not None
    back = source.result.criteria[0]
    assert (back.passed, back.figure) == (False, 3.5)
    swing = float(back.reason.partition(" up to ")[2].partition(" %")[0])
    # in one direction: the integrators stop when joint and stiffness are at their references
    assert back.reason == messages.motor_not_back(side="A", duration_s=3.5, error_percent=swing)
    window = slice(*(round((LEAD_IN_S + turns * 3.5) / T_s) for turns in (1, 2)))
    error = np.abs(source.columns["theta_A_ref"] - source.columns["theta_A"])[window]
    late = error[error.size // 2 :].max()
    assert swing == pytest.approx(100.0 * late / error.max(), abs=1.0)
    assert late > RETURN_SHARE * error.max()
    report = build_report(source)
    assert report.outcome == "failed"
    assert any(f"lower bound: {back.reason}" in cell for cell in cells_of(report))


def test_a_run_that_ended_before_both_loads_has_no_robustness_metrics(columns: RobustnessColumns) -> None:
    early = {name: column[:-3000] for name, column in columns.items()}
    with refused(NoSamplesError, "loads_not_completed"):
        compute_robustness_metrics(early, STEPS, 0.0)


def test_the_report_has_measurements_and_loads(source: RunData) -> None:
    assert source.result is not None
    figures = compute_robustness_metrics(source.columns, STEPS, 0.0)
    stored = {item.name: item.value for item in source.result.metrics.figures}
    assert stored == pytest.approx({name: getattr(figures, name) for name in stored})
    report = build_report(source)
    assert report.title == "Robustness under a load"
    assert "0.375" in cells_of(report)
    assert report.outcome == "passed"


@pytest.mark.parametrize(("figure", "code"), [(np.nan, "no_motor_angle"), (0.0, "motor_moved_too_little")])
def test_a_missing_or_invalid_deviation_passes_no_criterion(
    columns: RobustnessColumns, figure: float, code: str
) -> None:
    still = {**columns, "theta_A": columns["theta_A_ref"] + figure}
    found = compute_robustness_metrics(still, STEPS, 0.0)
    back = robustness_criteria(found, LAM)[0]
    assert back.passed is None
    assert_reason(back.reason, code, side="A")
    assert found.deviation_A_rad == pytest.approx(figure, nan_ok=True)
    assert ("deviation_A_rad" in found.reasons) == np.isnan(figure)


@pytest.mark.parametrize(
    ("quantity", "figure"),
    [
        *((load, figure) for load in ("load_A", "load_B") for figure in (math.nan, math.inf, -0.1)),
        *(("F_push", figure) for figure in (math.nan, math.inf)),  # finite forces of either sign are valid
    ],
)
def test_an_invalid_load_is_rejected_before_motion(ideal: PlantParameters, quantity: str, figure: float) -> None:
    bench = BenchTop(ideal)
    bench.run()
    loaded: dict[str, Any] = {quantity: figure}
    segments = (Segment(0.5, 0.0, 10.0), Segment(0.5, 0.0, 10.0, **loaded))
    answered = bench.send(RunProgram(Program(Law.CASCADE, segments), 1))
    assert isinstance(answered, Refused)
    assert ("push" if quantity == "F_push" else "load on a motor's shaft") in answered.reason
    assert bench.loop.mode is Mode.RUN


def cells_of(report: Report) -> list[str]:
    blocks = [block for section in report.sections for block in section.blocks]
    return [cell for block in blocks if isinstance(block, Table) for row in block.rows for cell in row]


class WithoutPushes(Simulator):
    """A plant that only a person can push, like a rig."""

    pushes = False


def test_a_rig_without_simulated_pushes_rejects_a_push_before_motion(ideal: PlantParameters) -> None:
    """This includes pushes late in a program, which used to end the program with a fault."""
    late = Program(Law.COMPLIANCE, (Segment(5.0, 0.0, 10.0), Segment(1.0, 0.0, 10.0, F_push=5.0, shape=Shape.RAMP)))
    for plant, answer in ((WithoutPushes(ideal), Refused), (Simulator(ideal), Accepted)):
        bench = BenchTop(ideal, plant=plant)
        bench.wind_up()
        answered = bench.send(RunProgram(late, 1))
        assert isinstance(answered, answer)
        if isinstance(answered, Refused):
            assert_reason(answered.reason, "plant_without_push")
            assert bench.loop.mode is Mode.PRETENSION


class WithoutLoads(Simulator):
    """A plant that cannot apply loads to its shafts, like a rig."""

    loads_shafts = False


def test_a_rig_without_shaft_loads_rejects_a_load_before_motion_with_a_message(ideal: PlantParameters) -> None:
    for plant, answer in ((WithoutLoads(ideal), Refused), (Simulator(ideal), Accepted)):
        bench = BenchTop(ideal, plant=plant)
        bench.run()
        answered = bench.send(RunProgram(PLAN.program(), 1))
        assert isinstance(answered, answer)
        if isinstance(answered, Refused):
            assert_reason(answered.reason, "plant_without_shaft_load")


def test_a_stopped_program_removes_its_load(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    assert isinstance(bench.send(RunProgram(PLAN.program(), 1)), Accepted)
    bench.advance(LEAD_IN_S + 0.2)
    assert isinstance(bench.plant, Simulator)
    assert bench.plant.simulated.get().load.load_A == LOAD_NM
    bench.advance(4 * HOLD_S + 0.1)
    assert bench.plant.simulated.get().load == (0.0, 0.0)


def test_the_robustness_experiment_defaults_to_the_papers_load() -> None:
    offered = experiments_by_name()["robustness"].default_plan
    assert isinstance(offered, ExperimentPlan)
    r_m = load_parameters("lab").geometry.r_m
    assert offered.values["load_Nm"] == pytest.approx(50.0 * r_m)
