"""The whole plant with friction that sticks: an independent integration, energy, and what knows nothing of it."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from backend.tuning.gains import TuningParameters, make_feedback_linearization_tuning
from backend.tuning.simulation import make_simulated_rig, rest_state
from plant.dynamics import SUBSTEPS, PlantState, advance_state, state_derivative
from plant.interface import NO_LOAD, T_s
from plant.parameters import PlantParameters, load_parameters
from tests.plant.test_dynamics import energy

LAB, STICK = load_parameters("lab"), load_parameters("lab-stick")
UNLIKE = replace(STICK, sided={"motor_B": {"sigma_0": 0.0}})
"""Motor A sticks, the friction of motor B is smoothed."""

states = st.builds(
    PlantState,
    q=st.floats(-0.6, 0.6), q_dot=st.floats(-5.0, 5.0),
    theta_A=st.floats(0.0, 9.0), omega_A=st.floats(-5.0, 5.0), tau_A=st.just(0.0),
    theta_B=st.floats(0.0, 9.0), omega_B=st.floats(-5.0, 5.0), tau_B=st.just(0.0),
    z_A=st.just(0.0), z_B=st.just(0.0),
)  # fmt: skip


def own_rate(p: PlantParameters, u: tuple[float, float], tau_ext: float, t: float, x: np.ndarray) -> list[float]:
    """Equations 1-16 of the method page and LuGre's, written anew from the numbers of the parameter file."""
    g, s, a = p.geometry, p.spring, p.asymmetry
    q, dq, th_A, om_A, ta_A, th_B, om_B, ta_B, z_A, z_B = x

    def F(elongated: float, factor: float) -> float:
        curve = np.polynomial.Polynomial(s.k)
        solid = max(elongated - s.x_solid, 0.0)
        return max(factor * float(curve(min(elongated, s.x_solid))), 0.0) + s.k_solid * solid

    F_A, F_B = F(g.r_m * th_A - g.r_j * q, a.spring_A), F(g.r_m * th_B + g.r_j * q, a.spring_B)
    rates = [dq, (g.r_j * (F_A - F_B) - g.B_j * dq + tau_ext) / g.J_j]
    bent = []
    sides = (
        (p.select_motor("A"), om_A, ta_A, u[0], F_A, a.motor_A, z_A),
        (p.select_motor("B"), om_B, ta_B, u[1], F_B, a.motor_B, z_B),
    )
    for m, om, ta, volts, force, factor, z in sides:
        F_c = m.c0 + m.c1 * g.r_m * force
        if m.sigma_0 > 0.0:
            g_of_omega = F_c + (m.stiction_ratio * F_c - F_c) * math.exp(-((om / m.omega_s) ** 2))
            dz = om - m.sigma_0 * abs(om) / g_of_omega * z
            friction = m.sigma_0 * z + m.sigma_1 * dz
        else:
            dz, friction = 0.0, F_c * math.tanh(om / m.omega_smooth)
        B_m = m.K_t / m.K_m
        rates += [
            om,
            (ta - B_m * om - g.r_m * force - friction) / (B_m * m.T_m),
            (factor * m.K_t * volts - ta) / m.tau_e,
        ]
        bent.append(dz)
    return [*rates, *bent]


MOVES = (
    (4.0, 4.0, 0.0, 500), (9.0, 5.0, 0.5, 400), (0.0, 0.0, 0.0, 300), (1.0, 1.2, 0.0, 300),
    (1.0, 1.0, -0.2, 500), (-8.0, -8.0, 0.0, 500),
)  # fmt: skip
"""Voltages, torque at the joint and ticks: winding up, into the solid spring, hanging, breaking away, stuck, slack."""


@pytest.mark.parametrize("parameters", [STICK, UNLIKE], ids=["lab-stick", "one side sticks"])
def test_plant_with_friction_agrees_with_an_independent_integration(parameters: PlantParameters) -> None:
    """Within 2e-5 rad, 5e-4 rad/s and 1e-6 rad of the bristles, a stiff solver at tight tolerances beside it."""
    plant, x = parameters.make_dynamics(), PlantState(0.05, 0.0, 3.0, 0.0, 0.0, 3.0, 0.0, 0.0)
    own, slowest = np.array(x), math.inf
    bounds = np.array([2e-5, 5e-4, *2 * (2e-4, 5e-4, 1e-9), 1e-6, 1e-6])
    for u_A, u_B, tau_ext, ticks in MOVES:
        for _ in range(ticks):
            x = advance_state(plant, x, u_A, u_B, tau_ext, T_s, SUBSTEPS)
        own = solve_ivp(
            partial(own_rate, parameters, (u_A, u_B), tau_ext),
            (0.0, ticks * T_s), own, method="LSODA", rtol=1e-8, atol=1e-11, max_step=5e-3,
        ).y[:, -1]  # fmt: skip
        slowest = min(slowest, abs(x.omega_A))
        assert np.all(np.abs(np.array(x) - own) < bounds), np.abs(np.array(x) - own)
    assert slowest < 1e-4, "it has to have stuck for this to mean anything"


@settings(max_examples=40)
@given(states)
def test_unforced_it_only_loses_energy_what_bent_bristles_store_counted_in(x: PlantState) -> None:
    plant = STICK.make_dynamics()

    def stored(at: PlantState) -> float:
        return energy(plant, at) + 0.5 * STICK.motor.sigma_0 * (at.z_A**2 + at.z_B**2)

    before = stored(x)
    for _ in range(20):
        x = advance_state(plant, x, 0.0, 0.0, 0.0, 5 * T_s, 5 * SUBSTEPS)
        now = stored(x)
        assert now <= before + 1e-7 * (1.0 + before)
        before = now


def test_no_more_than_the_last_bit_tells_it_from_the_equation_it_integrates() -> None:
    x = PlantState(0.1, 0.5, 5.0, 0.2, 0.3, 4.0, -0.1, 0.2, 1e-3, -5e-4)
    ours = state_derivative(STICK.make_dynamics(), x, 1.0, 2.0, 0.1, NO_LOAD)
    assert list(ours) == pytest.approx(own_rate(STICK, (1.0, 2.0), 0.1, 0.0, np.array(x)), rel=1e-12)


def test_at_rest_it_rests_and_the_torques_alone_bear_the_tendons() -> None:
    plant = STICK.make_dynamics()
    x, u_A, u_B = rest_state(make_simulated_rig(STICK), 5.0, 4.0)
    assert (x.z_A, x.z_B) == (0.0, 0.0)
    after = x
    for _ in range(1000):
        after = advance_state(plant, after, u_A, u_B, 0.0, T_s, SUBSTEPS)
    assert list(after) == pytest.approx(list(x), abs=1e-9)


def test_what_the_controller_knows_has_no_friction_of_either_kind() -> None:
    assert STICK.make_identified_dynamics() == LAB.make_identified_dynamics()
    assert STICK.make_identified_dynamics().motor_A.friction.lugre is None
    x = PlantState(0.1, 0.5, 5.0, 0.2, 0.3, 4.0, -0.1, 0.2, 1e-3, -5e-4)
    rates = state_derivative(STICK.make_identified_dynamics(), x, 1.0, 2.0, 0.1, NO_LOAD)
    assert rates == state_derivative(
        LAB.make_identified_dynamics(), x._replace(z_A=0.0, z_B=0.0), 1.0, 2.0, 0.1, NO_LOAD
    )
    assert (rates.z_A, rates.z_B) == (0.0, 0.0)


def test_the_law_with_a_full_model_has_the_smoothed_friction_in_it() -> None:
    assert make_feedback_linearization_tuning(STICK, TuningParameters()).model == LAB.make_dynamics()
