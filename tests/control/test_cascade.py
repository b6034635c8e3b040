"""The cascade: outer and inner loops, schedule, governor and pretension."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from backend.control import cascade, motion_primitives, pid
from backend.control.decoupler import HYSTERESIS, Decoupler, Schedule, interpolate_gains, motor_positions, select_entry
from backend.tuning import simulation
from backend.tuning.gains import TuningParameters, make_cascade_tuning, motor_gains, outer_gains, printed_outer_gains
from plant.interface import T_s
from plant.parameters import load_parameters

# The outer loop against its closed form 1/(λ s + 1)², and its bumpless changes.


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


def test_the_printed_formula_overshoots_as_in_erratum_E1() -> None:
    K, T, lam = 0.0491, 2.98, 0.2
    gains = printed_outer_gains(K, T, lam)
    omega = math.sqrt(K * gains.k_i / T)
    zeta = (1.0 + K * gains.k_p) / (2.0 * T * omega)
    overshoot = math.exp(-math.pi * zeta / math.sqrt(1.0 - zeta**2))
    assert zeta == pytest.approx(0.37, abs=0.005)
    assert 100.0 * overshoot == pytest.approx(28.7, abs=0.05)
    assert 100.0 * (step_response(gains, K, T, 8000).max() - 1.0) == pytest.approx(100.0 * overshoot, abs=0.5)


def test_a_change_of_the_outer_gains_causes_no_step_in_its_tick() -> None:
    before, after = outer_gains(1.0, 0.342, 0.6), outer_gains(1.0, 0.342, 0.45, b=1.0)
    state = pid.IPState(0.7)
    u_before, _ = pid.step_i_p(before, state, 1.0, 0.3, 0.0)
    u_after, _ = pid.step_i_p(after, pid.bumpless_i_p(before, after, state, 1.0, 0.3), 1.0, 0.3, 0.0)
    assert u_after == pytest.approx(u_before, abs=1e-15)


def test_a_reference_step_causes_no_kick() -> None:
    gains = outer_gains(1.0, 0.342, 0.5)
    state = pid.at_rest_i_p(gains, 0.0, 0.0, 0.0)
    u, state = pid.step_i_p(gains, state, 1.0, 0.0, 0.0)
    assert u == 0.0
    u, _ = pid.step_i_p(gains, state, 1.0, 0.0, 0.0)
    assert u == pytest.approx(gains.k_i * T_s)


# The inner loop against its closed form 1/(λ s + 1)^4, and its bumpless changes.

K_m, T_m = 2.86, 0.22


def motor(theta: float, omega: float, u: float) -> tuple[float, float]:
    """One exact zero-order-hold period of K_m/(s (T_m s + 1))."""
    decay = math.exp(-T_s / T_m)
    final = K_m * u
    theta += final * T_s + (omega - final) * T_m * (1.0 - decay)
    return theta, final + (omega - final) * decay


def step_response_i_pd(lam: float, ticks: int, u_max: float = 1e9) -> np.ndarray:
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
    assert np.max(np.abs(step_response_i_pd(lam, 3000) - closed_form)) < 2.5e-3 * 0.224 / lam


def test_a_saturated_loop_recovers_without_windup() -> None:
    response = step_response_i_pd(0.0854, 4000, u_max=0.5)
    assert response[-1] == pytest.approx(1.0, abs=1e-3)
    assert response.max() < 1.05


def test_a_change_of_the_motor_gains_causes_no_step_in_its_tick() -> None:
    before, after = motor_gains(K_m, T_m, 0.0854), motor_gains(K_m, T_m, 0.15)
    state = pid.IPDState(1.3, 1.1, 0.4)
    u_before, _, _ = pid.step_i_pd(before, state, 2.0, 0.5, 10.0)
    u_after, _, _ = pid.step_i_pd(after, pid.bumpless_i_pd(before, after, state, 0.5), 2.0, 0.5, 10.0)
    assert u_after == pytest.approx(u_before, abs=1e-12)


def test_a_moved_zero_causes_no_step_of_the_voltage() -> None:
    gains = motor_gains(K_m, T_m, 0.0854)
    state = pid.IPDState(1.3, 1.1, 0.4)
    u_before, _, _ = pid.step_i_pd(gains, state, 2.0, 0.5, 10.0)
    u_after, _, _ = pid.step_i_pd(gains, pid.shift_i_pd(gains, state, 0.25), 2.25, 0.75, 10.0)
    assert u_after == pytest.approx(u_before, abs=1e-12)


def test_the_rest_state_holds_its_voltage() -> None:
    gains = motor_gains(K_m, T_m, 0.0854)
    state = pid.at_rest_i_pd(gains, 3.0, 0.25)
    for _ in range(100):
        u, excess, state = pid.step_i_pd(gains, state, 3.0, 3.0, 10.0)
        assert u == pytest.approx(0.25, abs=1e-12)
        assert excess == 0.0


@pytest.mark.parametrize("k", [3, 400])
def test_a_resting_motor_is_held_at_its_position(k: int) -> None:
    """By 1 + HOLDS times k_p, for every reference, and with the same voltage at the start and at the end."""
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


def test_a_resting_motor_without_friction_is_damped() -> None:
    """Displaced by 0.01 rad, it swings past by at most 0.6 of that and comes to rest."""
    gains = motor_gains(K_m, T_m, 0.0854)
    state = pid.at_rest_i_pd(gains, 0.0, 0.0)
    theta, omega, path = 0.01, 0.0, np.empty(2000)
    for k in range(path.size):
        path[k] = theta
        u, _, state = pid.step_i_pd(gains, state, 0.0, theta, 10.0, resting=True)
        theta, omega = motor(theta, omega, u)
    assert path.min() > -0.6 * path[0]
    assert np.max(np.abs(path[1000:])) < 1e-4


# The bank's schedule: hysteresis while switching, linear in between while interpolating.

NOMINAL = np.array([8.24, 10.55, 12.43, 14.06])
ENTRIES = np.column_stack([NOMINAL] + [10.0 * column + np.arange(4.0) for column in range(1, 7)])


def test_scheduling_starts_at_the_nearest_bank_entry() -> None:
    switching = Schedule(ENTRIES, interpolate=False)
    for S in np.linspace(7.0, 15.0, 161):
        assert select_entry(switching, -1.0, S) == np.argmin(np.abs(NOMINAL - S))


@pytest.mark.parametrize("S", [9.3, 9.5, 11.4, 11.6, 13.2, 13.3])
def test_a_cascade_after_another_law_starts_at_the_nearest_bank_entry(S: float) -> None:
    parameters = load_parameters("ideal")
    tuning = make_cascade_tuning(parameters, TuningParameters())._replace(schedule=Schedule(ENTRIES, interpolate=False))
    _, state = simulation.at_rest(simulation.make_simulated_rig(parameters), tuning, 0.0, S)
    assert state.active == np.argmin(np.abs(NOMINAL - S))


def test_scheduling_switches_only_beyond_the_hysteresis() -> None:
    switching = Schedule(ENTRIES, interpolate=False)
    border = 0.5 * (8.24 + 10.55)
    assert select_entry(switching, 0.0, border + HYSTERESIS - 1e-6) == 0.0
    assert select_entry(switching, 0.0, border + HYSTERESIS + 1e-6) == 1.0
    assert select_entry(switching, 1.0, border - HYSTERESIS + 1e-6) == 1.0
    assert select_entry(switching, 1.0, border - HYSTERESIS - 1e-6) == 0.0
    assert select_entry(switching, 0.0, 14.9) == 3.0


def test_each_bank_entry_is_selected_at_its_own_stiffness_from_both_sides() -> None:
    """The hysteresis is narrower than the distance from a border to an entry of the paper's bank."""
    switching = Schedule(ENTRIES, interpolate=False)
    for entry, S in enumerate(NOMINAL):
        assert [select_entry(switching, float(active), S) for active in range(4)] == [entry] * 4


def test_scheduling_interpolates_linearly_and_ends_at_the_outer_entries() -> None:
    scheduling = Schedule(ENTRIES, interpolate=True)
    for S in np.linspace(7.0, 15.0, 161):
        place = select_entry(scheduling, -1.0, S)
        assert place == pytest.approx(np.interp(S, NOMINAL, np.arange(4.0)))
        assert [select_entry(scheduling, active, S) for active in (0.0, 1.0, 1.3, 3.0)] == [place] * 4
        gains_q, gains_S = interpolate_gains(scheduling, place)
        expected = [np.interp(S, NOMINAL, ENTRIES[:, column]) for column in range(1, 7)]
        assert [*gains_q[:1], *gains_q[1:], *gains_S] == pytest.approx(expected)


def test_a_single_bank_entry_applies_everywhere() -> None:
    for interpolate in (False, True):
        single = Schedule(ENTRIES[1:2], interpolate)
        assert select_entry(single, -1.0, 14.0) == 0.0
        assert select_entry(single, 0.0, 8.0) == 0.0


# The governor: bounded motor references, both references along one straight line, exact arrival.

D = Decoupler(7.5e-3, 75e-3, -2.498, 331.49, 8543.8)
OMEGA = 20.0


@given(st.floats(-1.4, 1.4), st.floats(8.0, 15.0), st.floats(-1.4, 1.4), st.floats(8.0, 15.0))
def test_the_governor_moves_straight_within_its_bound_and_arrives(
    q_0: float, S_0: float, q_1: float, S_1: float
) -> None:
    state = cascade.GovernorState(q_0, S_0)
    before = np.array(motor_positions(D, q_0, S_0))
    travel = np.max(np.abs(np.array(motor_positions(D, q_1, S_1)) - before))
    ticks = int(np.ceil(travel / (OMEGA * T_s))) + 1
    for _ in range(ticks):
        state, governed = cascade.step_governor(D, OMEGA, state, q_1, S_1)
        now = np.array(motor_positions(D, state.q_ref, state.S_ref))
        assert np.max(np.abs(now - before)) <= OMEGA * T_s * (1.0 + 1e-9)
        # On the line from start to target: the cross product of way gone and way to go vanishes.
        assert (state.q_ref - q_0) * (S_1 - S_0) == pytest.approx((state.S_ref - S_0) * (q_1 - q_0), abs=1e-9)
        before = now
    assert state == cascade.GovernorState(q_1, S_1)
    assert not governed


# Winding up against the linear differential equation that its constants promise, and when it counts as done.

T_S = 1e-3
FROM_SLACK = motion_primitives.PretensionState(0.0, 0.0, 0.0, 0.0, 0.0)


def test_tension_rises_as_filter_and_winding_rate_predict() -> None:
    """0.1 F' = stiffness θ − F,  θ' = 0.15 (5 N − F): the error is too small for the fastest winding."""
    stiffness = np.array([5.5, 11.0])
    state = FROM_SLACK
    for tick in range(1, 4001):
        F_A, F_B = stiffness * (state.theta_A_ref, state.theta_B_ref)
        state = motion_primitives.step_pretension(state, 5.0, F_A, F_B)
        if tick % 500 == 0:
            for k, found in zip(
                stiffness, ((state.F_A, state.theta_A_ref), (state.F_B, state.theta_B_ref)), strict=True
            ):
                rest = np.array([5.0, 5.0 / k])
                expected = rest - expm(np.array([[-10.0, 10.0 * k], [-0.15, 0.0]]) * tick * T_S) @ rest
                assert found == pytest.approx(expected, rel=0.01)


def test_winding_stays_within_its_bound_and_reduces_excess_tension() -> None:
    state = motion_primitives.step_pretension(FROM_SLACK._replace(F_B=40.0), 20.0, 0.0, 40.0)
    assert (state.theta_A_ref, state.theta_B_ref) == pytest.approx((1.5 * T_S, -1.5 * T_S))


def test_pretension_counts_as_steady_only_while_both_tensions_are() -> None:
    right = motion_primitives.PretensionState(10.05, 9.95, 3.0, 3.0, 0.2)
    assert motion_primitives.step_pretension(right, 10.0, 10.05, 9.95).steady_s == pytest.approx(0.201)
    assert motion_primitives.step_pretension(right._replace(F_A=10.2), 10.0, 10.2, 9.95).steady_s == 0.0
    assert motion_primitives.step_pretension(right._replace(F_B=9.8), 10.0, 10.05, 9.8).steady_s == 0.0
