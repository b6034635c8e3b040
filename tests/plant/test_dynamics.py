"""The plant's differential equation: closed forms, an integrator and equations of the test's own, conservation laws."""

import math
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from plant.dynamics import (
    SUBSTEPS,
    Dynamics,
    PlantState,
    Spring,
    advance_state,
    elongation_A,
    elongation_B,
    joint_acceleration,
    joint_stiffness,
    polynomial_spring,
    tendon_tension,
)
from plant.interface import T_s
from plant.parameters import PlantParameters, load_parameters

IDEAL, LAB = load_parameters("ideal"), load_parameters("lab")
SLACK_THETA = -200.0
PAPER = polynomial_spring((-2.498, 331.49, 8543.8), 0.06, 1e5)
CUBIC = polynomial_spring((-2.0, 300.0, 7000.0, 4e4), 0.06, 1e5)

angles = st.floats(0.0, 9.0)
speeds = st.floats(-5.0, 5.0)
volts = st.floats(-10.0, 10.0)
states = st.builds(
    PlantState,
    q=st.floats(-0.6, 0.6), q_dot=speeds,
    theta_A=angles, omega_A=speeds, tau_A=st.just(0.0),
    theta_B=angles, omega_B=speeds, tau_B=st.just(0.0),
    z_A=st.just(0.0), z_B=st.just(0.0),
)  # fmt: skip


def test_motor_without_load_answers_as_the_transfer_function() -> None:
    """K_m/(s (T_m s + 1)) with the lag L/R in front, by partial fractions."""
    K_m, T_m, tau_e, U = IDEAL.motor.K_m, IDEAL.motor.T_m, IDEAL.motor.tau_e, 6.0
    plant = IDEAL.make_dynamics()
    x = PlantState(0.0, 0.0, SLACK_THETA, 0.0, 0.0, SLACK_THETA, 0.0, 0.0)
    for tick in range(1, 1001):
        x = advance_state(plant, x, U, -U, 0.0, T_s, SUBSTEPS)
        t = tick * T_s
        fast, slow = math.exp(-t / tau_e), math.exp(-t / T_m)
        speed = K_m * U * (1.0 - (T_m * slow - tau_e * fast) / (T_m - tau_e))
        turned = K_m * U * (t - T_m - tau_e + (T_m**2 * slow - tau_e**2 * fast) / (T_m - tau_e))
        assert x.omega_A == pytest.approx(speed, abs=1e-5)
        assert x.theta_A - SLACK_THETA == pytest.approx(turned, abs=1e-6)
        assert x.omega_B == pytest.approx(-speed, abs=1e-5)
        assert x.q == 0.0


def own_rate(p: PlantParameters, u_A: float, u_B: float, tau_ext: float, t: float, x: np.ndarray) -> list[float]:
    """Equations 1-16 of the method page, written anew from the numbers of the parameter file."""
    g, m, s, a = p.geometry, p.motor, p.spring, p.asymmetry
    q, dq, th_A, om_A, ta_A, th_B, om_B, ta_B, *bristles = x

    def F(elongated: float, factor: float) -> float:
        curve = np.polynomial.Polynomial(s.k)
        solid = max(elongated - s.x_solid, 0.0)
        return max(factor * float(curve(min(elongated, s.x_solid))), 0.0) + s.k_solid * solid

    F_A, F_B = F(g.r_m * th_A - g.r_j * q, a.spring_A), F(g.r_m * th_B + g.r_j * q, a.spring_B)
    B_m = m.K_t / m.K_m
    J_m = B_m * m.T_m

    def motor(om: float, ta: float, u: float, force: float, factor: float) -> tuple[float, float]:
        friction = (m.c0 + m.c1 * g.r_m * force) * math.tanh(om / m.omega_smooth)
        return (ta - B_m * om - g.r_m * force - friction) / J_m, (factor * m.K_t * u - ta) / m.tau_e

    dom_A, dta_A = motor(om_A, ta_A, u_A, F_A, a.motor_A)
    dom_B, dta_B = motor(om_B, ta_B, u_B, F_B, a.motor_B)
    ddq = (g.r_j * (F_A - F_B) - g.B_j * dq + tau_ext) / g.J_j
    return [dq, ddq, om_A, dom_A, dta_A, om_B, dom_B, dta_B, *np.zeros_like(bristles)]


@pytest.mark.parametrize("parameters", [IDEAL, LAB], ids=["ideal", "lab"])
def test_agrees_with_an_independent_integration(parameters: PlantParameters) -> None:
    """Both motors wind up, one pulls over until its spring is solid, both let go until the tendons hang slack."""
    plant, x = parameters.make_dynamics(), PlantState(0.05, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0)
    own, reached = np.array(x), []
    for u_A, u_B, tau_ext, ticks in ((4.0, 4.0, 0.0, 600), (9.0, 5.0, 0.5, 400), (-8.0, -8.0, 0.0, 700)):
        for _ in range(ticks):
            x = advance_state(plant, x, u_A, u_B, tau_ext, T_s, SUBSTEPS)
            F_A = tendon_tension(plant.spring_A, elongation_A(plant.joint, x.theta_A, x.q))
            reached.append(F_A)
        own = solve_ivp(
            partial(own_rate, parameters, u_A, u_B, tau_ext),
            (0.0, ticks * T_s), own, method="LSODA", rtol=1e-9, atol=1e-11, max_step=2e-3,
        ).y[:, -1]  # fmt: skip
        assert np.array(x) == pytest.approx(own, rel=1e-4, abs=1e-4)
    assert max(reached) > 55.0
    assert reached[-1] == 0.0


def energy(plant: Dynamics, x: PlantState) -> float:
    """Kinetic energy of joint and motors and what is stored in the springs [J]."""

    def stored(spring: Spring, elongated: float) -> float:
        integral = np.polynomial.Polynomial(spring.k).integ()
        end = min(max(elongated, spring.x_slack), spring.x_solid)
        solid = max(elongated - spring.x_solid, 0.0)
        return float(integral(end) - integral(spring.x_slack)) + solid * (spring.F_solid + 0.5 * spring.k_solid * solid)

    moving = plant.joint.J_j * x.q_dot**2 + plant.motor_A.J_m * x.omega_A**2 + plant.motor_B.J_m * x.omega_B**2
    return (
        0.5 * moving
        + stored(plant.spring_A, elongation_A(plant.joint, x.theta_A, x.q))
        + stored(plant.spring_B, elongation_B(plant.joint, x.theta_B, x.q))
    )


@settings(max_examples=40)
@given(states, st.booleans())
def test_unforced_plant_only_loses_energy(x: PlantState, friction: bool) -> None:
    plant = (LAB if friction else IDEAL).make_dynamics()
    before = energy(plant, x)
    for _ in range(20):
        x = advance_state(plant, x, 0.0, 0.0, 0.0, 5 * T_s, 5 * SUBSTEPS)
        now = energy(plant, x)
        assert now <= before + 1e-7 * (1.0 + before)
        before = now


def mirrored(x: PlantState) -> PlantState:
    return PlantState(-x.q, -x.q_dot, x.theta_B, x.omega_B, x.tau_B, x.theta_A, x.omega_A, x.tau_A)


@given(states, volts, volts, st.floats(-2.0, 2.0))
def test_swapping_A_and_B_mirrors_the_motion(x: PlantState, u_A: float, u_B: float, tau_ext: float) -> None:
    plant = LAB.make_dynamics()
    swapped = Dynamics(plant.joint, plant.motor_B, plant.motor_A, plant.spring_B, plant.spring_A)
    straight = advance_state(plant, x, u_A, u_B, tau_ext, 0.02, 20 * SUBSTEPS)
    reverse = advance_state(swapped, mirrored(x), u_B, u_A, -tau_ext, 0.02, 20 * SUBSTEPS)
    assert mirrored(reverse) == straight


@given(st.floats(3.0, 7.5), st.floats(-1.5, 1.5))
def test_joint_is_in_balance_at_equation_15(common: float, difference: float) -> None:
    plant = IDEAL.make_dynamics()
    theta_A, theta_B = common + difference, common - difference
    q_e = plant.joint.r_m * (theta_A - theta_B) / (2.0 * plant.joint.r_j)
    F_A = tendon_tension(plant.spring_A, elongation_A(plant.joint, theta_A, q_e))
    F_B = tendon_tension(plant.spring_B, elongation_B(plant.joint, theta_B, q_e))
    assert F_A > 0.0
    assert joint_acceleration(plant.joint, 0.0, F_A, F_B, 0.0) == pytest.approx(0.0, abs=1e-8)
    # A push towards +q is balanced by the other tendon: F_A − F_B = −F_push at rest.
    assert joint_acceleration(plant.joint, 0.0, F_A, F_A + 3.0, 3.0 * plant.joint.r_j) == pytest.approx(0.0, abs=1e-8)


@given(st.floats(4.5, 5.5), st.floats(4.5, 5.5), st.floats(-0.1, 0.1))
def test_stiffness_is_minus_the_slope_of_the_torque_off_equilibrium_too(
    theta_A: float, theta_B: float, q: float
) -> None:
    joint = IDEAL.make_dynamics().joint

    def torque(angle: float) -> float:
        F_A = tendon_tension(CUBIC, elongation_A(joint, theta_A, angle))
        return joint.r_j * (F_A - tendon_tension(PAPER, elongation_B(joint, theta_B, angle)))

    step = 1e-6
    by_difference = -(torque(q + step) - torque(q - step)) / (2.0 * step)
    S = joint_stiffness(joint, CUBIC, PAPER, elongation_A(joint, theta_A, q), elongation_B(joint, theta_B, q))
    assert by_difference == pytest.approx(S, rel=1e-6)


def test_friction_holds_still_what_the_tendon_alone_would_turn() -> None:
    """At zero volts the tendon unwinds a frictionless motor; friction above the load torque keeps it all but still."""
    turned = []
    for parameters in (IDEAL, replace(IDEAL, motor=replace(IDEAL.motor, c0=0.2))):
        x = PlantState(0.0, 0.0, 5.0, 0.0, 0.0, 5.0, 0.0, 0.0)
        x = advance_state(parameters.make_dynamics(), x, 0.0, 0.0, 0.0, 0.5, 500 * SUBSTEPS)
        turned.append(5.0 - x.theta_A)
    assert turned[0] > 0.4
    assert 0.0 < turned[1] < 0.02
