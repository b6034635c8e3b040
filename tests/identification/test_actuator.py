"""Identification of the actuator, on linear systems and on the simulator."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lsim, max_len_seq

from backend.control.decoupler import build_decoupler, stiffness_slope
from backend.experiments.plans import ActuatorIdentificationPlan
from backend.identification import messages
from backend.identification.actuator import STRUCTURES, ActuatorGeometry, ActuatorIdentification, identify_actuator
from backend.identification.estimation import estimate_model
from backend.identification.fitting import Method
from backend.identification.models import TABLE_1, Estimate, Grade
from backend.identification.records import Record
from backend.tuning.gains import LAM_MOTOR, make_motor_loops
from backend.tuning.robustness import decoupled_model, linearize_one_motor
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters
from tests.docs.figures.identification_page import default_plan, paper_plan
from tests.docs.figures.identification_runs import Bench
from tests.identification.verdicts import find_reason, list_codes

# The default experiment on a linear system, simulated independently of the estimator.

GEOMETRY = ActuatorGeometry(r_m=0.0075, r_j=0.075, k2=8543.8)
PERIOD_S = 1e-3
LAG_S = 0.0854
START = 1000


def test_the_resolutions_follow_from_the_counts_of_the_encoders() -> None:
    assert 4000 * GEOMETRY.q_resolution == pytest.approx(2.0 * np.pi)
    # One count (1/8000 revolution) of motor A elongates its spring by r_m times the angle and stiffens the joint.
    assert 8000 * GEOMETRY.S_resolution == pytest.approx(2.0 * 0.075**2 * 8543.8 * 0.0075 * 2.0 * np.pi)


def default_experiment(amplitude_rad: float = 1.0, chip: int = 80) -> dict[str, np.ndarray]:
    chips = np.repeat(2.0 * max_len_seq(7)[0] - 1.0, chip)
    u = np.concatenate((np.zeros(START), amplitude_rad * np.tile(chips, 2)))
    t = np.arange(u.size) * PERIOD_S
    theta = lsim(([1.0], np.poly(np.full(4, -1.0 / LAG_S)) * LAG_S**4), u, t, interp=False)[1]
    count_q, count_theta = 2 * np.pi / 4000, 2 * np.pi / 8000
    q = np.round((0.4 + 0.05 * theta) / count_q) * count_q
    S = 8.24 + 0.721 * np.round(theta / count_theta) * count_theta
    return {"theta_A_ref": 8.0 + u, "q": q, "S": S}


@pytest.fixture(scope="module")
def found() -> ActuatorIdentification:
    return identify_actuator(default_experiment(), PERIOD_S, GEOMETRY, START)


def test_default_experiment_gives_gains_lags_and_rest_point(found: ActuatorIdentification) -> None:
    for reduced, gain in ((found.G_q.first_order, 0.05), (found.G_S.first_order, 0.721)):
        np.testing.assert_allclose((reduced.K, reduced.T), (gain, 4 * LAG_S), rtol=5e-3)
    assert found.S_nominal == pytest.approx(8.24, abs=1e-3)
    assert found.q_nominal == pytest.approx(0.4, abs=2e-3)
    assert found.verdict.grade is Grade.USABLE


@pytest.mark.parametrize("start", [0, 1, 7, 499, 501, 1000])
def test_the_nominal_point_is_the_mean_of_the_half_second_before_the_excitation(start: int) -> None:
    """With less than half a second the mean starts at the first sample; without any, the point is that sample."""
    samples = default_experiment()
    # The square of the index marks every sample in the mean.
    samples["S"] = samples["S"] + 1e-9 * np.arange(samples["S"].size) ** 2
    found = identify_actuator(samples, PERIOD_S, GEOMETRY, start, ("first",))
    before = range(max(start - 500, 0), max(start, 1))
    assert found.S_nominal == pytest.approx(sum(samples["S"][k] for k in before) / len(before), rel=1e-12)
    assert found.q_nominal == pytest.approx(sum(samples["q"][k] for k in before) / len(before), rel=1e-12)


def test_the_papers_arx_estimate_is_added_and_equals_the_estimate_from_a_file(found: ActuatorIdentification) -> None:
    samples = default_experiment()
    for by_arx, column in ((found.arx_q, "q"), (found.arx_S, "S")):
        assert isinstance(by_arx, Estimate)
        alone = estimate_model(
            Record(PERIOD_S, samples["theta_A_ref"][START:], samples[column][START:]), "first", Method.ARX
        )
        assert by_arx.method == alone.method == messages.arx_with_prefilter()
        assert by_arx.first_order == alone.first_order


def test_the_verdict_states_too_little_motion_in_counts() -> None:
    found = identify_actuator(default_experiment(amplitude_rad=0.5, chip=5), PERIOD_S, GEOMETRY, START)
    assert found.verdict.grade is Grade.UNUSABLE
    assert find_reason(found.verdict, "too_little_motion")["counts"] == pytest.approx(found.motion_counts)


# The default experiment on the simulator, compared with geometry and with the numerically linearized plant.

OMEGA = np.geomspace(0.05, 5.0, 30)
SUM_OF_LAGS_S = 0.342
GAIN_S = 0.721


def identified(bench: Bench, parameters: PlantParameters, plan: ActuatorIdentificationPlan) -> ActuatorIdentification:
    g = parameters.geometry
    geometry = ActuatorGeometry(
        g.r_m, g.r_j, stiffness_slope(build_decoupler(parameters), 10.0) / (2.0 * g.r_j**2 * g.r_m)
    )
    return identify_actuator(bench.play(plan), T_s, geometry, 0, STRUCTURES[:2])


def candidate(found: ActuatorIdentification, channel: str, structure: str) -> Estimate:
    ranked = (found.candidates_q if channel == "q" else found.candidates_S).ranked
    return next(estimate for estimate in ranked if estimate.model.structure == structure)


def linearized(parameters: PlantParameters, S: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the responses at OMEGA from the reference of one motor to q and S.

    Both sides are equal, so one motor alone has half the effect of both through the decoupler.
    """
    model = decoupled_model(parameters, make_motor_loops(parameters, LAM_MOTOR), S)
    through_decoupler = model(1j * OMEGA)
    g = parameters.geometry
    return through_decoupler[0, 0] * g.r_m / (2.0 * g.r_j), through_decoupler[1, 1] * GAIN_S


@pytest.fixture(scope="module")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


@pytest.fixture(scope="module")
def ideal_runs(ideal: PlantParameters) -> dict[float, ActuatorIdentification]:
    bench = Bench(ideal)
    return {tension: identified(bench, ideal, default_plan(tension)) for tension in TABLE_1}


@pytest.fixture(scope="module", params=["lab", "lab without friction"])
def lab_bench(request: pytest.FixtureRequest) -> Bench:
    lab = load_parameters("lab")
    without = replace(lab, motor=replace(lab.motor, c0=0.0, c1=0.0))
    return Bench(lab if request.param == "lab" else without)


@pytest.mark.parametrize("tension", [20.0, 40.0])
def test_G_S_has_the_gain_and_lag_of_linear_theory(lab_bench: Bench, tension: float) -> None:
    """With the sensors of `lab`, friction adds to the residual of the linear model, not to gain and lag."""
    lab = load_parameters("lab")
    record = lab_bench.play(default_plan(tension))
    theory = linearize_one_motor(lab, make_motor_loops(lab, LAM_MOTOR), float(np.mean(record["S"])))
    found = estimate_model(Record(T_s, record["theta_A_ref"], record["S"]), "order:4").first_order
    assert pytest.approx(theory.K_S, rel=2e-3) == found.K
    assert pytest.approx(theory.T_S, rel=6e-3) == found.T


def test_G_S_agrees_with_linear_theory_over_fifty_seeds() -> None:
    """Mean over 50 seeds of the sensors' noise, without friction: gain within 0.2 %, sum of lags within 0.5 %."""
    lab = load_parameters("lab")
    without = replace(lab, motor=replace(lab.motor, c0=0.0, c1=0.0))
    off: dict[float, list[tuple[float, float]]] = {tension: [] for tension in TABLE_1}
    for seed in range(50):
        bench = Bench(without, seed)
        for tension, ratios in off.items():
            record = bench.play(default_plan(tension))
            theory = linearize_one_motor(without, make_motor_loops(without, LAM_MOTOR), float(np.mean(record["S"])))
            found = estimate_model(Record(T_s, record["theta_A_ref"], record["S"]), "order:4").first_order
            ratios.append((found.K / theory.K_S, found.T / theory.T_S))
    for ratios in off.values():
        gain, lag = np.mean(ratios, axis=0)
        assert gain == pytest.approx(1.0, abs=2e-3)
        assert lag == pytest.approx(1.0, abs=5e-3)


@pytest.mark.parametrize("tension", TABLE_1)
def test_gains_lags_and_frequency_response_of_the_ideal_plant_are_accurate(
    ideal: PlantParameters, ideal_runs: dict[float, ActuatorIdentification], tension: float
) -> None:
    found = ideal_runs[tension]
    G_q, G_S = found.G_q, found.G_S
    assert found.verdict.grade is Grade.USABLE
    assert candidate(found, "q", "lags4").model.gain == pytest.approx(0.05, rel=0.01)
    assert G_q.model.gain == pytest.approx(0.05, rel=0.002)
    assert candidate(found, "S", "order:4").model.gain == pytest.approx(GAIN_S, rel=0.01)
    for model, truth in zip((G_q, G_S), linearized(ideal, TABLE_1[tension].S), strict=True):
        assert pytest.approx(SUM_OF_LAGS_S, rel=0.05) == model.first_order.T
        ratio = model.model.response(OMEGA) / truth
        assert np.max(np.abs(np.abs(ratio) - 1.0)) < 0.03
        assert np.max(np.abs(np.degrees(np.angle(ratio)))) < 3.0


def test_the_verdict_on_the_lab_plant_warns_that_friction_makes_the_model_local() -> None:
    lab = load_parameters("lab")
    found = identified(Bench(lab), lab, default_plan(20.0))
    assert found.verdict.grade is Grade.CAUTION
    assert "motion_unexplained" in list_codes(found.verdict)
    for channel, gain in ((found.G_q, 0.05), (found.G_S, GAIN_S)):
        assert channel.model.gain == pytest.approx(gain, rel=0.03)


def test_the_verdict_on_the_papers_1_ms_sequence_states_too_little_motion() -> None:
    lab = load_parameters("lab")
    found = identified(Bench(lab), lab, paper_plan(20.0))
    assert found.verdict.grade is Grade.UNUSABLE
    assert found.motion_counts < 10.0
    assert find_reason(found.verdict, "too_little_motion")["counts"] == pytest.approx(found.motion_counts)
