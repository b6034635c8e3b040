"""The offline closed loop against the same equations written anew, integrated by SciPy at tight tolerances.

Plain Python on purpose, in the letters of the paper: plant (equations 1-16), governor, I-P, decoupler, I-PD.
"""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import SimulatedRig, at_rest, make_simulated_rig, simulate_cascade
from plant.parameters import PlantParameters, load_parameters

Array = NDArray[np.float64]
T = 1e-3


def exact_sensors(name: str) -> PlantParameters:
    """A parameter set whose sensors hide nothing: rounding of a count must not decide a comparison."""
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


def cascade_anew(parameters: PlantParameters, q_ref: Array, S_ref: Array) -> tuple[Array, Array, Array]:
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
        held = (u[0], u[1])
        end = solve_ivp(lambda _, at, u: rate(rig, at, u), (0.0, T), x, "DOP853", args=(held,), rtol=1e-11, atol=1e-13)
        x = end.y[:, -1]
    return np.array(qs), np.array(Ss), np.array(us)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_both_references_step(name: str) -> None:
    parameters = exact_sensors(name)
    ticks = 500
    q_ref, S_ref = np.full(ticks, 0.3), np.full(ticks, 11.0)
    q_ref[:20], S_ref[:20] = 0.0, 10.0
    trajectory = simulate_cascade(parameters, make_cascade_tuning(parameters, TuningParameters()), q_ref, S_ref)
    q, S, u = cascade_anew(parameters, q_ref, S_ref)
    assert np.ptp(trajectory.q) > 0.02, "the joint has to move for this to mean anything"
    assert trajectory.q == pytest.approx(q, abs=1e-8)
    assert pytest.approx(S, abs=1e-8) == trajectory.S
    assert np.column_stack((trajectory.u_A, trajectory.u_B)) == pytest.approx(u, abs=1e-6)
