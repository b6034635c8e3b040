"""The observer of the external force, and its feed-forward."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backend.control import cascade, disturbance_observer
from backend.control.disturbance_observer import IDLE, DisturbanceFeedforwardState, Rejection
from backend.control.trajectory import LoopReferences
from backend.tuning import simulation
from backend.tuning.gains import MOST_F, UNSEEN_F, TuningParameters, make_cascade_tuning, make_motor_loops, motor_lag
from backend.tuning.simulation import Array
from plant.interface import NOT_MEASURED, Measurement
from plant.parameters import PlantParameters, load_parameters
from tests.closed_loop.outside_force import NO_BIAS, WARM, estimate_external_force, hold_joint, measure_bias
from tests.closed_loop.random_moves import random_moves

# The external force without a sensor: the estimate compared with the acting force, and its delay.

T_S = 1e-3
R_J = 0.075


def reading(q: float, theta_A: float, theta_B: float) -> Measurement:
    return NOT_MEASURED._replace(q=q, theta_A=theta_A, theta_B=theta_B)


@pytest.fixture(scope="module")
def lab() -> PlantParameters:
    return load_parameters("lab")


@pytest.fixture(scope="module")
def bias(lab: PlantParameters) -> Array:
    return measure_bias(lab)


@pytest.mark.parametrize("pole", [60.0, 300.0])
def test_the_estimate_of_a_torque_step_has_three_equal_lags(pole: float) -> None:
    """A free joint under a constant torque: q in closed form; the estimate is 1 − e^{−pt}(1 + pt + (pt)²/2)."""
    parameters = load_parameters("ideal")
    joint, tau = parameters.make_identified_dynamics().joint, 0.2
    observer = disturbance_observer.build_observer(parameters, pole)
    b = joint.B_j / joint.J_j
    state = disturbance_observer.step_disturbance_observer(
        observer, disturbance_observer.UNKNOWN, reading(0.0, -1.0, -1.0)
    )  # slack: no tendon pulls
    for tick in range(1, 201):
        t = tick * T_S
        q = tau / (joint.B_j) * (t + math.expm1(-b * t) / b)
        state = disturbance_observer.step_disturbance_observer(observer, state, reading(q, -9.0, -9.0))
        x = pole * (t + 0.5 * T_S)  # a reading corrects at once, on average half a period early
        wanted = tau * (1.0 - math.exp(-x) * (1.0 + x + 0.5 * x * x))
        assert state.tau_ext == pytest.approx(wanted, abs=0.006 * tau)
    assert state.tau_ext == pytest.approx(tau, rel=1e-3)
    assert state.q_dot == pytest.approx(tau / joint.B_j * -math.expm1(-b * 0.2), rel=1e-3)


def test_motor_motion_and_tendon_forces_cause_no_external_force() -> None:
    """On the ideal plant with the identified springs, a fast motion shows only the counts of an encoder."""
    ideal = load_parameters("ideal")
    ticks = 3000
    q = np.where(np.arange(ticks) < 500, -math.pi / 3, math.pi / 3)
    force = estimate_external_force(ideal, hold_joint(ideal, 12.0, np.zeros(ticks), q))
    assert np.max(np.abs(force)) < 0.3


@pytest.mark.parametrize("S", [8.0, 10.0, 14.0])
@pytest.mark.parametrize("F_push", [5.0, -5.0, 2.0])
def test_a_push_is_estimated_in_time_and_size(lab: PlantParameters, bias: Array, S: float, F_push: float) -> None:
    push = np.zeros(3000)
    push[1000:2500] = F_push
    force = estimate_external_force(lab, hold_joint(lab, S, push), bias)
    threshold = 1.5 if abs(F_push) == 5.0 else 1.0
    assert np.argmax(np.abs(force[1000:]) > threshold) <= 15
    known = np.r_[WARM:1000, 1030:2500, 2530:3000]  # in the 30 ms after an edge nobody could know
    assert np.sqrt(np.mean((force - push)[known] ** 2)) <= 0.15
    assert np.max(force * math.copysign(1.0, F_push)) < abs(F_push) + 0.4


def test_pushes_during_motions_are_estimated_within_the_bound(lab: PlantParameters, bias: Array) -> None:
    ticks = 6000
    at = np.arange(ticks)
    push = 4.0 * np.sin(2.0 * np.pi * at * T_S)
    q = np.where(at % 2000 < 1000, -0.8, 0.8)
    force = estimate_external_force(lab, hold_joint(lab, 10.0, push, q), bias)
    assert np.sqrt(np.mean((force - push)[WARM:] ** 2)) <= 0.3


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_random_motions_cause_no_contact(name: str) -> None:
    parameters = load_parameters(name)
    bias = measure_bias(parameters)
    felt_most = [
        np.max(np.abs(estimate_external_force(parameters, random_moves(parameters, seed, 100), bias)[WARM:]))
        for seed in range(5)
    ]
    assert max(felt_most) < 0.5


def test_nan_readings_are_skipped_and_an_unknown_estimate_is_nan(lab: PlantParameters) -> None:
    observer = disturbance_observer.build_observer(lab)
    assert math.isnan(disturbance_observer.estimate_force(observer, disturbance_observer.UNKNOWN, NO_BIAS, 10.0))
    state = disturbance_observer.step_disturbance_observer(
        observer, disturbance_observer.UNKNOWN, reading(0.0, 1.0, 1.0)
    )
    assert disturbance_observer.step_disturbance_observer(observer, state, reading(math.nan, 1.0, 1.0)) == state
    assert disturbance_observer.step_disturbance_observer(observer, state, reading(0.0, math.nan, 1.0)) == state


def test_the_bias_is_interpolated_linearly_and_constant_beyond_its_ends(lab: PlantParameters) -> None:
    observer = disturbance_observer.build_observer(lab)
    state = disturbance_observer.DisturbanceObserverState(0.0, 0.0, 2.0 * R_J, 0.0, 0.0, 0.0)
    points = np.array([[8.0, 0.5], [10.0, 1.0], [14.0, -1.0]])
    for S, off in ((6.0, 0.5), (8.0, 0.5), (9.0, 0.75), (10.0, 1.0), (12.0, 0.0), (14.0, -1.0), (20.0, -1.0)):
        assert disturbance_observer.estimate_force(observer, state, points, S) == pytest.approx(2.0 - off)
    assert disturbance_observer.estimate_force(observer, state, points[:1], 20.0) == pytest.approx(1.5)
    assert disturbance_observer.estimate_force(observer, state, NO_BIAS, 20.0) == pytest.approx(2.0)


def test_mean_and_variance_at_rest_weight_older_samples_less(lab: PlantParameters) -> None:
    observer, state, seen = disturbance_observer.build_observer(lab), disturbance_observer.UNKNOWN, []
    q = 1e-3 * np.random.default_rng(7).standard_normal(4000)
    for tick in range(q.size):
        state = disturbance_observer.step_disturbance_observer(observer, state, reading(q[tick], -9.0, -9.0))
        seen.append(state.tau_ext)
    weights = np.exp(-T_S / disturbance_observer.MEAN_S * np.arange(q.size)[::-1])
    mean = np.average(seen, weights=weights)
    assert state.mean == pytest.approx(mean, abs=0.02 * float(np.std(seen)))
    assert state.variance == pytest.approx(np.average((np.array(seen) - mean) ** 2, weights=weights), rel=0.1)


def test_a_joint_without_damping_is_the_limit_of_small_damping(lab: PlantParameters) -> None:
    """Below the resolution of the closed form, q under a torque is T_s²/(2 J_j), as for any mass."""
    g = lab.geometry
    observers = [
        disturbance_observer.build_observer(replace(lab, geometry=replace(g, B_j=g.J_j * b))) for b in (0.0, 1e-4, 0.1)
    ]
    for observer in observers:
        assert observer.q_of_tau == pytest.approx(0.5 * T_S**2 / g.J_j, rel=1e-4)
        assert observer.q_of_q_dot == pytest.approx(T_S, rel=1e-4)
        assert observer[1:] == pytest.approx(observers[0][1:], rel=1e-3)


# Feed-forward of the external force: its output, its effect on the position loop, and its start and end.

T_S_REJECTION, R_J_REJECTION, S = 1e-3, 0.075, 12.0
IDEAL = load_parameters("ideal")


def answer_to(
    r: Rejection, tau: float, ticks: int, state: DisturbanceFeedforwardState = IDLE
) -> tuple[DisturbanceFeedforwardState, disturbance_observer.DisturbanceCompensation]:
    state = disturbance_observer.update_gain(r, state, 0.0)
    for _ in range(ticks):
        state = disturbance_observer.step_disturbance_feedforward(r, state, tau)
    return state, disturbance_observer.compute_compensation(state, S)


@pytest.mark.parametrize("k_ext", [0.3, 1.0])
def test_a_push_is_compensated_at_once_and_the_joint_returns_with_four_lags(k_ext: float) -> None:
    """Statics δq_e = −τ/S (equation 14); four equal lags respond to a step by 1 − e^{−x}(1 + x + x²/2 + x³/6)."""
    lam, tau = 0.1, 0.4
    r = make_cascade_tuning(IDEAL, TuningParameters(lam_motor=lam), k_ext=k_ext).disturbance_feedforward
    beyond = tau - UNSEEN_F * R_J_REJECTION
    for ticks in (1, 50, 200, 400, 900):
        _, answer = answer_to(r, tau, ticks)
        assert answer.q_e == pytest.approx(-k_ext * beyond / S, rel=1e-12)
        x = (
            T_S_REJECTION * (ticks + 2.0) / lam
        )  # each lag answers in the tick in which it is asked, half a period early
        left = math.exp(-x) * (1.0 + x + x**2 / 2.0 + x**3 / 6.0)
        assert answer.q == pytest.approx(k_ext * beyond / S * left, abs=2e-3 * beyond / S)


@pytest.mark.parametrize("lam", [0.06, 0.0854, 0.15])
def test_the_lags_are_those_of_the_motor_loops(lam: float) -> None:
    gains = make_motor_loops(IDEAL, lam)
    assert motor_lag(gains.A, IDEAL.select_identified("A").T_m) == pytest.approx(lam, rel=1e-12)
    r = make_cascade_tuning(IDEAL, TuningParameters(lam_motor=lam), k_ext=1.0).disturbance_feedforward
    assert r.lag_decay == pytest.approx(math.exp(-T_S_REJECTION / lam), rel=1e-12)


def test_small_forces_are_ignored_and_large_forces_are_bounded() -> None:
    r = make_cascade_tuning(IDEAL, TuningParameters(), k_ext=1.0).disturbance_feedforward
    for sign in (1.0, -1.0):
        assert answer_to(r, sign * 0.99 * UNSEEN_F * R_J_REJECTION, 500)[1] == (0.0, 0.0)
        assert answer_to(r, sign * 100.0, 1)[1].q_e == pytest.approx(-sign * MOST_F * R_J_REJECTION / S, rel=1e-12)


def test_unknown_forces_and_zero_gain_cause_no_compensation() -> None:
    r = make_cascade_tuning(IDEAL, TuningParameters(), k_ext=0.8).disturbance_feedforward
    begun, _ = answer_to(r, 0.4, 100)
    for asked, tau in ((r._replace(k_ext=0.0), 0.4), (r, math.nan)):
        assert disturbance_observer.update_gain(asked, IDLE, tau) == IDLE
        assert disturbance_observer.update_gain(asked, begun, tau) == IDLE
    assert disturbance_observer.compute_compensation(IDLE, S) == (0.0, 0.0)
    assert disturbance_observer.step_disturbance_feedforward(r, IDLE, math.nan) == IDLE


def test_a_start_under_a_push_assumes_that_it_is_balanced() -> None:
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
        tau = 6.0 * R_J_REJECTION if k >= 300 else 0.0
        at = m._replace(q=x.q + tau / S * (1.0 - 0.3 * min(1.0, (k - 300) / 200)))
        _, law = cascade.step(tunings[0], law, r, True, at, tau)
    (kept, _), (changed, _) = (cascade.step(tuning, law, r, True, at, tau) for tuning in tunings)
    return kept, changed


@pytest.mark.parametrize("u_plan", [0.0, 8.5])
@pytest.mark.parametrize(("before", "after"), [(0.0, 1.0), (1.0, 0.0), (0.4, 0.9)])
@pytest.mark.parametrize("pushed", [1, 60, 400])
def test_the_compensation_switches_without_a_bump_under_a_push(
    u_plan: float, before: float, after: float, pushed: int
) -> None:
    """Neither voltage nor motor reference jumps: alone, the feed-forward would move the reference by 0.3 rad."""
    kept, changed = ticks_under_a_push(u_plan, before, after, pushed)
    assert changed.u_A == kept.u_A
    assert changed.u_B == kept.u_B
    assert changed.theta_A_ref == pytest.approx(kept.theta_A_ref, abs=2e-3)
    assert changed.theta_B_ref == pytest.approx(kept.theta_B_ref, abs=2e-3)


def test_without_compensation_an_external_torque_changes_no_bit() -> None:
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
