"""The sampled closed loop against one written out by hand: the ideal plant's two modes, the laws as z-transforms.

Numbers are those of the method (sections 1 and 5), equations its own; nothing of the product is in the reference.
"""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete

from backend.control import cascade
from backend.tuning import simulation
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import INPUTS, OUTPUTS, make_sampled_loop, planned_response
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters

Array = NDArray[np.float64]
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
    """Both motors turned against each other with the joint, or alike: x' = A x + B (u, τ_ext)."""

    A: Array
    B: Array

    def response(self, f: Array) -> Complex:
        """Of the whole state (n, states, 2), under inputs that are held over a tick."""
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
    """From motor reference and angle to voltage, and from reference and measurement to the outer loop's signal."""
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


def by_hand(signal: str, lam: float, f: Array = F) -> Complex:
    """Response of q to (q_ref, τ_ext), or of S to S_ref."""
    z = np.exp(2j * np.pi * f * T_s)
    of_reference, of_angle, outer, measured = laws(lam, 0.0854, z)
    if signal == "S":
        P = COMMON.response(f)[:, 0, 0]
        inner = P * of_reference / (1.0 + P * of_angle)
        return inner * outer / (1.0 + inner * measured)
    X = DIFFERENCE.response(f)
    gain = R_J / R_M
    found = []
    for k in range(f.size):  # θ and q as u and τ_ext move them, u as θ and q ask for it
        (q_u, q_tau), (th_u, th_tau) = X[k, 0], X[k, 2]
        A = np.array([[1.0 + q_u * of_reference[k] * gain * measured[k], q_u * of_angle[k]],
                      [th_u * of_reference[k] * gain * measured[k], 1.0 + th_u * of_angle[k]]])  # fmt: skip
        forward = of_reference[k] * gain * outer[k]
        found.append(np.linalg.solve(A, np.array([[q_u * forward, q_tau], [th_u * forward, th_tau]]))[0])
    return np.array(found)


@pytest.mark.parametrize("lam", [0.355, 0.5, 0.65])
def test_both_loops_answer_as_the_modes_written_out_do(lam: float) -> None:
    loop = make_sampled_loop(IDEAL, make_cascade_tuning(IDEAL, TuningParameters(lam_q=lam, lam_S=lam)), S).closed
    H = loop.response(F)
    np.testing.assert_allclose(H[:, OUTPUTS.q, [INPUTS.q_ref, INPUTS.tau_ext]], by_hand("q", lam), rtol=2e-4)
    np.testing.assert_allclose(H[:, OUTPUTS.S, INPUTS.S_ref], by_hand("S", lam), rtol=2e-4)
    np.testing.assert_allclose(H[:, OUTPUTS.S, INPUTS.q_ref], 0.0, atol=1e-6)


def test_without_the_joint_loop_a_torque_turns_the_joint_by_what_its_stiffness_says() -> None:
    loop = make_sampled_loop(IDEAL, make_cascade_tuning(IDEAL, TuningParameters()), S, position_loop=False).closed
    slow = np.abs(loop.response(np.array([1e-4]))[0, OUTPUTS.q, INPUTS.tau_ext])
    assert slow == pytest.approx(1.0 / S, rel=1e-3)


def test_a_push_is_answered_as_a_differential_equation_says() -> None:
    """Continuous laws integrated by another method: the sampling is 1 ms, the loops' lags are hundreds of them."""
    lam, lam_m, tau = 0.5, 0.0854, 0.75
    D = 4.0 * T_M - lam_m
    k_p, k_i = 4.0 * T_M**2 / (K_M * lam_m**2 * D), T_M**2 / (K_M * lam_m**3 * D)
    k_d, t_f = (6.0 * T_M**2 - lam_m * D) / (K_M * lam_m * D), T_M * lam_m / D
    T = 4.0 * lam_m

    def rate(_t: float, x: Array) -> Array:
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
    """Of q and S (2,) to a small sine of a reference: fitted over whole periods, after the transient."""
    ticks, before = period * max(round(3000 / period), 2), -(-8000 // period) * period
    phase = 2.0 * np.pi * np.arange(before + ticks) / period
    size, still = {"q": 0.004, "S": 0.02}[signal], np.zeros(phase.size)
    # No two samples in a row are alike: a reference that stands for a tick goes on as a small step (decision 0053).
    wave = size * np.sin(phase + 0.001)
    q_ref, S_ref = (wave, S + still) if signal == "q" else (still, S + wave)
    run = simulation.simulate_cascade(parameters, tuning, q_ref, S_ref)
    line = np.exp(-1j * phase)[before:]
    asked = (wave[before:] * line).sum()
    return np.array([(seen[before:] * line).sum() / asked for seen in (run.q, run.S)])


@pytest.mark.parametrize("sides", ["alike", "unlike"])
@pytest.mark.parametrize("u_plan", [0.0, 8.5])
@pytest.mark.parametrize("signal", ["q", "S"])
@pytest.mark.parametrize("period", [1000, 250])
def test_the_simulated_actuator_follows_a_small_sine_as_predicted(
    sides: str, u_plan: float, signal: str, period: int
) -> None:
    """The non-linear simulator with the tick's cascade, beside the linear loop in ticks."""
    parameters = IDEAL if sides == "alike" else UNLIKE
    tuning = make_cascade_tuning(parameters, TuningParameters(lam_q=0.4), u_plan=u_plan)
    f = np.array([1.0 / (period * T_s)])
    by = planned_response if u_plan else loop_response
    H = by(parameters, tuning, S, f)[0, :, {"q": 0, "S": 1}[signal]]
    measured = measured_response(parameters, tuning, signal, period)
    own = {"q": 0, "S": 1}[signal]
    # With a plan the integrator of S leaves alone what is less than 0.01 N·m/rad: all that is left of so small a sine.
    bounds = (1e-5, 2e-3 if u_plan else 1e-5)
    assert abs(measured[own] / H[own] - 1.0) < bounds[own]
    assert abs(measured[1 - own] - H[1 - own]) < bounds[1 - own]


def loop_response(parameters: PlantParameters, tuning: cascade.CascadeTuning, S: float, f: Array) -> Complex:
    return make_sampled_loop(parameters, tuning, S).closed.response(f)


def test_with_a_plan_lambda_hardly_matters_and_neither_lags_nor_gain_are_left() -> None:
    slow, fast = (
        planned_response(
            IDEAL, make_cascade_tuning(IDEAL, TuningParameters(lam_q=lam, lam_S=lam), u_plan=8.5), S, F[:3]
        )
        for lam in (0.4, 1.0)
    )
    np.testing.assert_allclose(np.abs(slow[:, [0, 1], [0, 1]]), 1.0, atol=1e-3)
    np.testing.assert_allclose(slow, fast, atol=2e-3)
