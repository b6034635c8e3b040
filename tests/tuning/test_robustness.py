"""Sensitivity peaks compared with the values of the method page (errata E5, E6) and with brute force."""

import control
import numpy as np
import pytest

from backend.control.decoupler import build_decoupler, motor_positions
from backend.tuning.gains import (
    LAM_MAX,
    MotorModel,
    TuningError,
    TuningParameters,
    designed_point,
    make_motor_loops,
    motor_gains,
    outer_gains,
    position_gains,
    stiffness_gains,
)
from backend.tuning.robustness import (
    OuterProcess,
    decoupled_model,
    motor_lambda,
    motor_range,
    motor_robustness,
    peak,
    safe_lambda,
)
from plant.dynamics import tendon_tension
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.refusals import refused

K_m, T_m, TAU_E, LAM = 2.86, 0.22, 2e-3, 0.0854
MOTOR = MotorModel(K_m, T_m, TAU_E)


def exact_loop(omega: np.ndarray, lam: float, tau_e: float) -> np.ndarray:
    """Return the sampled loop as the Poisson sum of the held continuous loop, not from its poles."""
    k_p, k_i, k_d, t_f = motor_gains(K_m, T_m, lam)
    z = np.exp(1j * omega * T_s)
    images = 1j * (omega[:, np.newaxis] + 2.0 * np.pi / T_s * np.arange(-200, 201))
    process = K_m / (images * (T_m * images + 1.0) * (tau_e * images + 1.0))
    held = (process * (1.0 - np.exp(-images * T_s)) / (images * T_s)).sum(axis=1)
    filtered = (1.0 - np.exp(-T_s / t_f)) / (1.0 - np.exp(-T_s / t_f) / z)
    return np.asarray(held * (filtered * (k_p + k_i * T_s / (z - 1.0)) + k_d / t_f * (1.0 - filtered)))


@pytest.mark.parametrize(("lam", "M_s"), [(0.0854, 1.413), (0.05, 1.512), (0.0258, 1.725)])
def test_motor_robustness_matches_the_sampled_loop_with_electrical_lag(lam: float, M_s: float) -> None:
    robustness = motor_robustness(MOTOR, motor_gains(K_m, T_m, lam))
    omega = np.geomspace(1.0, np.pi / T_s, 3000)
    exact = float(np.max(1.0 / np.abs(1.0 + exact_loop(omega, lam, TAU_E))))
    assert robustness.M_s == pytest.approx(exact, rel=1e-5)
    assert robustness.M_s == pytest.approx(M_s, abs=1e-3)
    turn = np.flatnonzero(np.diff(np.sign(exact_loop(omega, lam, TAU_E).imag)))[-1]
    assert robustness.gain_margin == pytest.approx(-1.0 / exact_loop(omega[[turn]], lam, TAU_E).real[0], rel=0.01)


def test_margins_of_the_motor_loop_are_named_by_their_direction() -> None:
    """The gain margin is the factor of a permitted increase; the permitted decrease has its own name."""
    fast = motor_robustness(MOTOR, motor_gains(K_m, T_m, 0.05))
    assert fast.gain_margin == pytest.approx(14.0, abs=0.05)
    assert fast.gain_reduction == pytest.approx(0.0402, abs=5e-4)
    assert np.degrees(fast.phase_margin) == pytest.approx(42.2, abs=0.1)
    papers = motor_robustness(MOTOR, motor_gains(K_m, T_m, LAM))
    assert papers.gain_margin == pytest.approx(24.8, abs=0.1)
    assert papers.gain_reduction == 0.0
    assert np.degrees(papers.phase_margin) == pytest.approx(46.6, abs=0.1)


def test_motor_lambda_inverts_M_s_and_refuses_outside_its_span() -> None:
    for lam in (0.06, LAM, 0.15):
        M_s = motor_robustness(MOTOR, motor_gains(K_m, T_m, lam)).M_s
        assert motor_lambda(MOTOR, M_s) == pytest.approx(lam, abs=1e-6)
    for M_s in (1.2, 1.6):
        lowest, highest = pytest.approx(1.321, abs=5e-4), pytest.approx(1.512, abs=5e-4)
        with refused(TuningError, "M_s_not_attainable", M_s=M_s, lowest=lowest, highest=highest):
            motor_lambda(MOTOR, M_s)


def test_the_smaller_of_two_lambdas_with_equal_M_s_is_returned() -> None:
    """For a fast motor with a slow winding, M_s decreases to 1.41 at λ = 0.15 s and is 1.52 at the largest λ."""
    quick = MotorModel(K_m, 0.05, tau_e=0.01)
    lambdas = np.linspace(*motor_range(quick), 80)
    peaks = [motor_robustness(quick, motor_gains(K_m, 0.05, lam)).M_s for lam in lambdas]
    least = int(np.argmin(peaks))
    assert peaks[-1] > peaks[least] + 0.1
    assert motor_lambda(quick, peaks[-1]) < lambdas[least]
    lowest, lam_lowest = pytest.approx(1.45, abs=0.05), pytest.approx(0.1545, abs=5e-3)
    with refused(TuningError, "M_s_not_attainable", lowest=lowest, lam_lowest=lam_lowest):
        motor_lambda(quick, peaks[least] - 0.01)


@pytest.mark.parametrize(
    ("T_m", "code", "values"),
    [
        (0.012, "motor_too_quick", {"T_m": 0.012, "minimum_s": 0.05}),
        (0.05, "no_robust_motor_loop", {"maximum_s": pytest.approx(0.19), "M_s": 1.7}),
    ],
)
def test_a_motor_without_a_robust_lambda_is_refused(T_m: float, code: str, values: dict[str, object]) -> None:
    with refused(TuningError, code, **values):
        motor_range(MotorModel(K_m, T_m, tau_e=0.05))


@pytest.mark.parametrize("offset", [-0.04, 0.0, 0.03, 0.049])
def test_a_peak_between_grid_points_is_found(offset: float) -> None:
    sensitivity = 2.0 - 0.8 * (np.arange(-0.5, 0.6, 0.1) + offset) ** 2
    assert peak(np.asarray(1.0 / sensitivity.astype(complex) - 1.0, dtype=complex)) == pytest.approx(2.0, rel=1e-12)


@pytest.fixture(scope="module")
def four_lags() -> OuterProcess:
    return OuterProcess(control.tf2ss(1.0 / control.tf([LAM, 1.0], [1.0]) ** 4))


@pytest.mark.parametrize(("lam", "M_s"), [(0.342, 1.74), (0.41, 1.43), (0.51, 1.22)])
def test_outer_loop_on_four_bare_lags(four_lags: OuterProcess, lam: float, M_s: float) -> None:
    assert four_lags.robustness(outer_gains(1.0, 4 * LAM, lam)).M_s == pytest.approx(M_s, abs=0.01)


def test_fast_outer_loop_is_unstable(four_lags: OuterProcess) -> None:
    assert four_lags.robustness(outer_gains(1.0, 4 * LAM, 0.188)).stable
    unstable = four_lags.robustness(outer_gains(1.0, 4 * LAM, 0.182))
    assert not unstable.stable
    assert unstable.M_s == np.inf
    assert (unstable.gain_margin, unstable.gain_reduction, unstable.phase_margin) == (1.0, 1.0, 0.0)


def test_high_order_model_has_unit_gain_and_no_cross_coupling() -> None:
    parameters = load_parameters("lab")
    for S in (8.24, 14.06):
        gain = decoupled_model(parameters, make_motor_loops(parameters, LAM), S).dcgain()
        assert gain == pytest.approx(np.eye(2), abs=1e-6)


def test_safe_range_ends_where_M_s_is_1_7() -> None:
    parameters = load_parameters("ideal")
    point = designed_point(parameters)
    model = decoupled_model(parameters, make_motor_loops(parameters, LAM), point.S_nominal)
    q, S = OuterProcess(model[0, 0]), OuterProcess(model[1, 1])
    lam_q = safe_lambda(q, lambda lam: position_gains(parameters, point, TuningParameters(lam_q=lam)))
    lam_S = safe_lambda(S, lambda lam: stiffness_gains(parameters, point, TuningParameters(lam_S=lam)))
    assert lam_q == pytest.approx(0.355, abs=0.002)
    assert lam_S == pytest.approx(0.345, abs=0.002)
    assert q.robustness(position_gains(parameters, point, TuningParameters(lam_q=lam_q))).M_s == pytest.approx(
        1.7, abs=1e-3
    )


def test_the_safe_range_begins_above_the_largest_lambda_with_excessive_M_s() -> None:
    """M_s may be excessive at a single λ in the middle of the range, so its neighbours do not bound the search."""
    parameters = load_parameters("ideal")
    point = designed_point(parameters)
    model = decoupled_model(parameters, make_motor_loops(parameters, LAM), point.S_nominal)
    lively, calm = (position_gains(parameters, point, TuningParameters(lam_q=lam)) for lam in (0.2, 3.0))
    at = np.geomspace(0.05, LAM_MAX, 60)[30]
    found = safe_lambda(OuterProcess(model[0, 0]), lambda lam: lively if abs(lam / at - 1.0) < 0.01 else calm)
    assert found == pytest.approx(1.01 * at, rel=1e-5)


@pytest.mark.parametrize(("F", "S"), [(10.0, 8.24), (20.0, 10.55), (30.0, 12.43), (40.0, 14.06)])
def test_the_tension_at_a_stiffness_matches_the_papers_nominal_points(F: float, S: float) -> None:
    parameters = load_parameters("ideal")
    theta_A, _ = motor_positions(build_decoupler(parameters), 0.0, S)
    assert tendon_tension(parameters.make_identified_spring("A"), parameters.geometry.r_m * theta_A) == pytest.approx(
        F, abs=0.05
    )
