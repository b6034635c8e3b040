"""The outside force without a sensor: what the observer says against the force that acts, and how late."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backend.control import disturbance_observer
from backend.tuning.simulation import Array
from plant.interface import NOT_MEASURED, Measurement
from plant.parameters import PlantParameters, load_parameters
from tests.closed_loop.outside_force import NO_BIAS, WARM, felt, held, learned
from tests.closed_loop.random_moves import random_moves

T_S = 1e-3
R_J = 0.075


def reading(q: float, theta_A: float, theta_B: float) -> Measurement:
    return NOT_MEASURED._replace(q=q, theta_A=theta_A, theta_B=theta_B)


@pytest.fixture(scope="module")
def lab() -> PlantParameters:
    return load_parameters("lab")


@pytest.fixture(scope="module")
def bias(lab: PlantParameters) -> Array:
    return learned(lab)


@pytest.mark.parametrize("pole", [60.0, 300.0])
def test_a_step_of_torque_comes_through_three_equal_lags(pole: float) -> None:
    """A free joint under a constant torque: q in closed form; what is said of it is 1 − e^{−pt}(1 + pt + (pt)²/2)."""
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


def test_motors_that_wind_and_tendons_that_pull_are_no_outside_force() -> None:
    """On the ideal plant, whose springs are the identified ones, a fast move shows an encoder's counts and no more."""
    ideal = load_parameters("ideal")
    ticks = 3000
    q = np.where(np.arange(ticks) < 500, -math.pi / 3, math.pi / 3)
    force = felt(ideal, held(ideal, 12.0, np.zeros(ticks), q))
    assert np.max(np.abs(force)) < 0.3


@pytest.mark.parametrize("S", [8.0, 10.0, 14.0])
@pytest.mark.parametrize("F_push", [5.0, -5.0, 2.0])
def test_a_push_is_seen_in_time_and_for_what_it_is(lab: PlantParameters, bias: Array, S: float, F_push: float) -> None:
    push = np.zeros(3000)
    push[1000:2500] = F_push
    force = felt(lab, held(lab, S, push), bias)
    threshold = 1.5 if abs(F_push) == 5.0 else 1.0
    assert np.argmax(np.abs(force[1000:]) > threshold) <= 15
    known = np.r_[WARM:1000, 1030:2500, 2530:3000]  # in the 30 ms after an edge nobody could know
    assert np.sqrt(np.mean((force - push)[known] ** 2)) <= 0.15
    assert np.max(force * math.copysign(1.0, F_push)) < abs(F_push) + 0.4


def test_moves_and_pushes_together_are_told_within_the_bound(lab: PlantParameters, bias: Array) -> None:
    ticks = 6000
    at = np.arange(ticks)
    push = 4.0 * np.sin(2.0 * np.pi * at * T_S)
    q = np.where(at % 2000 < 1000, -0.8, 0.8)
    force = felt(lab, held(lab, 10.0, push, q), bias)
    assert np.sqrt(np.mean((force - push)[WARM:] ** 2)) <= 0.3


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_no_random_move_is_taken_for_a_contact(name: str) -> None:
    parameters = load_parameters(name)
    bias = learned(parameters)
    felt_most = [
        np.max(np.abs(felt(parameters, random_moves(parameters, seed, 100), bias)[WARM:])) for seed in range(5)
    ]
    assert max(felt_most) < 0.5


def test_readings_that_are_no_numbers_are_passed_over_and_what_is_not_known_is_said(lab: PlantParameters) -> None:
    observer = disturbance_observer.build_observer(lab)
    assert math.isnan(disturbance_observer.estimate_force(observer, disturbance_observer.UNKNOWN, NO_BIAS, 10.0))
    state = disturbance_observer.step_disturbance_observer(
        observer, disturbance_observer.UNKNOWN, reading(0.0, 1.0, 1.0)
    )
    assert disturbance_observer.step_disturbance_observer(observer, state, reading(math.nan, 1.0, 1.0)) == state
    assert disturbance_observer.step_disturbance_observer(observer, state, reading(0.0, math.nan, 1.0)) == state


def test_between_what_was_learned_the_bias_is_a_straight_line_and_beyond_it_the_outermost(lab: PlantParameters) -> None:
    observer = disturbance_observer.build_observer(lab)
    state = disturbance_observer.DisturbanceObserverState(0.0, 0.0, 2.0 * R_J, 0.0, 0.0, 0.0)
    points = np.array([[8.0, 0.5], [10.0, 1.0], [14.0, -1.0]])
    for S, off in ((6.0, 0.5), (8.0, 0.5), (9.0, 0.75), (10.0, 1.0), (12.0, 0.0), (14.0, -1.0), (20.0, -1.0)):
        assert disturbance_observer.estimate_force(observer, state, points, S) == pytest.approx(2.0 - off)
    assert disturbance_observer.estimate_force(observer, state, points[:1], 20.0) == pytest.approx(1.5)
    assert disturbance_observer.estimate_force(observer, state, NO_BIAS, 20.0) == pytest.approx(2.0)


def test_mean_and_variance_at_rest_are_those_of_its_samples_the_older_the_less(lab: PlantParameters) -> None:
    observer, state, seen = disturbance_observer.build_observer(lab), disturbance_observer.UNKNOWN, []
    q = 1e-3 * np.random.default_rng(7).standard_normal(4000)
    for tick in range(q.size):
        state = disturbance_observer.step_disturbance_observer(observer, state, reading(q[tick], -9.0, -9.0))
        seen.append(state.tau_ext)
    weights = np.exp(-T_S / disturbance_observer.MEAN_S * np.arange(q.size)[::-1])
    mean = np.average(seen, weights=weights)
    assert state.mean == pytest.approx(mean, abs=0.02 * float(np.std(seen)))
    assert state.variance == pytest.approx(np.average((np.array(seen) - mean) ** 2, weights=weights), rel=0.1)


def test_a_joint_without_damping_is_the_limit_of_one_that_has_little(lab: PlantParameters) -> None:
    """Below what the closed form can tell, q under a torque of its own is T_s²/(2 J_j), as of any mass."""
    g = lab.geometry
    observers = [
        disturbance_observer.build_observer(replace(lab, geometry=replace(g, B_j=g.J_j * b))) for b in (0.0, 1e-4, 0.1)
    ]
    for observer in observers:
        assert observer.q_of_tau == pytest.approx(0.5 * T_S**2 / g.J_j, rel=1e-4)
        assert observer.q_of_q_dot == pytest.approx(T_S, rel=1e-4)
        assert observer[1:] == pytest.approx(observers[0][1:], rel=1e-3)
