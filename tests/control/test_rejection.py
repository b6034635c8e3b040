"""Feed-forward of the outside force: what it adds, what it tells the position loop, and how it begins and ends."""

import math

import pytest

from backend.control import cascade, disturbance_observer
from backend.control.disturbance_observer import IDLE, DisturbanceFeedforwardState, Rejection
from backend.control.trajectory import LoopReferences
from backend.tuning import simulation
from backend.tuning.gains import MOST_F, UNSEEN_F, TuningParameters, make_cascade_tuning, make_motor_loops, motor_lag
from plant.interface import NOT_MEASURED
from plant.parameters import load_parameters

T_S, R_J, S = 1e-3, 0.075, 12.0
IDEAL = load_parameters("ideal")


def answer_to(
    r: Rejection, tau: float, ticks: int, state: DisturbanceFeedforwardState = IDLE
) -> tuple[DisturbanceFeedforwardState, disturbance_observer.DisturbanceCompensation]:
    state = disturbance_observer.update_gain(r, state, 0.0)
    for _ in range(ticks):
        state = disturbance_observer.step_disturbance_feedforward(r, state, tau)
    return state, disturbance_observer.compute_compensation(state, S)


@pytest.mark.parametrize("k_ext", [0.3, 1.0])
def test_a_push_is_balanced_at_once_and_the_joint_expected_back_behind_four_lags(k_ext: float) -> None:
    """Statics δq_e = −τ/S (equation 14); four equal lags answer a step by 1 − e^{−x}(1 + x + x²/2 + x³/6)."""
    lam, tau = 0.1, 0.4
    r = make_cascade_tuning(IDEAL, TuningParameters(lam_motor=lam), k_ext=k_ext).disturbance_feedforward
    beyond = tau - UNSEEN_F * R_J
    for ticks in (1, 50, 200, 400, 900):
        _, answer = answer_to(r, tau, ticks)
        assert answer.q_e == pytest.approx(-k_ext * beyond / S, rel=1e-12)
        x = T_S * (ticks + 2.0) / lam  # each lag answers in the tick in which it is asked, half a period early
        left = math.exp(-x) * (1.0 + x + x**2 / 2.0 + x**3 / 6.0)
        assert answer.q == pytest.approx(k_ext * beyond / S * left, abs=2e-3 * beyond / S)


@pytest.mark.parametrize("lam", [0.06, 0.0854, 0.15])
def test_the_lags_are_those_that_the_motor_loops_were_given(lam: float) -> None:
    gains = make_motor_loops(IDEAL, lam)
    assert motor_lag(gains.A, IDEAL.select_identified("A").T_m) == pytest.approx(lam, rel=1e-12)
    r = make_cascade_tuning(IDEAL, TuningParameters(lam_motor=lam), k_ext=1.0).disturbance_feedforward
    assert r.lag_decay == pytest.approx(math.exp(-T_S / lam), rel=1e-12)


def test_what_is_small_is_left_and_what_is_large_is_bounded() -> None:
    r = make_cascade_tuning(IDEAL, TuningParameters(), k_ext=1.0).disturbance_feedforward
    for sign in (1.0, -1.0):
        assert answer_to(r, sign * 0.99 * UNSEEN_F * R_J, 500)[1] == (0.0, 0.0)
        assert answer_to(r, sign * 100.0, 1)[1].q_e == pytest.approx(-sign * MOST_F * R_J / S, rel=1e-12)


def test_nothing_is_answered_that_is_not_known_or_not_asked_for() -> None:
    r = make_cascade_tuning(IDEAL, TuningParameters(), k_ext=0.8).disturbance_feedforward
    begun, _ = answer_to(r, 0.4, 100)
    for asked, tau in ((r._replace(k_ext=0.0), 0.4), (r, math.nan)):
        assert disturbance_observer.update_gain(asked, IDLE, tau) == IDLE
        assert disturbance_observer.update_gain(asked, begun, tau) == IDLE
    assert disturbance_observer.compute_compensation(IDLE, S) == (0.0, 0.0)
    assert disturbance_observer.step_disturbance_feedforward(r, IDLE, math.nan) == IDLE


def test_what_begins_under_a_push_takes_it_for_balanced() -> None:
    r = make_cascade_tuning(IDEAL, TuningParameters(), k_ext=0.8).disturbance_feedforward
    begun = disturbance_observer.update_gain(r, IDLE, 0.4)
    assert disturbance_observer.compute_compensation(begun, S).q == 0.0
    assert disturbance_observer.compute_compensation(begun, S).q_e < 0.0
    weaker = disturbance_observer.update_gain(r._replace(k_ext=0.2), begun, 9.9)
    assert disturbance_observer.compute_compensation(weaker, S).q_e == pytest.approx(
        0.25 * disturbance_observer.compute_compensation(begun, S).q_e, rel=1e-12
    )


def ticks_under_a_push(
    u_plan: float, before: float, after: float, pushed: int
) -> tuple[cascade.CascadeOutput, cascade.CascadeOutput]:
    """Play a push of 6 N with k_ext ``before``; the next tick with it and with ``after``."""
    tunings = [
        make_cascade_tuning(IDEAL, TuningParameters(lam_q=0.8), u_plan=u_plan, k_ext=k_ext) for k_ext in (before, after)
    ]
    rig = simulation.make_simulated_rig(IDEAL)
    x, law = simulation.at_rest(rig, tunings[0], 0.2, S)
    m = NOT_MEASURED._replace(q=x.q, theta_A=x.theta_A, theta_B=x.theta_B, F_A=20.0, F_B=20.0)
    r = LoopReferences(0.2, S, math.nan, math.nan)
    for k in range(pushed + 300):
        tau = 6.0 * R_J if k >= 300 else 0.0
        at = m._replace(q=x.q + tau / S * (1.0 - 0.3 * min(1.0, (k - 300) / 200)))
        _, law = cascade.step(tunings[0], law, r, True, at, tau)
    (kept, _), (changed, _) = (cascade.step(tuning, law, r, True, at, tau) for tuning in tunings)
    return kept, changed


@pytest.mark.parametrize("u_plan", [0.0, 8.5])
@pytest.mark.parametrize(("before", "after"), [(0.0, 1.0), (1.0, 0.0), (0.4, 0.9)])
@pytest.mark.parametrize("pushed", [1, 60, 400])
def test_it_is_switched_under_a_push_without_a_bump(u_plan: float, before: float, after: float, pushed: int) -> None:
    """Neither voltage nor motor reference jumps: on its own, the feed-forward would move the reference by 0.3 rad."""
    kept, changed = ticks_under_a_push(u_plan, before, after, pushed)
    assert changed.u_A == kept.u_A
    assert changed.u_B == kept.u_B
    assert changed.theta_A_ref == pytest.approx(kept.theta_A_ref, abs=2e-3)
    assert changed.theta_B_ref == pytest.approx(kept.theta_B_ref, abs=2e-3)


def test_without_it_an_outside_torque_changes_no_bit() -> None:
    tuning = make_cascade_tuning(IDEAL, TuningParameters(lam_q=0.8), u_plan=8.5)
    rig = simulation.make_simulated_rig(IDEAL)
    x, law = simulation.at_rest(rig, tuning, 0.2, S)
    told = law
    for k in range(400):
        m = NOT_MEASURED._replace(q=x.q + 1e-4 * k, theta_A=x.theta_A, theta_B=x.theta_B, F_A=20.0, F_B=20.0)
        r = LoopReferences(0.2 + 1e-3 * k, S, math.nan, math.nan)
        y, law = cascade.step(tuning, law, r, True, m)
        y_told, told = cascade.step(tuning, told, r, True, m, 0.5)
        assert y_told == y
    assert told.disturbance_feedforward == IDLE
