"""The inner loop against its closed form 1/(λ s + 1)^4, and its bumpless changes."""

import math

import numpy as np
import pytest

from backend.control import pid
from backend.tuning.gains import motor_gains
from plant.interface import T_s

K_m, T_m = 2.86, 0.22


def motor(theta: float, omega: float, u: float) -> tuple[float, float]:
    """One exact zero-order-hold period of K_m/(s (T_m s + 1))."""
    decay = math.exp(-T_s / T_m)
    final = K_m * u
    theta += final * T_s + (omega - final) * T_m * (1.0 - decay)
    return theta, final + (omega - final) * decay


def step_response(lam: float, ticks: int, u_max: float = 1e9) -> np.ndarray:
    gains = motor_gains(K_m, T_m, lam)
    state = pid.at_rest_i_pd(gains, 0.0, 0.0)
    theta = omega = 0.0
    response = np.empty(ticks)
    for k in range(ticks):
        response[k] = theta
        u, _, state = pid.step_i_pd(gains, state, 1.0, theta, u_max)
        theta, omega = motor(theta, omega, u)
    return response


@pytest.mark.parametrize("lam", [0.0258, 0.0854, 0.2])
def test_step_response_is_four_equal_lags(lam: float) -> None:
    t = np.arange(3000) * T_s
    x = t / lam
    closed_form = 1.0 - np.exp(-x) * (1.0 + x + x**2 / 2.0 + x**3 / 6.0)
    # The error shows one period later in the integral, and half a period later through the hold and through the
    # filter: the sampled loop may lag by 2.5 ms of the steepest slope, 0.224/λ, and by no more.
    assert np.max(np.abs(step_response(lam, 3000) - closed_form)) < 2.5e-3 * 0.224 / lam


def test_clipped_loop_recovers_without_winding_up() -> None:
    response = step_response(0.0854, 4000, u_max=0.5)
    assert response[-1] == pytest.approx(1.0, abs=1e-3)
    assert response.max() < 1.05


def test_change_of_gains_does_not_show_in_its_tick() -> None:
    before, after = motor_gains(K_m, T_m, 0.0854), motor_gains(K_m, T_m, 0.15)
    state = pid.IPDState(1.3, 1.1, 0.4)
    u_before, _, _ = pid.step_i_pd(before, state, 2.0, 0.5, 10.0)
    u_after, _, _ = pid.step_i_pd(after, pid.bumpless_i_pd(before, after, state, 0.5), 2.0, 0.5, 10.0)
    assert u_after == pytest.approx(u_before, abs=1e-12)


def test_moved_zero_does_not_show_in_the_voltage() -> None:
    gains = motor_gains(K_m, T_m, 0.0854)
    state = pid.IPDState(1.3, 1.1, 0.4)
    u_before, _, _ = pid.step_i_pd(gains, state, 2.0, 0.5, 10.0)
    u_after, _, _ = pid.step_i_pd(gains, pid.shift_i_pd(gains, state, 0.25), 2.25, 0.75, 10.0)
    assert u_after == pytest.approx(u_before, abs=1e-12)


def test_rest_state_holds_its_voltage() -> None:
    gains = motor_gains(K_m, T_m, 0.0854)
    state = pid.at_rest_i_pd(gains, 3.0, 0.25)
    for _ in range(100):
        u, excess, state = pid.step_i_pd(gains, state, 3.0, 3.0, 10.0)
        assert u == pytest.approx(0.25, abs=1e-12)
        assert excess == 0.0


@pytest.mark.parametrize("k", [3, 400])
def test_a_motor_that_rests_is_held_where_it_stands(k: int) -> None:
    """By 1 + HOLDS times k_p, whatever its reference is, and with the same voltage on entering and on leaving."""
    gains, delta = motor_gains(K_m, T_m, 0.0854), 0.01
    state = pid.at_rest_i_pd(gains, 3.0, 0.25)
    first, _, state = pid.step_i_pd(gains, state, 3.5, 3.0, 10.0, resting=True)
    assert first == pytest.approx(0.25, abs=1e-12)
    for _ in range(k):
        before = state
        u, _, state = pid.step_i_pd(gains, state, 3.5, 3.0 + delta, 10.0, resting=True)
    left, _, _ = pid.step_i_pd(gains, before, 3.5, 3.0 + delta, 10.0)
    assert left == u
    if k > 300:
        assert u == pytest.approx(0.25 - (1.0 + pid.HOLD_GAIN) * gains.k_p * delta, abs=1e-6)


def test_a_motor_that_rests_without_friction_is_damped() -> None:
    """Pushed off by 0.01 rad it swings to the other side by 0.6 of that at most, and comes to rest."""
    gains = motor_gains(K_m, T_m, 0.0854)
    state = pid.at_rest_i_pd(gains, 0.0, 0.0)
    theta, omega, path = 0.01, 0.0, np.empty(2000)
    for k in range(path.size):
        path[k] = theta
        u, _, state = pid.step_i_pd(gains, state, 0.0, theta, 10.0, resting=True)
        theta, omega = motor(theta, omega, u)
    assert path.min() > -0.6 * path[0]
    assert np.max(np.abs(path[1000:])) < 1e-4
