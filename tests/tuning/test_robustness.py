"""Sensitivity peaks against the figures of the method page (errata E5, E6) and against brute force."""

import control
import numpy as np
import pytest

from backend.tuning.formulas import TuningError, motor_gains, outer_gains
from backend.tuning.gains import motor_loops, position_gains, stiffness_gains
from backend.tuning.linear_model import decoupled_model
from backend.tuning.models import Lambdas, designed_point
from backend.tuning.robustness import OuterProcess, motor_lambda, motor_robustness, safe_lambda
from plant.parameters import load_parameters

K_m, T_m, LAM = 2.86, 0.22, 0.0854


def test_motor_loop_at_the_papers_lambda_has_M_s_1_346() -> None:
    robustness = motor_robustness(K_m, T_m, motor_gains(K_m, T_m, LAM))
    assert robustness.M_s == pytest.approx(1.346, abs=5e-4)
    omega = np.logspace(-1, 4, 200_000)
    k_p, k_i, k_d, t_f = motor_gains(K_m, T_m, LAM)
    s = 1j * omega
    loop = K_m / (s * (T_m * s + 1.0)) * (k_p + k_i / s + k_d * s) / (t_f * s + 1.0)
    assert robustness.M_s == pytest.approx(np.max(1.0 / np.abs(1.0 + loop)), rel=1e-6)


def test_motor_lambda_inverts_M_s_and_refuses_outside_its_span() -> None:
    assert motor_lambda(K_m, T_m, 1.40) == pytest.approx(0.0258, abs=1e-4)
    assert motor_lambda(K_m, T_m, 1.346) == pytest.approx(0.0851, abs=3e-4)
    for M_s in (1.2, 1.5):
        with pytest.raises(TuningError, match=r"1\.300 .* 1\.430"):
            motor_lambda(K_m, T_m, M_s)


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


def test_high_order_model_has_unit_gain_and_no_cross_coupling() -> None:
    parameters = load_parameters("lab")
    for S in (8.24, 14.06):
        gain = decoupled_model(parameters, motor_loops(parameters, LAM), S).dcgain()
        assert gain == pytest.approx(np.eye(2), abs=1e-6)


def test_safe_range_ends_where_M_s_is_1_7() -> None:
    parameters = load_parameters("ideal")
    point = designed_point(parameters)
    model = decoupled_model(parameters, motor_loops(parameters, LAM), point.S_nominal)
    q, S = OuterProcess(model[0, 0]), OuterProcess(model[1, 1])
    lam_q = safe_lambda(q, lambda lam: position_gains(parameters, point, Lambdas(lam_q=lam)))
    lam_S = safe_lambda(S, lambda lam: stiffness_gains(parameters, point, Lambdas(lam_S=lam)))
    assert lam_q == pytest.approx(0.355, abs=0.002)
    assert lam_S == pytest.approx(0.345, abs=0.002)
    assert q.robustness(position_gains(parameters, point, Lambdas(lam_q=lam_q))).M_s == pytest.approx(1.7, abs=1e-3)
