"""Identification of motors and springs through the loop, on a plant with known constants."""

import asyncio
from collections.abc import Iterator

import numpy as np
import pytest

from backend.analysis.identification import extract_side_steps, fit_spring_table, identify_motors
from backend.errors import OutOfRangeError
from backend.execution.progress import RunPhase
from backend.execution.runner import ExperimentRig, RunRequest, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments.plans import LoopSettings, MotorIdentificationPlan, SpringIdentificationPlan
from backend.experiments.prediction import predict_motor, predict_spring
from backend.identification.records import IdentificationError
from backend.models.settings import build_plan
from backend.realtime.commands import Stop
from backend.recording.reader import read_recorded_columns
from backend.reports.build import build_report
from backend.reports.model import to_html
from backend.reports.pdf import to_pdf
from backend.reports.run_data import load_source
from backend.storage import identifications
from backend.storage.database import open_database
from plant.dynamics import tendon_tension
from plant.parameters import PlantParameters, load_parameters

MOTOR = MotorIdentificationPlan(u_low=2.0, u_high=5.0, levels=2)
SPRING = SpringIdentificationPlan(sweep_s=5.0, cycles=1)


@pytest.fixture(scope="module")
def lab() -> PlantParameters:
    return load_parameters("lab")


@pytest.fixture(scope="module")
def station(lab: PlantParameters, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ExperimentRig]:
    database = open_database(tmp_path_factory.mktemp("unloaded"))
    with open_headless_rig(database, lab, LoopSettings(seed=2)) as made:
        yield made
    database.close()


def order(plan: MotorIdentificationPlan | SpringIdentificationPlan) -> RunRequest:
    return RunRequest(plan, LoopSettings(seed=2), "A. Operator")


def test_voltage_steps_give_back_the_simulated_motors(station: ExperimentRig, lab: PlantParameters) -> None:
    outcome = asyncio.run(run_experiment(station, order(MOTOR)))
    found, result = outcome.evaluation.identification, outcome.evaluation.result
    assert found is not None, outcome.evaluation.problem
    assert result is not None
    assert (found.kind, found.run_id, found.usable, found.options["levels"]) == ("motor", outcome.run.id, True, 2)
    for side, factor in (("A", lab.asymmetry.motor_A), ("B", lab.asymmetry.motor_B)):
        model = found.model[side]
        assert model["parameters"]["K_m"] == pytest.approx(factor * lab.motor.K_m, rel=0.005)
        assert model["parameters"]["T_m"] == pytest.approx(lab.motor.T_m + lab.motor.tau_e, rel=0.01)
        assert model["parameters"]["u_c"] == pytest.approx(lab.motor.c0 / (lab.motor.K_t * factor), rel=0.05)
        assert [item["voltage"] for item in model["rule"]] == [2.0, -2.0, 5.0, -5.0]
        # Dry friction hides part of the gain from the rule.
        assert 0.95 < model["rule_mean"]["K_m"] / model["parameters"]["K_m"] < 0.99
        assert not found.quality[side]["refused"]
    figures = {item.name: item.value for item in result.metrics.figures if item.value is not None}
    assert figures["K_m_A"] == found.model["A"]["parameters"]["K_m"]
    assert figures["turn_rad"] < 15.7
    assert figures["load_N"] < 0.5
    predicted = predict_motor(MOTOR, lab)
    assert predicted.is_feasible
    columns, _ = read_recorded_columns(station.database, outcome.run.id)
    loose = np.minimum(columns["F_A"], columns["F_B"]) < 0.1  # N: the springs begin there, but for noise
    assert np.count_nonzero(loose) > 10_000
    assert np.isnan(columns["S"][loose]).mean() > 0.99
    assert np.nanmin(columns["S"]) > 0.0  # by angles alone it would be down to -13
    report = build_report(load_source(station.database, outcome.run.id))
    assert (report.outcome, report.verdict) == ("passed", found.verdict)
    assert "2.884" in to_html(report)
    assert to_pdf(report).startswith(b"%PDF-")


def test_a_sweep_gives_back_the_simulated_springs(station: ExperimentRig, lab: PlantParameters) -> None:
    outcome = asyncio.run(run_experiment(station, order(SPRING)))
    found, result = outcome.evaluation.identification, outcome.evaluation.result
    assert found is not None, outcome.evaluation.problem
    assert result is not None
    springs = {"A": lab.make_dynamics().spring_A, "B": lab.make_dynamics().spring_B}
    for side, spring in springs.items():
        model = found.model[side]
        assert model["recommended"] == 2
        assert [fit["order"] for fit in model["fits"]] == [2, 3, 5]
        k = next(fit["k"] for fit in model["fits"] if fit["order"] == 2)
        # Elongation counts from the zero of pretension, which trusts the spring known before: up to that zero.
        x = np.linspace(0.015, 0.055, 30)
        fitted = np.polyval(k[::-1], x)
        shift = np.linspace(-5e-4, 5e-4, 101)
        true = np.array([[tendon_tension(spring, value + moved) for value in x] for moved in shift])
        assert np.min(np.max(np.abs(true - fitted), axis=1)) < 0.1
    figures = {item.name: item.value for item in result.metrics.figures if item.value is not None}
    # The load cells' delay parts the ways by twice the tension's rate times the delay: 2 x 8.6 N/s x 12 ms on the mean.
    assert 0.1 < figures["hysteresis_N"] < 0.5
    assert figures["max_tension_N"] == pytest.approx(45.0, abs=2.0)
    assert predict_spring(SPRING, lab).is_feasible


def test_a_run_that_ends_early_has_its_data_and_no_model(station: ExperimentRig) -> None:
    async def perform() -> str:
        stopped = False
        waiting = []

        def notify(doing: RunPhase, elapsed_s: float) -> None:
            nonlocal stopped
            if doing is RunPhase.PROGRAM and elapsed_s > 1.0 and not stopped:
                stopped = True
                waiting.append(asyncio.ensure_future(station.loop.send(Stop(hard=False))))

        outcome = await run_experiment(station, order(SPRING), notify)
        assert outcome.evaluation.identification is None
        assert outcome.evaluation.result is not None
        assert outcome.evaluation.result.metrics.played_s > 1.0
        return outcome.evaluation.problem

    before = len(_stored(station))
    assert "ended early" in asyncio.run(perform())
    assert len(_stored(station)) == before


def test_steps_that_saturate_or_carry_load_are_refused_one_by_one(lab: PlantParameters) -> None:
    t = np.arange(1000) * 1e-3
    parts = []
    for voltage, load in ((3.0, 0.0), (10.0, 0.0), (4.0, 2.0)):
        turned = 2.88 * voltage * (t + 0.22 * np.expm1(-t / 0.22))
        u = np.concatenate([np.zeros(200), np.full(1000, voltage), np.full(300, -1.0)])
        theta = np.concatenate([np.zeros(200), turned, np.full(300, turned[-1])])
        hold = np.zeros(100)
        parts.append(
            {
                "u_A": np.concatenate([hold, u]),
                "theta_A": np.concatenate([hold, theta]),
                "theta_A_ref": np.concatenate([hold, np.full(u.size, np.nan)]),
                "F_A": np.concatenate([hold, np.full(u.size, load)]),
            }
        )
    columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
    cut = extract_side_steps(columns, "A", lab)
    assert [step.voltage for step in cut.steps] == [3.0]
    assert [voltage for voltage, _ in cut.refused] == [10.0, 4.0]
    assert "saturates" in cut.refused[0][1]
    assert "load touches" in cut.refused[1][1]
    with pytest.raises(ValueError, match=r"motor A: .*different voltages.*saturates.*load touches"):
        identify_motors(columns, lab)


def test_predictions_say_what_is_wrong_before_anything_moves(lab: PlantParameters) -> None:
    hasty = predict_motor(MotorIdentificationPlan(u_high=9.0, travel_rad=6.0), lab)
    assert not hasty.is_feasible
    assert "before its speed is steady" in hasty.message
    high = predict_spring(SpringIdentificationPlan(F_high=47.0), lab)
    assert high.is_feasible
    with pytest.raises(OutOfRangeError, match="smallest voltage step: 6 V is more than 4 V"):
        build_plan(MotorIdentificationPlan, {"u_low": 6.0, "u_high": 4.0})
    with pytest.raises(OutOfRangeError, match=r"turns, .*: 49 N is outside 20 to 47 N"):
        build_plan(SpringIdentificationPlan, {"F_high": "49"})


def test_a_measured_table_is_identified_with_its_digest() -> None:
    x = np.linspace(8.0, 60.0, 40)
    F = -2.498 + 0.33149 * x + 8.5438e-3 * x**2
    text = "x [mm],F [N]\n" + "\n".join(f"{a:.4f},{b:.4f}" for a, b in zip(x, F, strict=True))
    found = fit_spring_table("bench.csv", text, "A. Operator", "0.1.0")
    assert (found.run_id, found.data["file"], found.data["points"]) == (None, "bench.csv", 40)
    assert len(found.data["sha256"]) == 64
    assert found.model["table"]["recommended"] == 2
    assert found.model["table"]["fits"][0]["k"] == pytest.approx([-2.498, 331.49, 8543.8], rel=2e-3)
    for bad in ("a,b\n1,2\n", "x [mm],F [N]\n1,2\n", text.replace("[mm]", "[inch]")):
        with pytest.raises(IdentificationError):
            fit_spring_table("bench.csv", bad, "A. Operator", "0.1.0")


def _stored(station: ExperimentRig) -> list[identifications.Identification]:
    with station.database.reading() as session:
        return identifications.find(session)
