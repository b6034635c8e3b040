"""The single loop against its own design, at its limits, and handed over."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backend.control import baselines, decoupler
from backend.tuning.gains import TuningParameters, make_single_loop_tuning
from plant.interface import Measurement
from plant.parameters import load_parameters
from tests.closed_loop.baseline_loops import run_single_loop

IDEAL = load_parameters("ideal")
UNGOVERNED = 1e9


def four_lags(t: np.ndarray, lam: float) -> np.ndarray:
    """Step response of 1/(λ s + 1)^4."""
    x = np.maximum(t, 0.0) / lam
    return np.asarray(1.0 - np.exp(-x) * sum(x**i / math.factorial(i) for i in range(4)))


def test_small_position_step_follows_the_designed_lags() -> None:
    ticks = 3000
    q_ref, S_ref = np.where(np.arange(ticks) < 100, 0.0, 0.1), np.full(ticks, 10.0)
    tuning = make_single_loop_tuning(IDEAL, TuningParameters())._replace(omega_max=UNGOVERNED)
    trajectory = run_single_loop(IDEAL, tuning, q_ref, S_ref)
    t = 1e-3 * (np.arange(ticks) - 100)
    assert trajectory.q == pytest.approx(0.1 * four_lags(t, 0.25), abs=0.002)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_moderate_steps_of_both_references_settle_taut_in_the_single_loop(name: str) -> None:
    parameters = load_parameters(name)
    q_ref = np.repeat([0.0, 0.4, 0.4, -0.2], 6000)
    S_ref = np.repeat([10.0, 10.0, 13.0, 9.0], 6000)
    trajectory = run_single_loop(parameters, make_single_loop_tuning(parameters, TuningParameters()), q_ref, S_ref)
    assert trajectory.tripped_at == -1
    for end in range(6000, 24_001, 6000):
        settled = slice(end - 500, end)
        assert trajectory.q[settled] == pytest.approx(q_ref[settled], abs=0.01)
        assert trajectory.S[settled] == pytest.approx(S_ref[settled], abs=0.1)
    assert min(trajectory.F_A.min(), trajectory.F_B.min()) > 5.0


def test_clipped_voltage_does_not_wind_up_the_single_loop() -> None:
    q_ref, S_ref = np.repeat([-1.0, 1.0], [100, 8000]), np.full(8100, 11.0)
    tuning = make_single_loop_tuning(IDEAL, TuningParameters(lam_q=0.3, lam_S=0.3))._replace(
        omega_max=UNGOVERNED, u_max=4.0
    )
    trajectory = run_single_loop(IDEAL, tuning, q_ref, S_ref)
    assert np.max(np.abs([trajectory.u_A, trajectory.u_B])) == 4.0
    assert trajectory.q.max() < 1.0 + 0.05 * 2.0
    assert trajectory.q[-1] == pytest.approx(1.0, abs=1e-3)


def test_the_single_loop_takes_over_the_voltages_in_force() -> None:
    tuning = make_single_loop_tuning(IDEAL, TuningParameters())
    m = Measurement(0.1, 12.0, 10.0, 20.0, 20.0, 10.5, 0.0, 0.0)
    state = baselines.initialize_single_loop(tuning, 0.7, 0.4, m)
    y, _ = baselines.step_single_loop(
        tuning, state, 0.1, decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B), m
    )
    assert (y.u_A, y.u_B) == pytest.approx((0.7, 0.4), abs=1e-12)
    assert (y.clipped_A, y.clipped_B, y.governed) == (False, False, False)


def test_the_safety_module_ends_a_run_that_leaves_the_joint_range() -> None:
    narrow = replace(IDEAL, geometry=replace(IDEAL.geometry, q_max=0.5))
    trajectory = run_single_loop(
        narrow, make_single_loop_tuning(narrow, TuningParameters()), np.repeat([0.0, 0.6], 3000), np.full(6000, 10.0)
    )
    assert 3000 < trajectory.tripped_at < 6000
    assert np.isnan(trajectory.q[trajectory.tripped_at + 1])


def test_forces_are_measured_as_late_as_the_load_cells_are_from_the_first_tick_on() -> None:
    late = replace(IDEAL, sensors=replace(IDEAL.sensors, force_delay=0.012))
    tuning, references = make_single_loop_tuning(IDEAL, TuningParameters()), (np.zeros(300), np.full(300, 10.0))
    now, then = (run_single_loop(plant, tuning, *references, F_push=np.full(300, 20.0)) for plant in (IDEAL, late))
    assert np.ptp(now.F_A[:64]) > 0.1
    np.testing.assert_array_equal(then.q, now.q)
    np.testing.assert_allclose(then.F_A[12:], now.F_A[:-12], rtol=1e-12)
    np.testing.assert_allclose(then.F_B[12:], now.F_B[:-12], rtol=1e-12)
