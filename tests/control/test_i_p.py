"""The outer loop against its closed form 1/(λ s + 1)², and its bumpless changes."""

import math

import numpy as np
import pytest

from backend.control import pid
from backend.tuning.gains import outer_gains, printed_outer_gains
from plant.interface import T_s


def step_response(gains: pid.IPGains, K: float, T: float, ticks: int) -> np.ndarray:
    state = pid.at_rest_i_p(gains, 0.0, 0.0, 0.0)
    y = 0.0
    decay = math.exp(-T_s / T)
    response = np.empty(ticks)
    for k in range(ticks):
        response[k] = y
        u, state = pid.step_i_p(gains, state, 1.0, y, 0.0)
        y = K * u + (y - K * u) * decay
    return response


@pytest.mark.parametrize(("K", "T", "lam"), [(1.0, 0.342, 0.5), (0.98, 2.98, 0.2), (1.17, 0.57, 1.1)])
def test_step_response_is_two_equal_lags(K: float, T: float, lam: float) -> None:
    x = np.arange(8000) * T_s / lam
    closed_form = 1.0 - np.exp(-x) * (1.0 + x)
    assert np.max(np.abs(step_response(outer_gains(K, T, lam), K, T, 8000) - closed_form)) < 2e-3 / lam


def test_printed_formula_overshoots_as_erratum_E1_says() -> None:
    K, T, lam = 0.0491, 2.98, 0.2
    gains = printed_outer_gains(K, T, lam)
    omega = math.sqrt(K * gains.k_i / T)
    zeta = (1.0 + K * gains.k_p) / (2.0 * T * omega)
    overshoot = math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2))
    assert zeta == pytest.approx(0.37, abs=0.005)
    assert 100.0 * overshoot == pytest.approx(28.7, abs=0.05)
    assert 100.0 * (step_response(gains, K, T, 8000).max() - 1.0) == pytest.approx(100.0 * overshoot, abs=0.5)


def test_change_of_gains_of_the_outer_loop_does_not_show_in_its_tick() -> None:
    before, after = outer_gains(1.0, 0.342, 0.6), outer_gains(1.0, 0.342, 0.45, b=1.0)
    state = pid.IPState(0.7)
    u_before, _ = pid.step_i_p(before, state, 1.0, 0.3, 0.0)
    u_after, _ = pid.step_i_p(after, pid.bumpless_i_p(before, after, state, 1.0, 0.3), 1.0, 0.3, 0.0)
    assert u_after == pytest.approx(u_before, abs=1e-15)


def test_reference_step_does_not_kick() -> None:
    gains = outer_gains(1.0, 0.342, 0.5)
    state = pid.at_rest_i_p(gains, 0.0, 0.0, 0.0)
    u, state = pid.step_i_p(gains, state, 1.0, 0.0, 0.0)
    assert u == 0.0
    u, _ = pid.step_i_p(gains, state, 1.0, 0.0, 0.0)
    assert u == pytest.approx(gains.k_i * T_s)
