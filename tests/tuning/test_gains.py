"""Gains by the formulas of the paper, and predictions from the geometry."""

import math

import numpy as np
import pytest

from backend.control.decoupler import Decoupler, stiffness_slope
from backend.tuning.gains import (
    TuningError,
    make_motor_loops,
    motor_gains,
    outer_gains,
    position_loop_gain,
    printed_outer_gains,
    stiffness_loop_gain,
)
from backend.tuning.robustness import linearize_one_motor
from plant.parameters import load_parameters
from tests.refusals import refused

# Table 2 with its erratum: gains at the numbers of the paper, poles, continuity, rejections.

K_m, T_m = 2.86, 0.22


@pytest.mark.parametrize("lam", [0.0258, 0.0854, 0.2, 0.5])
def test_motor_loop_has_four_equal_poles(lam: float) -> None:
    k_p, k_i, k_d, t_f = motor_gains(K_m, T_m, lam)
    # s² (T_m s + 1)(t_f s + 1) + K_m (k_d s² + k_p s + k_i), to be K_m k_i (λ s + 1)^4.
    characteristic = np.array([T_m * t_f, T_m + t_f, 1.0 + K_m * k_d, K_m * k_p, K_m * k_i])
    wanted = K_m * k_i * np.array([lam**4, 4 * lam**3, 6 * lam**2, 4 * lam, 1.0])
    assert characteristic == pytest.approx(wanted, rel=1e-12)


@pytest.mark.parametrize(("K", "T", "lam"), [(0.0498, 0.64, 0.2), (1.0, 0.342, 0.5), (1.17, 0.57, 1.0)])
def test_outer_loop_has_two_equal_poles(K: float, T: float, lam: float) -> None:
    k_p, k_i, _ = outer_gains(K, T, lam)
    characteristic = np.array([T, 1.0 + K * k_p, K * k_i])
    assert characteristic == pytest.approx(T / lam**2 * np.array([lam**2, 2.0 * lam, 1.0]), rel=1e-12)


def test_printed_formula_leaves_a_slow_pole_at_ten_newton() -> None:
    K, T, lam = 0.0498, 0.64, 0.2
    k_p, k_i, _ = printed_outer_gains(K, T, lam)
    poles = np.roots([T, 1.0 + K * k_p, K * k_i])
    assert max(poles.real) == pytest.approx(-1.6, abs=0.1)


def test_the_outer_law_beyond_two_T_is_integral_and_continuous() -> None:
    T = 0.342
    at, beyond = outer_gains(1.0, T, 2.0 * T), outer_gains(1.0, T, 2.0 * T * (1.0 + 1e-9))
    assert at.k_p == pytest.approx(0.0, abs=1e-12)
    assert beyond.k_p == 0.0
    assert beyond.k_i == pytest.approx(at.k_i, rel=1e-6)
    far = outer_gains(1.0, T, 3.0)
    # Sum of lags of 1/(T s² + s + k_i)·k_i is 1/k_i = 2 λ.
    assert 1.0 / far.k_i == pytest.approx(6.0)


def test_reference_weight_acts_on_the_reference_only() -> None:
    plain, weighted = outer_gains(1.0, 0.342, 0.4), outer_gains(1.0, 0.342, 0.4, b=0.5)
    assert weighted.k_r == pytest.approx(0.5 * plain.k_p)
    assert (weighted.k_p, weighted.k_i) == (plain.k_p, plain.k_i)


def test_loop_gains_through_the_decoupler_are_one_at_the_geometric_gains() -> None:
    r_m, r_j, k_2 = 7.5e-3, 75e-3, 8543.8
    assert position_loop_gain(r_m / (2.0 * r_j), r_m, r_j) == pytest.approx(1.0)
    decoupler = Decoupler(r_m, r_j, -2.498, 331.49, k_2)
    assert stiffness_loop_gain(2.0 * r_j**2 * k_2 * r_m, stiffness_slope(decoupler, 10.0)) == pytest.approx(1.0)


@pytest.mark.parametrize("bad", [0.0, -1.0, math.nan, math.inf])
def test_invalid_model_parameters_are_rejected_with_their_symbol(bad: float) -> None:
    with refused(TuningError, "not_positive", symbol="λ_motor", unit="s"):
        motor_gains(K_m, T_m, bad)
    with refused(TuningError, "not_positive", symbol="K"):
        outer_gains(bad, 0.342, 0.5)
    with refused(TuningError, "not_positive", symbol="T"):
        outer_gains(1.0, bad, 0.5)
    with refused(TuningError, "not_positive", symbol="λ"):
        outer_gains(1.0, 0.342, bad)


def test_a_motor_loop_that_is_too_slow_is_rejected_with_its_bound() -> None:
    with refused(TuningError, "motor_loop_too_slow", lam_motor=0.9, maximum_s=pytest.approx(0.88)):
        motor_gains(K_m, T_m, 0.9)
    with refused(TuningError, "weight_out_of_range", b=1.5):
        outer_gains(1.0, 0.342, 0.5, b=1.5)


# Gains and lags from geometry, springs and motor loops, compared with closed forms for equal quadratic springs.
#
# The motor loops cause four lags λ, and the joint lags by B_j/S. A higher tendon force turns its motor back until the
# integral compensates it: both sides lag by r_m² F'/(2 K_t k_i), which does not affect q and delays S twice.


@pytest.mark.parametrize("S", [8.24, 10.55, 14.06])
@pytest.mark.parametrize("lam_motor", [0.06, 0.0854])
def test_gains_and_lags_match_the_closed_form(S: float, lam_motor: float) -> None:
    parameters = load_parameters("ideal")
    g, known, K_t = parameters.geometry, parameters.identified, parameters.motor.K_t
    found = linearize_one_motor(parameters, make_motor_loops(parameters, lam_motor), S)
    assert found.K_q == pytest.approx(g.r_m / (2.0 * g.r_j), rel=1e-6)
    assert pytest.approx(2.0 * g.r_j**2 * known.k[2] * g.r_m, rel=1e-6) == found.K_S
    assert found.T_q == pytest.approx(4.0 * lam_motor + g.B_j / S, rel=1e-6)
    k_i = known.T_m**2 / (known.K_m * lam_motor**3 * (4.0 * known.T_m - lam_motor))
    slope = S / (2.0 * g.r_j**2)
    assert pytest.approx(4.0 * lam_motor + g.r_m**2 * slope / (K_t * k_i), rel=1e-6) == found.T_S
