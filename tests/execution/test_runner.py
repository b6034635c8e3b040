"""Complete experiments on the simulator: executed, interrupted, homed, identified."""

import asyncio
import math
from collections import Counter
from collections.abc import Awaitable, Callable, Iterator
from dataclasses import dataclass
from itertools import cycle
from pathlib import Path

import numpy as np
import pytest

from backend.analysis import messages as analysis_messages
from backend.analysis.identification import extract_side_steps, fit_spring_table, identify_motors
from backend.analysis.messages import incomplete_run_without_model
from backend.analysis.step_metrics import compute_tracking_metrics
from backend.banks.builder import BankError, build_bank, build_tuning_command, list_point_models
from backend.errors import OutOfRangeError
from backend.execution.progress import RunPhase
from backend.execution.runner import ExperimentRig, NotReadyError, RunRequest, RunResult, create_run, run_experiment
from backend.execution.simulation import open_headless_rig
from backend.experiments import library
from backend.experiments.forecast import forecast_duration, read_initial_state
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import (
    ActuatorIdentificationPlan,
    LoopSettings,
    MotorIdentificationPlan,
    Plan,
    SpringIdentificationPlan,
)
from backend.experiments.prediction import predict_motor, predict_spring
from backend.faults import Fault
from backend.identification.records import IdentificationError
from backend.models.settings import build_plan
from backend.realtime.commands import Accepted, Command, Inject, Reset, SetMode, SetReferences, Stop
from backend.realtime.modes import Mode
from backend.recording.reader import read_recorded_columns
from backend.reports.build import build_report
from backend.reports.model import to_html
from backend.reports.pdf import to_pdf
from backend.reports.run_data import RunData, load_source
from backend.reports.verification import Verified, verify_report
from backend.storage import identifications, results, runs
from backend.storage.database import open_database
from backend.storage.orm import UnknownRecordError
from plant.dynamics import tendon_tension
from plant.interface import InjectedFault, InjectedFaultKind
from plant.parameters import PlantParameters, load_parameters
from tests.experiments.judging import LEAD_IN_S
from tests.reasons import assert_reason
from tests.refusals import refused

# Complete experiments on the simulator: loop, recorder, database and evaluation.

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
def test_a_run_is_stored_completely_with_settings_and_result(station: ExperimentRig) -> None:
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
def test_the_tracking_experiment_passes_its_criteria(
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
def test_an_interrupted_tracking_run_is_stored_with_its_data(
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

    with refused(NotReadyError, "loop_stopped"):
        create_run(station, RunRequest(HASTY, LoopSettings(), "A. Operator"))
    assert isinstance(asyncio.run(station.loop.send(Reset())), Accepted)
    asyncio.run(station.loop.advance(0.01))
    assert create_run(station, RunRequest(HASTY, LoopSettings(), "A. Operator")).id > outcome.run.id


def test_identification_finds_the_geometric_gains_and_provides_a_bank_entry(station: ExperimentRig) -> None:
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
    with refused(BankError, "entries_too_close", distance=0.0):
        build_bank(station.database, station.parameters, "twice", [found.run_id, found.run_id], "A. Operator")
    with refused(BankError, "no_identifications"):
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
def test_compliance_matches_the_commanded_stiffness_after_removal_of_the_sensor_delay(station: ExperimentRig) -> None:
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
    assert outcome.evaluation.problem == incomplete_run_without_model(end_state="stopped")
    with station.database.reading() as session:
        assert identifications.find(session) == []


def test_unsafe_settings_are_rejected_before_the_control_loop_starts(tmp_path: Path) -> None:
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


# An interrupted experiment stores its samples, passes no criterion, and its report names what is missing.

ENDINGS: dict[str, tuple[Command, str]] = {
    "a stop": (Stop(), "stopped"),
    "a soft stop as the operator is lost": (Stop(Fault.OPERATOR_LOST, hard=False), "link_lost"),
    "a trip": (Inject(InjectedFault(InjectedFaultKind.SAFETY_TRIP)), "tripped"),
}
AFTER_S = {
    "tracking": 20.0,
    "compliance": 34.0,
    "step_battery": 40.0,
    "stiffness_sweep": 30.0,
    "lambda_sweep": 30.0,
    "motion_comparison": 20.0,
    "bank_comparison": 35.0,
    "disturbance_battery": 30.0,
    "frequency_response": 60.0,
    "hold_at_rest": 45.0,
    "impact": 20.0,
}
"""Some time in the program of each that is ready-made [s], after the first figure can be had."""

TOO_EARLY = {
    "robustness": (9.0, analysis_messages.loads_not_completed()),
    "disturbance_battery": (8.0, analysis_messages.pushes_not_completed()),
}
"""Some time [s] before it, and the reason for which there is no figure then."""


@dataclass
class Interruption:
    """Sends a command at a set progress of the program; is called with the progress of the run."""

    station: ExperimentRig
    command: Command
    after_s: float
    sent: "asyncio.Task[object] | None" = None

    def __call__(self, doing: RunPhase, elapsed_s: float) -> None:
        if doing is RunPhase.PROGRAM and elapsed_s > self.after_s and self.sent is None:
            self.sent = asyncio.get_running_loop().create_task(self.station.loop.send(self.command))


def interrupted(tmp_path_factory: pytest.TempPathFactory, name: str, command: Command, after_s: float) -> RunData:
    database = open_database(tmp_path_factory.mktemp("interrupted"))
    with open_headless_rig(database, load_parameters("ideal"), LoopSettings()) as station:
        order = RunRequest(build_ready_plan(name), LoopSettings(), "A. Operator")
        outcome = asyncio.run(run_experiment(station, order, Interruption(station, command, after_s)))
    source = load_source(database, outcome.run.id)
    database.close()
    return source


PAIRS = [("tracking", ending) for ending in ENDINGS] + list(zip(list(AFTER_S)[1:], cycle(ENDINGS), strict=False))
"""One kind with each ending, the others with one each, in turn: how a run ends and what it plays know nothing of each
other."""


def test_the_interruption_tests_cover_every_ready_made_experiment_and_every_ending() -> None:
    assert {*AFTER_S, *TOO_EARLY} == set(library.READY_NAMES)
    assert {name for name, _ in PAIRS} == set(AFTER_S)
    assert min(Counter(ending for _, ending in PAIRS).values()) > 2


@pytest.mark.parametrize(("name", "ending"), PAIRS)
def test_an_interrupted_run_has_its_samples_and_names_what_is_missing(
    tmp_path_factory: pytest.TempPathFactory, name: str, ending: str
) -> None:
    command, end_state = ENDINGS[ending]
    source = interrupted(tmp_path_factory, name, command, AFTER_S[name])
    assert source.run.end_state == end_state
    played = source.columns["t"].size
    assert 1000 * AFTER_S[name] <= played < 1000 * build_ready_plan(name).program().duration_s
    result = source.result
    assert result is not None
    assert not result.metrics.complete
    assert [item.title for item in result.criteria if item.passed] == []
    assert all(item.reason for item in result.metrics.figures if item.value is None)
    report = build_report(source)
    assert report.outcome == "incomplete"
    assert f"s of {build_ready_plan(name).program().duration_s:.6g} s were executed" in report.verdict
    assert verify_report(to_html(report), source.columns) == Verified((), ())


@pytest.mark.parametrize("ending", ENDINGS)
@pytest.mark.parametrize("name", TOO_EARLY)
def test_a_run_without_measurements_has_a_reason(
    tmp_path_factory: pytest.TempPathFactory, name: str, ending: str
) -> None:
    (after_s, reason), (command, end_state) = TOO_EARLY[name], ENDINGS[ending]
    source = interrupted(tmp_path_factory, name, command, after_s)
    assert source.run.end_state == end_state
    assert source.columns["t"].size >= 1000 * after_s
    assert source.result is None
    report = build_report(source)
    assert report.outcome == "incomplete"
    assert report.verdict == f"No result: {reason}."
    assert verify_report(to_html(report), source.columns) == Verified((), ())


# The start of an experiment: compliance first moves the joint to 0, and the forecast contains the time for it.

PLAN = build_ready_plan("compliance", profile="steps", hold_s=0.5, F_push=10.0)


@pytest.fixture
def station_homing(tmp_path: Path) -> Iterator[ExperimentRig]:
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


def test_compliance_off_centre_moves_to_zero_first_and_takes_the_forecast_time(
    station_homing: ExperimentRig,
) -> None:
    async def work() -> tuple[RunResult, float, float]:
        await brought_off_centre(station_homing)
        start = read_initial_state(station_homing.loop.ring.newest())
        assert start.q == pytest.approx(math.radians(15.0), abs=0.02)
        forecast_s, began = (
            forecast_duration(PLAN, station_homing.parameters, start).duration_s,
            station_homing.loop.ring.count,
        )
        outcome = await run_experiment(station_homing, RunRequest(PLAN, LoopSettings(), "A. Operator"))
        return outcome, forecast_s, (station_homing.loop.ring.count - began) / 1000.0

    outcome, forecast_s, took_s = asyncio.run(work())
    assert outcome.run.end_state == "completed"
    columns, _ = read_recorded_columns(station_homing.database, outcome.run.id)
    lead_in = slice(0, round(LEAD_IN_S * 1000))
    assert np.abs(columns["q"][lead_in]).max() < 0.01
    # The motion from 10 N to S_ref = 10 N·m/rad ends at 17.4 N; no other motion precedes the first push.
    assert max(columns[name][lead_in].max() for name in ("F_A", "F_B")) < 18.5
    assert forecast_s == pytest.approx(took_s, abs=0.4)


# Identification of motors and springs through the loop, on a plant with known constants.

MOTOR = MotorIdentificationPlan(u_low=2.0, u_high=5.0, levels=2)
SPRING = SpringIdentificationPlan(sweep_s=5.0, cycles=1)


@pytest.fixture(scope="module")
def lab() -> PlantParameters:
    return load_parameters("lab")


@pytest.fixture(scope="module")
def station_unloaded(lab: PlantParameters, tmp_path_factory: pytest.TempPathFactory) -> Iterator[ExperimentRig]:
    database = open_database(tmp_path_factory.mktemp("unloaded"))
    with open_headless_rig(database, lab, LoopSettings(seed=2)) as made:
        yield made
    database.close()


def order(plan: MotorIdentificationPlan | SpringIdentificationPlan) -> RunRequest:
    return RunRequest(plan, LoopSettings(seed=2), "A. Operator")


def test_voltage_steps_identify_the_simulated_motors(station_unloaded: ExperimentRig, lab: PlantParameters) -> None:
    outcome = asyncio.run(run_experiment(station_unloaded, order(MOTOR)))
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
        # Coulomb friction reduces the gain that the rule finds.
        assert 0.95 < model["rule_mean"]["K_m"] / model["parameters"]["K_m"] < 0.99
        assert not found.quality[side]["refused"]
    figures = {item.name: item.value for item in result.metrics.figures if item.value is not None}
    assert figures["K_m_A"] == found.model["A"]["parameters"]["K_m"]
    assert figures["turn_rad"] < 15.7
    assert figures["load_N"] < 0.5
    predicted = predict_motor(MOTOR, lab)
    assert predicted.is_feasible
    columns, _ = read_recorded_columns(station_unloaded.database, outcome.run.id)
    loose = np.minimum(columns["F_A"], columns["F_B"]) < 0.1  # N: slack, except for noise
    assert np.count_nonzero(loose) > 10_000
    assert np.isnan(columns["S"][loose]).mean() > 0.99
    assert np.nanmin(columns["S"]) > 0.0  # computed from angles alone, the minimum would be -13
    report = build_report(load_source(station_unloaded.database, outcome.run.id))
    assert (report.outcome, report.verdict) == ("passed", found.verdict)
    assert "2.884" in to_html(report)
    assert to_pdf(report).startswith(b"%PDF-")


def test_a_load_sweep_identifies_the_simulated_springs(station_unloaded: ExperimentRig, lab: PlantParameters) -> None:
    outcome = asyncio.run(run_experiment(station_unloaded, order(SPRING)))
    found, result = outcome.evaluation.identification, outcome.evaluation.result
    assert found is not None, outcome.evaluation.problem
    assert result is not None
    springs = {"A": lab.make_dynamics().spring_A, "B": lab.make_dynamics().spring_B}
    for side, spring in springs.items():
        model = found.model[side]
        assert model["recommended"] == 2
        assert [fit["order"] for fit in model["fits"]] == [2, 3, 5]
        k = next(fit["k"] for fit in model["fits"] if fit["order"] == 2)
        # The elongation refers to the zero of pretension, which depends on the previous spring parameters.
        x = np.linspace(0.015, 0.055, 30)
        fitted = np.polyval(k[::-1], x)
        shift = np.linspace(-5e-4, 5e-4, 101)
        true = np.array([[tendon_tension(spring, value + moved) for value in x] for moved in shift])
        assert np.min(np.max(np.abs(true - fitted), axis=1)) < 0.1
    figures = {item.name: item.value for item in result.metrics.figures if item.value is not None}
    # The delay of the load cells separates both directions by 2 x rate x delay: 2 x 8.6 N/s x 12 ms on average.
    assert 0.1 < figures["hysteresis_N"] < 0.5
    assert figures["max_tension_N"] == pytest.approx(45.0, abs=2.0)
    assert predict_spring(SPRING, lab).is_feasible


def test_an_interrupted_motor_identification_has_data_and_no_model(station_unloaded: ExperimentRig) -> None:
    async def perform() -> str:
        stopped = False
        waiting = []

        def notify(doing: RunPhase, elapsed_s: float) -> None:
            nonlocal stopped
            if doing is RunPhase.PROGRAM and elapsed_s > 1.0 and not stopped:
                stopped = True
                waiting.append(asyncio.ensure_future(station_unloaded.loop.send(Stop(hard=False))))

        outcome = await run_experiment(station_unloaded, order(SPRING), notify)
        assert outcome.evaluation.identification is None
        assert outcome.evaluation.result is not None
        assert outcome.evaluation.result.metrics.played_s > 1.0
        return outcome.evaluation.problem

    before = len(_stored(station_unloaded))
    assert asyncio.run(perform()) == incomplete_run_without_model(end_state="stopped")
    assert len(_stored(station_unloaded)) == before


def test_motor_steps_in_saturation_or_under_load_are_rejected_individually(lab: PlantParameters) -> None:
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
    assert_reason(cut.refused[0][1], "step_saturates", voltage_V=pytest.approx(10.0))
    assert_reason(cut.refused[1][1], "motor_is_loaded")
    with pytest.raises(ValueError, match=r"^motor A: ") as caught:
        identify_motors(columns, lab)
    unusable = tuple(reason for _, reason in cut.refused)
    assert_reason(caught.value.args[0], "motor_not_identified", side="A", unusable_steps=unusable)
    assert_reason(caught.value.args[0].values["reason"], "too_few_voltages")


def test_forecasts_report_infeasible_settings_before_motion(lab: PlantParameters) -> None:
    hasty = predict_motor(MotorIdentificationPlan(u_high=9.0, travel_rad=6.0), lab)
    assert not hasty.is_feasible
    assert_reason(hasty.message, "step_too_short", u_high=9.0)
    high = predict_spring(SpringIdentificationPlan(F_high=47.0), lab)
    assert high.is_feasible
    with pytest.raises(OutOfRangeError) as caught:
        build_plan(MotorIdentificationPlan, {"u_low": 6.0, "u_high": 4.0})
    assert (caught.value.quantity, caught.value.value, caught.value.maximum) == ("u_low", 6.0, 4.0)
    with pytest.raises(OutOfRangeError, match=r"reverses, .*: 49 N is outside 20 to 47 N"):
        build_plan(SpringIdentificationPlan, {"F_high": "49"})


def test_an_identification_from_a_measured_table_stores_the_digest_of_the_table() -> None:
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
