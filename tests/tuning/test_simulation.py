"""The sampled closed loop and forecasts of pushes, compared with independent methods."""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.signal import cont2discrete

from backend.control import cascade, disturbance_observer, pid
from backend.control.decoupler import interpolate_gains, select_entry
from backend.control.disturbance_observer import Rejection
from backend.errors import QUANTITY_LABELS, OutOfRangeError
from backend.tuning import simulation
from backend.tuning.gains import UNSEEN_F, TuningParameters, make_cascade_tuning, require_share
from backend.tuning.robustness import decoupling_matrix, linear_plant
from backend.tuning.simulation import (
    APPARENT_STIFFNESS_HZ,
    INPUTS,
    NEAR_RAD,
    OUTPUTS,
    PUSH_N,
    Array,
    estimate_torque,
    forecast_push,
    make_sampled_loop,
    planned_response,
)
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters

# The sampled closed loop, compared with the two modes of the ideal plant and z-transforms of the laws.
#
# The numbers are those of the method (sections 1 and 5); the reference contains no code of Sinew.

ArraySampledLoop = NDArray[np.float64]
Complex = NDArray[np.complex128]

IDEAL = load_parameters("ideal")
S = 11.0
R_M, R_J = 7.5e-3, 75e-3
J_J, B_J = IDEAL.geometry.J_j, IDEAL.geometry.B_j
K_M, T_M, K_T, TAU_E = 2.86, 0.22, 0.3, 2e-3
B_M = K_T / K_M
J_M = B_M * T_M
SLOPE = S / (2.0 * R_J**2)
"""Of each spring [N/m] where the joint is that stiff."""
F = np.array([0.05, 0.2, 0.7, 2.0, 6.0, 20.0])


class Mode(NamedTuple):
    """Differential mode of the motors with the joint, or common mode: x' = A x + B (u, τ_ext)."""

    A: ArraySampledLoop
    B: ArraySampledLoop

    def response(self, f: ArraySampledLoop) -> Complex:
        """Return the response of the whole state (n, states, 2) to inputs held over a tick."""
        A, B, *_ = cont2discrete((self.A, self.B, np.eye(len(self.A)), np.zeros_like(self.B)), T_s)
        z = np.exp(2j * np.pi * f * T_s)
        return np.array([np.linalg.solve(one * np.eye(len(A)) - A, B) for one in z])


DIFFERENCE = Mode(
    np.array(
        [  # q, q', θ, θ', τ
            [0, 1, 0, 0, 0],
            [-S / J_J, -B_J / J_J, 2.0 * R_J * R_M * SLOPE / J_J, 0, 0],
            [0, 0, 0, 1, 0],
            [R_M * R_J * SLOPE / J_M, 0, -(R_M**2) * SLOPE / J_M, -B_M / J_M, 1.0 / J_M],
            [0, 0, 0, 0, -1.0 / TAU_E],
        ]
    ),
    np.array([[0, 0], [0, 1.0 / J_J], [0, 0], [0, 0], [K_T / TAU_E, 0]]),
)
COMMON = Mode(
    np.array([[0, 1, 0], [-(R_M**2) * SLOPE / J_M, -B_M / J_M, 1.0 / J_M], [0, 0, -1.0 / TAU_E]]),
    np.array([[0, 0], [0, 0], [K_T / TAU_E, 0]]),
)


def laws(lam: float, lam_motor: float, z: Complex) -> tuple[Complex, Complex, Complex, Complex]:
    """Return the motor law from reference and angle, and the outer law from reference and measurement."""
    D = 4.0 * T_M - lam_motor
    k_p, k_i = 4.0 * T_M**2 / (K_M * lam_motor**2 * D), T_M**2 / (K_M * lam_motor**3 * D)
    k_d, t_f = (6.0 * T_M**2 - lam_motor * D) / (K_M * lam_motor * D), T_M * lam_motor / D
    passed = (1.0 - np.exp(-T_s / t_f)) / (1.0 - np.exp(-T_s / t_f) / z)
    integral = T_s / (z - 1.0)
    of_reference = passed * k_i * integral
    of_angle = of_reference + passed * k_p + k_d / t_f * (1.0 - passed)
    T = 4.0 * lam_motor
    outer = T / lam**2 * integral
    return of_reference, of_angle, outer, outer + (2.0 * T - lam) / lam


def by_hand(signal: str, lam: float, f: ArraySampledLoop = F) -> Complex:
    """Return the response of q to (q_ref, τ_ext), or of S to S_ref."""
    z = np.exp(2j * np.pi * f * T_s)
    of_reference, of_angle, outer, measured = laws(lam, 0.0854, z)
    if signal == "S":
        P = COMMON.response(f)[:, 0, 0]
        inner = P * of_reference / (1.0 + P * of_angle)
        return inner * outer / (1.0 + inner * measured)
    X = DIFFERENCE.response(f)
    gain = R_J / R_M
    found = []
    for k in range(f.size):  # response of θ and q to u and τ_ext, and of u to θ and q
        (q_u, q_tau), (th_u, th_tau) = X[k, 0], X[k, 2]
        A = np.array([[1.0 + q_u * of_reference[k] * gain * measured[k], q_u * of_angle[k]],
                      [th_u * of_reference[k] * gain * measured[k], 1.0 + th_u * of_angle[k]]])  # fmt: skip
        forward = of_reference[k] * gain * outer[k]
        found.append(np.linalg.solve(A, np.array([[q_u * forward, q_tau], [th_u * forward, th_tau]]))[0])
    return np.array(found)


@pytest.mark.parametrize("lam", [0.355, 0.5, 0.65])
def test_both_loops_match_the_modal_equations(lam: float) -> None:
    loop = make_sampled_loop(IDEAL, make_cascade_tuning(IDEAL, TuningParameters(lam_q=lam, lam_S=lam)), S).closed
    H = loop.response(F)
    np.testing.assert_allclose(H[:, OUTPUTS.q, [INPUTS.q_ref, INPUTS.tau_ext]], by_hand("q", lam), rtol=2e-4)
    np.testing.assert_allclose(H[:, OUTPUTS.S, INPUTS.S_ref], by_hand("S", lam), rtol=2e-4)
    np.testing.assert_allclose(H[:, OUTPUTS.S, INPUTS.q_ref], 0.0, atol=1e-6)


def test_the_static_deflection_without_the_position_loop_follows_the_stiffness() -> None:
    loop = make_sampled_loop(IDEAL, make_cascade_tuning(IDEAL, TuningParameters()), S, position_loop=False).closed
    slow = np.abs(loop.response(np.array([1e-4]))[0, OUTPUTS.q, INPUTS.tau_ext])
    assert slow == pytest.approx(1.0 / S, rel=1e-3)


def test_the_response_to_a_push_matches_a_differential_equation() -> None:
    """Another method integrates the continuous laws; the lags of the loops are hundreds of samples long."""
    lam, lam_m, tau = 0.5, 0.0854, 0.75
    D = 4.0 * T_M - lam_m
    k_p, k_i = 4.0 * T_M**2 / (K_M * lam_m**2 * D), T_M**2 / (K_M * lam_m**3 * D)
    k_d, t_f = (6.0 * T_M**2 - lam_m * D) / (K_M * lam_m * D), T_M * lam_m / D
    T = 4.0 * lam_m

    def rate(_t: float, x: ArraySampledLoop) -> ArraySampledLoop:
        plant, (outer, inner, inner_f, y_f) = x[:5], x[5:]
        q, theta = plant[0], plant[2]
        reference = R_J / R_M * (outer - (2.0 * T - lam) / lam * q)
        u = inner_f - k_p * y_f - k_d / t_f * (theta - y_f)
        moved = DIFFERENCE.A @ plant + DIFFERENCE.B @ (u, tau)
        laws = (-T / lam**2 * q, k_i * (reference - theta), (inner - inner_f) / t_f, (theta - y_f) / t_f)
        return np.concatenate([moved, laws])

    exact = solve_ivp(rate, (0.0, 3.0), np.zeros(9), "LSODA", np.arange(3000) * T_s, rtol=1e-8, atol=1e-10).y[0]
    loop = make_sampled_loop(IDEAL, make_cascade_tuning(IDEAL, TuningParameters(lam_q=lam)), S).closed
    w = np.zeros((3000, len(INPUTS)))
    w[:, INPUTS.tau_ext] = tau
    q = loop.simulate(w)[:, OUTPUTS.q]
    assert q.max() == pytest.approx(exact.max(), rel=0.01)
    np.testing.assert_allclose(q, exact, atol=0.01 * exact.max())


STIFFER = tuple(1.05 * k for k in IDEAL.spring.k)
UNLIKE = replace(
    IDEAL,
    sided={
        "motor_B": {"K_m": 3.1, "T_m": 0.2},
        "spring_B": {"k": STIFFER},
        "identified_B": {"K_m": 3.1, "T_m": 0.2, "k": STIFFER},
    },
)
"""Sides that differ, and are known to."""


def measured_response(parameters: PlantParameters, tuning: cascade.CascadeTuning, signal: str, period: int) -> Complex:
    """Return the response of q and S (2,) to a small reference sine, fitted over whole periods after the transient."""
    ticks, before = period * max(round(3000 / period), 2), -(-8000 // period) * period
    phase = 2.0 * np.pi * np.arange(before + ticks) / period
    size, still = {"q": 0.004, "S": 0.02}[signal], np.zeros(phase.size)
    # No consecutive samples are equal: a reference that is constant for a tick becomes a small step (decision 0053).
    wave = size * np.sin(phase + 0.001)
    q_ref, S_ref = (wave, S + still) if signal == "q" else (still, S + wave)
    run = simulation.simulate_cascade(parameters, tuning, q_ref, S_ref)
    line = np.exp(-1j * phase)[before:]
    reference_component = (wave[before:] * line).sum()
    return np.array([(seen[before:] * line).sum() / reference_component for seen in (run.q, run.S)])


@pytest.mark.parametrize("sides", ["alike", "unlike"])
@pytest.mark.parametrize("u_plan", [0.0, 8.5])
@pytest.mark.parametrize("signal", ["q", "S"])
@pytest.mark.parametrize("period", [1000, 250])
def test_the_simulated_actuator_follows_a_small_sine_as_predicted(
    sides: str, u_plan: float, signal: str, period: int
) -> None:
    """The non-linear simulator with the cascade is compared with the sampled linear loop."""
    parameters = IDEAL if sides == "alike" else UNLIKE
    tuning = make_cascade_tuning(parameters, TuningParameters(lam_q=0.4), u_plan=u_plan)
    f = np.array([1.0 / (period * T_s)])
    by = planned_response if u_plan else loop_response
    H = by(parameters, tuning, S, f)[0, :, {"q": 0, "S": 1}[signal]]
    measured = measured_response(parameters, tuning, signal, period)
    own = {"q": 0, "S": 1}[signal]
    # In time-optimal motion the integrator of S ignores less than 0.01 N·m/rad: the error of such a small sine.
    bounds = (1e-5, 2e-3 if u_plan else 1e-5)
    assert abs(measured[own] / H[own] - 1.0) < bounds[own]
    assert abs(measured[1 - own] - H[1 - own]) < bounds[1 - own]


def loop_response(parameters: PlantParameters, tuning: cascade.CascadeTuning, S: float, f: ArraySampledLoop) -> Complex:
    return make_sampled_loop(parameters, tuning, S).closed.response(f)


def test_a_time_optimal_response_has_unit_gain_and_no_lag_for_any_lambda() -> None:
    slow, fast = (
        planned_response(
            IDEAL, make_cascade_tuning(IDEAL, TuningParameters(lam_q=lam, lam_S=lam), u_plan=8.5), S, F[:3]
        )
        for lam in (0.4, 1.0)
    )
    np.testing.assert_allclose(np.abs(slow[:, [0, 1], [0, 1]]), 1.0, atol=1e-3)
    np.testing.assert_allclose(slow, fast, atol=2e-3)


# Forecasts of pushes, compared with differential equations by another method and with the margins of the loop.
#
# The numbers are those of the method (sections 1 and 5), as above.

HELD = S
IDEAL_PUSH_FORECAST, LAB = load_parameters("ideal"), load_parameters("lab")
LAM_M = 0.0854


def integrated(lam: float, k_ext: float, tau: float, seconds: float, f: float = 0.0) -> Array:
    """Integrate the joint under a constant or sine torque of ``f`` [Hz] with continuous laws and observer by LSODA."""
    D = 4.0 * T_M - LAM_M
    k_p, k_i = 4.0 * T_M**2 / (K_M * LAM_M**2 * D), T_M**2 / (K_M * LAM_M**3 * D)
    k_d, t_f = (6.0 * T_M**2 - LAM_M * D) / (K_M * LAM_M * D), T_M * LAM_M / D
    T, get_unverified_defaults = 4.0 * LAM_M, 0.0 if f else UNSEEN_F * R_J
    p, i = ((2.0 * T - lam) / lam, T / lam**2) if lam < 2.0 * T else (0.0, 0.5 / lam)

    def rate(t: float, x: Array) -> Array:
        plant, (outer, inner, inner_f, y_f), seen, lags = x[:5], x[5:9], x[9:12], x[12:]
        acts = tau * (math.sin(2.0 * math.pi * f * t) if f else 1.0)
        answered = math.copysign(max(abs(seen[2]) - get_unverified_defaults, 0.0), seen[2])
        q = plant[0] - k_ext * (answered - lags[3]) / HELD
        reference = R_J / R_M * (outer - p * q - k_ext * answered / HELD)
        u = inner_f - k_p * y_f - k_d / t_f * (plant[2] - y_f)
        moved = DIFFERENCE.A @ plant + DIFFERENCE.B @ (u, acts)
        laws = (-i * q, k_i * (reference - plant[2]), (inner - inner_f) / t_f, (plant[2] - y_f) / t_f)
        observed = disturbance_observer.POLE * (np.append(acts, seen[:2]) - seen)
        return np.concatenate([moved, laws, observed, (np.append(answered, lags[:3]) - lags) / LAM_M])

    at = np.arange(0.0, seconds, T_s)
    return np.asarray(
        solve_ivp(rate, (0.0, seconds), np.zeros(16), "LSODA", at, rtol=1e-8, atol=1e-11, max_step=0.01).y[0]
    )


@pytest.mark.parametrize("k_ext", [0.0, 0.7, 1.0])
@pytest.mark.parametrize("lam", [0.4, 1.0])
def test_the_forecast_of_a_held_push_matches_a_differential_equation(lam: float, k_ext: float) -> None:
    found = forecast_push(
        IDEAL_PUSH_FORECAST,
        make_cascade_tuning(IDEAL_PUSH_FORECAST, TuningParameters(lam_q=lam), k_ext=k_ext),
        HELD,
        lam,
    )
    q = np.abs(integrated(lam, k_ext, R_J * PUSH_N, 2.0 + 8.0 * lam))
    assert found.deflection == pytest.approx(q.max(), rel=0.01)
    back_s = float(np.flatnonzero(q > NEAR_RAD)[-1] + 1) * T_s
    assert found.recovery_s == pytest.approx(back_s, rel=0.03)
    np.testing.assert_allclose(np.interp(found.t, np.arange(q.size) * T_s, q), np.abs(found.off), atol=0.01 * q.max())


@pytest.mark.parametrize("k_ext", [0.0, 1.0])
def test_the_forecast_apparent_stiffness_matches_the_response_to_a_sine_force(k_ext: float) -> None:
    lam, tau = 1.0, 0.2
    found = forecast_push(
        IDEAL_PUSH_FORECAST,
        make_cascade_tuning(IDEAL_PUSH_FORECAST, TuningParameters(lam_q=lam), k_ext=k_ext),
        HELD,
        lam,
    )
    for f, felt in zip(
        APPARENT_STIFFNESS_HZ, (found.apparent_stiffness_slow, found.apparent_stiffness_fast), strict=True
    ):
        periods = 8.0 if f > 0.5 else 2.0
        q = integrated(lam, k_ext, tau, (8.0 if f > 0.5 else 20.0) + periods / f, f)[-round(periods / f / T_s) :]
        t = np.arange(q.size) * T_s
        amplitude = 2.0 * abs(np.mean(q * np.exp(-2j * np.pi * f * t)))
        assert felt == pytest.approx(tau / amplitude, rel=0.03)


def test_disturbance_rejection_raises_the_slow_and_lowers_the_fast_apparent_stiffness() -> None:
    """With a slow position loop, the lag of the motors makes the compensation at 1 Hz act with the push."""
    off, on = (
        forecast_push(LAB, make_cascade_tuning(LAB, TuningParameters(lam_q=2.0), k_ext=k), HELD, 2.0)
        for k in (0.0, 1.0)
    )
    assert off.apparent_stiffness_slow == pytest.approx(HELD, rel=0.02)
    assert on.apparent_stiffness_slow > 3.0 * off.apparent_stiffness_slow
    assert on.apparent_stiffness_fast < 0.9 * off.apparent_stiffness_fast
    assert on.deflection == pytest.approx(off.deflection, rel=1e-3)  # the springs act before the motors
    assert on.recovery_s < 0.25 * off.recovery_s


def test_a_joint_that_does_not_recover_has_no_recovery_time() -> None:
    slow = make_cascade_tuning(IDEAL_PUSH_FORECAST, TuningParameters(lam_q=3.0))
    assert math.isnan(forecast_push(IDEAL_PUSH_FORECAST, slow, HELD, 0.1).recovery_s)  # the forecast covers 3.4 s
    assert math.isnan(forecast_push(IDEAL_PUSH_FORECAST, slow, HELD, 0.1).recovery_s)  # and from the cache


@pytest.mark.parametrize("k_ext", [-0.1, 1.1, math.nan])
def test_a_rejection_gain_outside_its_bounds_is_rejected(k_ext: float) -> None:
    with pytest.raises(OutOfRangeError) as refused:
        require_share(k_ext)
    assert (refused.value.quantity, refused.value.minimum, refused.value.maximum) == ("k_ext", 0.0, 1.0)
    assert refused.value.label == QUANTITY_LABELS["k_ext"]


_STATES = 25


def opened(lam: float, S: float, k_ext: float, K_env: float = 0.0, off: float = 1.0) -> tuple[Array, Array, Array]:
    """Return A, B, C of a tick, opened at the requested equilibrium, with observer and rejection, without dead zone.

    The springs are ``off`` times those of the observer; the joint is in contact with ``K_env`` [N·m/rad].
    """
    tuning = make_cascade_tuning(LAB, TuningParameters(lam_q=lam), k_ext=k_ext)
    d, observer = tuning.decoupler, disturbance_observer.build_observer(LAB)
    plant = linear_plant(LAB, d, S)
    moving = plant.A.copy()
    moving[:, 0] -= plant.B[:, 2] * K_env
    moving[:, 1] -= plant.B[:, 2] * 0.05 * math.sqrt(K_env)
    both = np.zeros((10, 10))
    both[:8, :8], both[:8, 8:] = moving, plant.B[:, :2]
    held = expm(both * T_s)
    split = decoupling_matrix(d, S)
    gains_q, _ = interpolate_gains(tuning.schedule, select_entry(tuning.schedule, -1.0, S))
    r = Rejection(k_ext, 0.0, math.inf, tuning.disturbance_feedforward.lag_decay)

    def tick(x: Array, q_e: float) -> Array:
        q, theta_A, theta_B = x[0], x[2], x[5]
        pull = S / off * (d.r_m * (theta_A - theta_B) / (2.0 * d.r_j) - q)
        tau = 0.5 * (x[18] + pull) + x[17]
        ahead = x[15] + observer.q_of_q_dot * x[16] + observer.q_of_tau * tau
        surprise = q - ahead
        seen = (
            ahead + observer.L_q * surprise,
            observer.q_dot_of_q_dot * x[16] + observer.q_dot_of_tau * tau + observer.L_q_dot * surprise,
            x[17] + observer.L_tau * surprise,
        )
        state = disturbance_observer.step_disturbance_feedforward(
            r, disturbance_observer.DisturbanceFeedforwardState(k_ext, *x[19:24]), seen[2]
        )
        answer = disturbance_observer.compute_compensation(state, S)
        q_c, position = pid.step_i_p(gains_q, pid.IPState(x[14]), 0.0, q - answer.q, 0.0)
        ref_A, ref_B = split @ (q_e, 0.0)
        u_A, _, A = pid.step_i_pd(tuning.motors.A, pid.IPDState(*x[8:11]), ref_A, theta_A, math.inf)
        u_B, _, B = pid.step_i_pd(tuning.motors.B, pid.IPDState(*x[11:14]), ref_B, theta_B, math.inf)
        moved = held[:8, :8] @ x[:8] + held[:8, 8:] @ (u_A, u_B)
        return np.concatenate([moved, A, B, position, seen, [pull], state[1:], [q_c + answer.q_e]])

    columns = np.column_stack([tick(x, 0.0) for x in np.eye(_STATES)[:, : _STATES - 1].T])
    given = tick(np.zeros(_STATES - 1), 1.0)
    return columns[:-1], given[:-1], columns[-1]


def M_s(A: Array, B: Array, C: Array) -> float:
    """Return the sensitivity peak of the opened loop."""
    z = np.exp(2j * np.pi * np.geomspace(0.02, 100.0, 500) * T_s)
    L = np.array([C @ np.linalg.solve(one * np.eye(len(A)) - A, B) for one in z])
    return float(np.max(np.abs(1.0 / (1.0 - L))))


@pytest.mark.parametrize("lam", [0.355, 1.0, 2.0])
def test_disturbance_rejection_does_not_change_the_margins_of_a_free_joint(lam: float) -> None:
    for S in (8.0, 15.0):
        without = M_s(*opened(lam, S, 0.0))
        assert M_s(*opened(lam, S, 1.0)) == pytest.approx(without, abs=1e-3)
        for off in (0.8, 1.25):  # springs that differ from the model
            assert M_s(*opened(lam, S, 1.0, off=off)) == pytest.approx(without, abs=0.01)


@pytest.mark.parametrize("lam", [0.355, 0.5, 1.0, 2.0, 3.0])
def test_the_loop_is_stable_against_any_environment_stiffness(lam: float) -> None:
    for S in (8.0, 15.0):
        for k_ext in (0.7, 1.0):
            for K_env in (0.0, 1.0, 10.0, 100.0, 300.0):
                A, B, C = opened(lam, S, k_ext, K_env)
                assert np.max(np.abs(np.linalg.eigvals(A + np.outer(B, C)))) < 1.0


def test_contact_with_a_stiff_environment_reduces_the_margin_with_the_rejection_gain() -> None:
    """The force increases with the motion of the joint, so M_s is bounded by 1 / (1 − k_ext)."""
    assert M_s(*opened(2.0, 8.0, 0.0, 100.0)) < 1.1
    assert 2.0 < M_s(*opened(2.0, 8.0, 0.7, 100.0)) < 1.0 / (1.0 - 0.7)
    assert M_s(*opened(2.0, 8.0, 1.0, 100.0)) > 5.0


def test_the_torque_estimate_lags_by_the_observer_poles_and_one_tick() -> None:
    """The mean delay of a step is one tick for the reading and decay/(1 − decay) ticks for each of three lags."""
    decay = math.exp(-disturbance_observer.POLE * T_s)
    missing = 1.0 - estimate_torque(np.ones(5000))
    assert missing.sum() == pytest.approx(1.0 + 3.0 * decay / (1.0 - decay))
    assert abs(missing[-1]) < 1e-9
