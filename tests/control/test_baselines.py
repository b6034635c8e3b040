"""Baseline laws: feedback linearization and the single loop."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backend.control import baselines, decoupler
from backend.tuning.gains import TuningParameters, make_feedback_linearization_tuning, make_single_loop_tuning
from plant.interface import Measurement
from plant.parameters import PlantParameters, load_parameters
from tests.closed_loop.baseline_loops import run_feedback_linearization, run_single_loop

# Feedback linearization: the plant reduces to the reference filter, and both channels are decoupled.

IDEAL = load_parameters("ideal")
UNGOVERNED = 1e9


def lags(t: np.ndarray, lam: float, order: int) -> np.ndarray:
    """Step response of 1/(λ s + 1)^order."""
    x = np.maximum(t, 0.0) / lam
    return np.asarray(1.0 - np.exp(-x) * sum(x**i / math.factorial(i) for i in range(order)))


def ungoverned(parameters: PlantParameters, lambdas: TuningParameters) -> baselines.FeedbackLinearizationTuning:
    return make_feedback_linearization_tuning(parameters, lambdas)._replace(omega_max=UNGOVERNED)


def test_position_follows_the_linear_reference_and_leaves_stiffness_alone() -> None:
    ticks = 4000
    t = 1e-3 * (np.arange(ticks) - 100)
    q_ref, S_ref = np.where(t < 0.0, -0.4, 0.4), np.full(ticks, 10.0)
    trajectory = run_feedback_linearization(IDEAL, ungoverned(IDEAL, TuningParameters()), q_ref, S_ref)
    assert trajectory.q == pytest.approx(-0.4 + 0.8 * lags(t, 0.25, 4), abs=0.002)
    assert pytest.approx(S_ref, abs=0.002) == trajectory.S


def test_stiffness_follows_the_linear_reference_and_leaves_position_alone() -> None:
    ticks = 4000
    t = 1e-3 * (np.arange(ticks) - 100)
    q_ref, S_ref = np.full(ticks, 0.3), np.where(t < 0.0, 9.0, 12.0)
    trajectory = run_feedback_linearization(IDEAL, ungoverned(IDEAL, TuningParameters()), q_ref, S_ref)
    assert pytest.approx(9.0 + 3.0 * lags(t, 0.42, 2), abs=0.02) == trajectory.S
    assert trajectory.q == pytest.approx(q_ref, abs=1e-3)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_moderate_steps_of_both_references_settle_taut(name: str) -> None:
    parameters = load_parameters(name)
    q_ref = np.repeat([0.0, 0.4, 0.4, -0.2], 6000)
    S_ref = np.repeat([10.0, 10.0, 13.0, 9.0], 6000)
    tuning = make_feedback_linearization_tuning(parameters, TuningParameters())
    trajectory = run_feedback_linearization(parameters, tuning, q_ref, S_ref)
    assert trajectory.tripped_at == -1
    for end in range(6000, 24_001, 6000):
        settled = slice(end - 500, end)
        assert trajectory.q[settled] == pytest.approx(q_ref[settled], abs=0.01)
        assert trajectory.S[settled] == pytest.approx(S_ref[settled], abs=0.05)
    assert min(trajectory.F_A.min(), trajectory.F_B.min()) > 5.0


@pytest.mark.parametrize(("stiffer", "stronger"), [(1.2, 0.8), (0.8, 1.2)])
def test_a_model_with_20_percent_error_still_settles(stiffer: float, stronger: float) -> None:
    tuning = make_feedback_linearization_tuning(IDEAL, TuningParameters())
    other = replace(
        IDEAL,
        spring=replace(IDEAL.spring, k=tuple(stiffer * k for k in IDEAL.spring.k)),
        motor=replace(IDEAL.motor, K_m=stronger * IDEAL.motor.K_m),
    )
    q_ref, S_ref = np.repeat([0.0, 0.5], [1000, 7000]), np.full(8000, 10.0)
    trajectory = run_feedback_linearization(other, tuning, q_ref, S_ref)
    assert trajectory.tripped_at == -1
    assert trajectory.q[-500:] == pytest.approx(0.5, abs=0.005)
    assert trajectory.q.max() < 0.5 * 1.05


def test_feedback_linearization_starts_with_the_active_voltages() -> None:
    """A joint at rest stays at rest: voltages and model do not change."""
    q_ref, S_ref = np.full(500, 0.2), np.full(500, 11.0)
    trajectory = run_feedback_linearization(
        IDEAL, make_feedback_linearization_tuning(IDEAL, TuningParameters()), q_ref, S_ref
    )
    assert trajectory.q == pytest.approx(0.2, abs=1e-9)
    assert np.ptp(trajectory.u_A) < 1e-6


def test_a_lasting_push_leaves_no_error_of_position_or_stiffness() -> None:
    """The model does not contain the push: only the integrators remove the 0.1 rad that 15 N at 75 mm cause."""
    ticks = 8000
    push = np.repeat([0.0, 15.0], [500, ticks - 500])
    tuning = make_feedback_linearization_tuning(IDEAL, TuningParameters())
    trajectory = run_feedback_linearization(IDEAL, tuning, np.full(ticks, 0.2), np.full(ticks, 11.0), push)
    assert np.ptp(trajectory.q) > 0.02
    assert trajectory.q[-500:] == pytest.approx(0.2, abs=1e-4)
    assert trajectory.S[-500:] == pytest.approx(11.0, abs=1e-3)


def test_clipped_voltage_does_not_wind_up() -> None:
    q_ref, S_ref = np.repeat([-1.0, 1.0], [100, 9000]), np.full(9100, 11.0)
    tuning = ungoverned(IDEAL, TuningParameters())._replace(u_max=6.0)
    trajectory = run_feedback_linearization(IDEAL, tuning, q_ref, S_ref)
    assert trajectory.tripped_at == -1
    assert np.max(np.abs([trajectory.u_A, trajectory.u_B])) == 6.0
    assert trajectory.q.max() < 1.0 + 0.05 * 2.0
    assert trajectory.q[-1] == pytest.approx(1.0, abs=2e-3)


def test_a_third_order_spring_is_linearized() -> None:
    k = (-2.0, 300.0, 7000.0, 30_000.0)
    cubic = replace(IDEAL, spring=replace(IDEAL.spring, k=k, x_solid=0.060), identified=replace(IDEAL.identified, k=k))
    ticks = 4000
    t = 1e-3 * (np.arange(ticks) - 100)
    q_ref, S_ref = np.where(t < 0.0, -0.4, 0.4), np.full(ticks, 10.0)
    trajectory = run_feedback_linearization(cubic, ungoverned(cubic, TuningParameters()), q_ref, S_ref)
    assert trajectory.q == pytest.approx(-0.4 + 0.8 * lags(t, 0.25, 4), abs=0.002)
    assert pytest.approx(S_ref, abs=0.005) == trajectory.S


def test_measurement_corrects_the_model() -> None:
    tuning = make_feedback_linearization_tuning(IDEAL, TuningParameters())
    m = Measurement(0.1, 12.0, 10.0, 20.0, 20.0, 10.5, 0.0, 0.0)
    state = baselines.initialize_feedback_linearization(tuning, 0.7, 0.4, m._replace(theta_A=12.1))
    _, after = baselines.step_feedback_linearization(tuning, state, 0.1, 10.5, m)
    assert 12.0 < after.x.theta_A < 12.1
    assert after.x.omega_A < 0.0


def test_a_model_with_other_positions_converges_to_each_encoder() -> None:
    tuning = make_feedback_linearization_tuning(IDEAL, TuningParameters())
    m = Measurement(0.1, 12.0, 10.0, 20.0, 20.0, 10.5, 0.0, 0.0)
    for angle in ("q", "theta_A", "theta_B"):
        for off in (0.01, -0.01):
            begun = m._replace(**{angle: getattr(m, angle) + off})
            state = baselines.initialize_feedback_linearization(tuning, 0.7, 0.4, begun)
            _, after = baselines.step_feedback_linearization(tuning, state, 0.1, 10.5, m)
            left = (getattr(after.x, angle) - getattr(m, angle)) / off
            assert 0.0 < left < 1.0


# The single loop against its own design, at its limits, and handed over.


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


def test_the_single_loop_starts_with_the_active_voltages() -> None:
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


def test_force_readings_have_the_delay_of_the_load_cells_from_the_first_tick() -> None:
    late = replace(IDEAL, sensors=replace(IDEAL.sensors, force_delay=0.012))
    tuning, references = make_single_loop_tuning(IDEAL, TuningParameters()), (np.zeros(300), np.full(300, 10.0))
    now, then = (run_single_loop(plant, tuning, *references, F_push=np.full(300, 20.0)) for plant in (IDEAL, late))
    assert np.ptp(now.F_A[:64]) > 0.1
    np.testing.assert_array_equal(then.q, now.q)
    np.testing.assert_allclose(then.F_A[12:], now.F_A[:-12], rtol=1e-12)
    np.testing.assert_allclose(then.F_B[12:], now.F_B[:-12], rtol=1e-12)
