"""The simulated closed loop against independent computations."""

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from backend.control import pid
from backend.control.decoupler import Envelope
from backend.tuning import simulation
from backend.tuning.gains import TuningParameters, make_cascade_tuning, make_motor_loops, motor_model
from backend.tuning.robustness import motor_robustness
from backend.tuning.simulation import SimulatedRig, at_rest, make_simulated_rig, simulate_cascade
from plant.interface import MotorCommand, T_s
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.bench.c_twin import CTwin

# The offline closed loop against a second implementation, which SciPy integrates with tight tolerances.
#
# The implementation is plain Python in the notation of the paper: plant (equations 1-16), governor, I-P, decoupler,
# I-PD.

Array = NDArray[np.float64]
T = 1e-3


def exact_sensors(name: str) -> PlantParameters:
    """Return a parameter set with exact sensors, which do not round to counts."""
    return replace(load_parameters(name), sensors=load_parameters("ideal").sensors)


def rate(rig: SimulatedRig, x: Array, u: tuple[float, float]) -> list[float]:
    q, w, *motors = x
    joint, r_m, r_j = rig.plant.joint, rig.plant.joint.r_m, rig.plant.joint.r_j
    k_A, k_B = rig.plant.spring_A.k, rig.plant.spring_B.k
    x_A, x_B = r_m * motors[0] - r_j * q, r_m * motors[3] + r_j * q
    F = [k_A[0] + k_A[1] * x_A + k_A[2] * x_A**2, k_B[0] + k_B[1] * x_B + k_B[2] * x_B**2]
    rates = [w, (r_j * (F[0] - F[1]) - joint.B_j * w) / joint.J_j]
    for side, motor in enumerate((rig.plant.motor_A, rig.plant.motor_B)):
        _, omega, tau = motors[3 * side : 3 * side + 3]
        load = r_m * F[side]
        coulomb = (motor.friction.c0 + motor.friction.c1 * load) * math.tanh(omega / motor.friction.omega_smooth)
        rates += [
            omega,
            (tau - motor.B_m * omega - load - coulomb) / motor.J_m,
            (motor.K_t * u[side] - tau) / motor.tau_e,
        ]
    return rates


def reference_simulation(parameters: PlantParameters, q_ref: Array, S_ref: Array) -> tuple[Array, Array, Array]:
    """Return q, S and voltages (ticks, 2)."""
    tuning, rig = make_cascade_tuning(parameters, TuningParameters()), make_simulated_rig(parameters)
    d = tuning.decoupler
    r_m, r_j, k_1, k_2 = d.r_m, d.r_j, d.k_1, d.k_2
    _, p_q, i_q, r_q, p_S, i_S, r_S = tuning.schedule.entries[0]
    p, i, d_gain, t_f = tuning.motors.A
    start, controller = at_rest(rig, tuning, q_ref[0], S_ref[0])
    x, (qg, Sg) = np.array(start[:8]), controller.governor
    I_q, I_S = controller.position.integral, controller.stiffness.integral
    inner = [list(controller.motors.A), list(controller.motors.B)]
    a = math.exp(-T / t_f)
    per_S = 1.0 / (4.0 * k_2 * r_j**2 * r_m)
    qs, Ss, us = [], [], []
    for q_wanted, S_wanted in zip(q_ref, S_ref, strict=True):
        to_go = abs(r_j / r_m * (q_wanted - qg)) + abs(per_S * (S_wanted - Sg))
        share = min(1.0, tuning.omega_max * T / to_go) if to_go > 0.0 else 1.0
        qg, Sg = qg + share * (q_wanted - qg), Sg + share * (S_wanted - Sg)
        q, theta = x[0], (x[2], x[5])
        S = 2.0 * r_j**2 * (k_1 + k_2 * r_m * (theta[0] + theta[1]))
        q_c, S_c = I_q + r_q * qg - p_q * q, I_S + r_S * Sg - p_S * S
        I_q, I_S = I_q + T * i_q * (qg - q), I_S + T * i_S * (Sg - S)
        both = (S_c - 2.0 * k_1 * r_j**2) * per_S
        u = []
        for loop, y, r in zip(inner, theta, (both + r_j / r_m * q_c, both - r_j / r_m * q_c), strict=True):
            integral, filtered, y_f = loop
            filtered, y_f = integral + a * (filtered - integral), y + a * (y_f - y)
            u.append(filtered - p * y_f - d_gain / t_f * (y - y_f))
            loop[:] = integral + T * i * (r - y), filtered, y_f
        assert max(map(abs, u)) < 10.0, "nothing may saturate here"
        qs.append(q)
        Ss.append(S)
        us.append(u)
        voltages = (u[0], u[1])
        end = solve_ivp(
            lambda _, at, u: rate(rig, at, u), (0.0, T), x, "DOP853", args=(voltages,), rtol=1e-11, atol=1e-13
        )
        x = end.y[:, -1]
    return np.array(qs), np.array(Ss), np.array(us)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_simulated_steps_match_an_independent_integration(name: str) -> None:
    parameters = exact_sensors(name)
    ticks = 500
    q_ref, S_ref = np.full(ticks, 0.3), np.full(ticks, 11.0)
    q_ref[:20], S_ref[:20] = 0.0, 10.0
    trajectory = simulate_cascade(parameters, make_cascade_tuning(parameters, TuningParameters()), q_ref, S_ref)
    q, S, u = reference_simulation(parameters, q_ref, S_ref)
    assert np.ptp(trajectory.q) > 0.02, "the joint has to move for this to mean anything"
    assert trajectory.q == pytest.approx(q, abs=1e-8)
    assert pytest.approx(S, abs=1e-8) == trajectory.S
    assert np.column_stack((trajectory.u_A, trajectory.u_B)) == pytest.approx(u, abs=1e-6)


# The C implementation that the benchmark compares with computes the same as the offline closed loop.


@pytest.mark.skipif(shutil.which("gcc") is None, reason="the twin is compiled by gcc")
@pytest.mark.parametrize("name", ["ideal", "lab"])
@pytest.mark.parametrize("pushed_N", [5.0, 30.0])
def test_the_c_twin_computes_the_same_trajectory(name: str, pushed_N: float, tmp_path: Path) -> None:
    parameters = load_parameters(name)
    tuning = make_cascade_tuning(parameters, TuningParameters())._replace(u_max=4.0)
    q_ref, S_ref = np.repeat([-1.0, 1.0, 1.0], [2000, 800, 800]), np.repeat([10.0, 10.0, 14.0], [2000, 800, 800])
    F_push = np.concatenate((np.zeros(1200), np.linspace(0.0, pushed_N, 2400)))
    rig = simulation.make_simulated_rig(parameters)
    x, controller = simulation.at_rest(rig, tuning, -1.0, 10.0)
    inputs = simulation.make_closed_loop_inputs(parameters, q_ref, S_ref, F_push=F_push, seed=7)
    line, mine = simulation.empty_arrays(q_ref.size)
    other, unlimited = np.full_like(mine, np.nan), np.full_like(mine, np.nan)
    simulation.simulate(rig, tuning, x, controller, inputs, line, mine)
    CTwin(tmp_path, ["-O2"]).simulate(rig, tuning, x, controller, inputs, other)
    u_A = mine[:, simulation.COLUMNS.index("u_A")]
    assert np.max(np.abs(u_A)) == 4.0, "the anti-windup has to act for this to mean anything"
    without = tuning._replace(envelope=Envelope(-1e3, 1e3, 1e3))
    simulation.simulate(rig, without, x, controller, inputs, line, unlimited)
    assert np.array_equal(mine, unlimited) == (pushed_N < 10.0), "only the strong push has to reach the envelope"
    always_integrating = tuning.reference_tracking._replace(dead_zone_q=0.0, dead_zone_S=0.0)
    simulation.simulate(
        rig, tuning._replace(reference_tracking=always_integrating), x, controller, inputs, line, unlimited
    )
    assert np.array_equal(mine, unlimited) == (name == "ideal"), "the dead zones at rest have to act on lab"
    assert other == pytest.approx(mine, abs=1e-9)


# Displayed M_s and margins of the motor loop, against the behaviour of Sinew's I-PD controller on the simulator.

SINES = np.geomspace(12.0, 160.0, 18).reshape(-1, 2)
"""Test frequencies of motor A and motor B [rad/s]; slack tendons decouple the motors."""

AMPLITUDE = 0.02 / len(SINES)


@pytest.fixture(scope="module")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


def read_encoders(
    parameters: PlantParameters, gains: pid.MotorPairGains, errors: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return encoder angles (ticks, 2) [rad] with ``errors`` added; slack tendons."""
    simulator, state = Simulator(parameters), pid.at_rest_motor_pair(gains, 0.0, 0.0, 0.0, 0.0)
    read = np.empty_like(errors)
    for k, (error_A, error_B) in enumerate(errors):
        m = simulator.read()
        read[k] = m.theta_A + error_A, m.theta_B + error_B
        y, state = pid.step_motor_pair(gains, state, 0.0, 0.0, read[k, 0], read[k, 1], parameters.motor.u_max)
        assert y.excess_A == y.excess_B == 0.0, "a clipped voltage measures nothing"
        simulator.write(MotorCommand(y.u_A, y.u_B))
    return read


@pytest.mark.parametrize("lam", [0.05, 0.065, 0.0854, 0.11, 0.15])
def test_displayed_M_s_matches_the_measured_sensitivity_peak(ideal: PlantParameters, lam: float) -> None:
    gains, settled = make_motor_loops(ideal, lam), round(12.0 * lam / T_s)
    t = np.arange(settled + 1600) * T_s
    sines = np.sin(SINES[:, :, np.newaxis] * t)
    read = read_encoders(ideal, gains, AMPLITUDE * sines.sum(axis=0).T)[settled:]
    measured = 0.0
    for motor in (0, 1):
        angle = np.outer(t[settled:], SINES[:, motor])
        waves = np.linalg.lstsq(np.hstack([np.sin(angle), np.cos(angle)]), read[:, motor])[0].reshape(2, -1)
        measured = max(measured, float(np.max(np.hypot(*waves))) / AMPLITUDE)
    assert motor_robustness(motor_model(ideal, "A"), gains.A).M_s == pytest.approx(measured, rel=0.01)


@pytest.mark.parametrize("lam", [0.05, 0.0854, 0.15])
def test_displayed_gain_margin_matches_the_stability_limit_of_the_loop(ideal: PlantParameters, lam: float) -> None:
    law = make_motor_loops(ideal, lam).A
    margin = motor_robustness(motor_model(ideal, "A"), law).gain_margin
    assert is_unstable(ideal, scale_gains(law, 1.05 * margin), 0.9)
    assert not is_unstable(ideal, scale_gains(law, 0.95 * margin), 0.9)


def test_displayed_gain_reduction_matches_the_limit_of_a_conditionally_stable_loop(ideal: PlantParameters) -> None:
    law = make_motor_loops(ideal, 0.05).A
    least = motor_robustness(motor_model(ideal, "A"), law).gain_reduction
    assert is_unstable(ideal, scale_gains(law, 0.7 * least), 7.5)
    assert not is_unstable(ideal, scale_gains(law, 1.4 * least), 7.5)
    assert motor_robustness(motor_model(ideal, "A"), make_motor_loops(ideal, 0.0854).A).gain_reduction == 0.0


def scale_gains(law: pid.IPDGains, factor: float) -> pid.IPDGains:
    return pid.IPDGains(factor * law.k_p, factor * law.k_i, factor * law.k_d, law.t_f)


def is_unstable(parameters: PlantParameters, law: pid.IPDGains, duration_s: float) -> bool:
    """Return whether an error of 1e-9 rad in the first sample grows."""
    errors = np.zeros((3 * round(duration_s / 3.0 / T_s), 2))
    errors[0] = 1e-9
    _, middle, last = np.split(np.abs(read_encoders(parameters, pid.MotorPairGains(law, law), errors)), 3)
    return float(last.max()) > float(middle.max())
