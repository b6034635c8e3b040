"""The plant's differential equation: joint, springs, load at the shaft, wall."""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.interpolate import PchipInterpolator
from scipy.optimize import brentq

from plant import messages
from plant.dynamics import (
    K_LEAST,
    NO_OBSTACLE,
    SUBSTEPS,
    Dynamics,
    Joint,
    Obstacle,
    PlantState,
    Spring,
    advance_state,
    contact_force,
    elongation_A,
    elongation_B,
    joint_acceleration,
    joint_stiffness,
    largest_wall_damping,
    largest_wall_stiffness,
    polynomial_spring,
    require_possible_wall,
    require_stiffening,
    spring_curvature,
    spring_elongation,
    spring_polynomial,
    spring_slope,
    tabulated_spring,
    tendon_tension,
    tendon_tension_slope,
)
from plant.interface import NO_LOAD, ZERO_VOLTS, MotorCommand, PlantError, ShaftLoad, T_s
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.reasons import assert_reason
from tests.refusals import refused

# The plant's differential equation: closed forms, an integrator and equations of the test's own, conservation laws.

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


def test_an_unloaded_motor_responds_like_its_transfer_function() -> None:
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
def test_the_dynamics_agree_with_an_independent_integration(parameters: PlantParameters) -> None:
    """Both motors wind up, one pulls until its spring is solid, both release until the tendons are slack."""
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
def test_an_unforced_plant_only_loses_energy(x: PlantState, friction: bool) -> None:
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
def test_the_joint_is_in_equilibrium_at_equation_15(common: float, difference: float) -> None:
    plant = IDEAL.make_dynamics()
    theta_A, theta_B = common + difference, common - difference
    q_e = plant.joint.r_m * (theta_A - theta_B) / (2.0 * plant.joint.r_j)
    F_A = tendon_tension(plant.spring_A, elongation_A(plant.joint, theta_A, q_e))
    F_B = tendon_tension(plant.spring_B, elongation_B(plant.joint, theta_B, q_e))
    assert F_A > 0.0
    assert joint_acceleration(plant.joint, 0.0, plant.joint.r_j * (F_A - F_B), 0.0) == pytest.approx(0.0, abs=1e-8)
    # A push towards +q is balanced by the other tendon: F_A − F_B = −F_push at rest.
    assert joint_acceleration(plant.joint, 0.0, -3.0 * plant.joint.r_j, 3.0 * plant.joint.r_j) == pytest.approx(
        0.0, abs=1e-8
    )


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


def test_friction_holds_a_motor_that_the_tendon_alone_would_turn() -> None:
    """At zero volts the tendon unwinds a frictionless motor; friction above the load torque almost stops it."""
    turned = []
    for parameters in (IDEAL, replace(IDEAL, motor=replace(IDEAL.motor, c0=0.2))):
        x = PlantState(0.0, 0.0, 5.0, 0.0, 0.0, 5.0, 0.0, 0.0)
        x = advance_state(parameters.make_dynamics(), x, 0.0, 0.0, 0.0, 0.5, 500 * SUBSTEPS)
        turned.append(5.0 - x.theta_A)
    assert turned[0] > 0.4
    assert 0.0 < turned[1] < 0.02


# A load at the gearbox shaft: closed form, energy, independent integration, rejected values.

LOAD_NM = 0.375
SLACK = PlantState(0.0, 0.0, SLACK_THETA, 0.0, 0.0, SLACK_THETA, 0.0, 0.0)


@pytest.fixture(scope="module")
def ideal_shaft_load() -> PlantParameters:
    return load_parameters("ideal")


def test_a_load_turns_a_free_motor_by_the_closed_form_and_energy_is_balanced(
    ideal_shaft_load: PlantParameters,
) -> None:
    """J w' + B w = -load from rest; work of the load = kinetic energy + energy lost in the damping."""
    motor = ideal_shaft_load.make_dynamics().motor_A
    x, T_m, ticks = SLACK, motor.J_m / motor.B_m, 1000
    speeds = []
    for tick in range(1, ticks + 1):
        x = advance_state(ideal_shaft_load.make_dynamics(), x, 0.0, 0.0, 0.0, T_s, SUBSTEPS, ShaftLoad(LOAD_NM, 0.0))
        t = tick * T_s
        assert x.omega_A == pytest.approx(-LOAD_NM / motor.B_m * -math.expm1(-t / T_m), rel=1e-9)
        assert x.theta_A - SLACK_THETA == pytest.approx(-LOAD_NM / motor.B_m * (t + T_m * math.expm1(-t / T_m)))
        speeds.append(x.omega_A)
    assert (x.theta_B, x.omega_B, x.q) == (SLACK_THETA, 0.0, 0.0)
    work = LOAD_NM * (SLACK_THETA - x.theta_A)
    lost = motor.B_m * np.trapezoid(np.square([0.0, *speeds]), dx=T_s)
    assert work == pytest.approx(0.5 * motor.J_m * x.omega_A**2 + lost, rel=1e-5)


def test_loads_with_tendons_and_friction_agree_with_an_independent_integration() -> None:
    """A load adds to the force on the reel, and therefore to the friction."""
    p, x = LAB, PlantState(0.05, 0.0, 5.0, 0.0, 0.0, 5.0, 0.0, 0.0)
    own, B_m = np.array(x), LAB.motor.K_t / LAB.motor.K_m

    def loaded(t: float, y: np.ndarray, loads: ShaftLoad) -> np.ndarray:
        rate = np.array(own_rate(p, 3.0, 2.0, 0.0, t, y))
        for at, load in ((3, loads.load_A), (6, loads.load_B)):
            felt = load * (1.0 + p.motor.c1 * math.tanh(y[at] / p.motor.omega_smooth))
            rate[at] -= felt / (B_m * p.motor.T_m)
        return rate

    for loads in (ShaftLoad(LOAD_NM, 0.1), NO_LOAD, ShaftLoad(0.0, LOAD_NM)):
        for _ in range(300):
            x = advance_state(p.make_dynamics(), x, 3.0, 2.0, 0.0, T_s, SUBSTEPS, loads)
        end = solve_ivp(loaded, (0.0, 0.3), own, args=(loads,), method="LSODA", rtol=1e-9, atol=1e-11, max_step=2e-3)
        own = end.y[:, -1]
        assert np.array(x) == pytest.approx(own, rel=1e-4, abs=1e-4)


def test_a_simulated_load_acts_from_the_next_period_until_it_is_changed(ideal_shaft_load: PlantParameters) -> None:
    simulator = Simulator(ideal_shaft_load, x=SLACK)
    simulator.load(ShaftLoad(0.0, LOAD_NM))
    simulator.write(ZERO_VOLTS)
    assert simulator.x == advance_state(
        ideal_shaft_load.make_dynamics(), SLACK, 0.0, 0.0, 0.0, T_s, SUBSTEPS, ShaftLoad(0.0, LOAD_NM)
    )
    simulator.load(NO_LOAD)
    before = simulator.x
    simulator.write(ZERO_VOLTS)
    assert simulator.x == advance_state(ideal_shaft_load.make_dynamics(), before, 0.0, 0.0, 0.0, T_s, SUBSTEPS)


@pytest.mark.parametrize("load", [ShaftLoad(-0.1, 0.0), ShaftLoad(0.0, math.nan)])
def test_a_load_that_pushes_its_tendon_is_rejected(ideal_shaft_load: PlantParameters, load: ShaftLoad) -> None:
    load_A, load_B = (pytest.approx(torque, nan_ok=True) for torque in load)
    with refused(PlantError, "shaft_load_negative", load_A=load_A, load_B=load_B):
        Simulator(ideal_shaft_load).load(load)


# The spring against the paper's figures, against numpy's polynomials and SciPy's interpolation.

K = (-2.498, 331.49, 8543.8)
CUBIC_SPRING = (-2.0, 300.0, 7000.0, 40_000.0)
PAPER_SPRING = polynomial_spring(K, 0.06135, 1e5)
r_j = 75e-3


def table_of(k: tuple[float, ...], rows: int) -> tuple[np.ndarray, np.ndarray]:
    curve = np.polynomial.Polynomial(k)
    x = np.linspace(max(curve.roots().real), 0.062, rows)
    F = curve(x)
    F[0] = 0.0
    return x, F


def test_spring_force_and_root_match_the_paper() -> None:
    assert tendon_tension(PAPER_SPRING, 0.06135) == pytest.approx(50.0, abs=0.01)
    assert pytest.approx(6.46e-3, abs=5e-6) == PAPER_SPRING.x_slack


@pytest.mark.parametrize(("F", "S"), [(10.0, 8.24), (20.0, 10.55), (30.0, 12.43), (40.0, 14.06)])
def test_stiffness_at_the_nominal_tensions(F: float, S: float) -> None:
    x = spring_elongation(PAPER_SPRING, F)
    assert tendon_tension(PAPER_SPRING, x) == pytest.approx(F, abs=1e-9)
    assert 2.0 * r_j**2 * tendon_tension_slope(PAPER_SPRING, x) == pytest.approx(S, abs=0.006)


def test_the_least_stiffness_of_taut_tendons_is_that_of_erratum_E8() -> None:
    assert 2.0 * r_j**2 * spring_slope(PAPER_SPRING, PAPER_SPRING.x_slack) == pytest.approx(4.97, abs=0.005)


@pytest.mark.parametrize("k", [K, CUBIC_SPRING, (-2.0, 300.0, 7000.0, 4e4, 1e5, 2e6)])
def test_polynomials_of_order_2_to_5_and_their_derivatives(k: tuple[float, ...]) -> None:
    spring, curve = polynomial_spring(k, 0.05, 1e5), np.polynomial.Polynomial(k)
    for x in np.linspace(0.008, 0.0499, 17):
        assert tendon_tension(spring, x) == pytest.approx(curve(x), rel=1e-12)
        assert tendon_tension_slope(spring, x) == pytest.approx(curve.deriv()(x), rel=1e-12)
        assert spring_curvature(spring, x) == pytest.approx(curve.deriv(2)(x), rel=1e-12)


@pytest.mark.parametrize("k", [K, CUBIC_SPRING])
def test_a_table_is_the_monotone_cubic_of_scipy(k: tuple[float, ...]) -> None:
    x, F = table_of(k, 12)
    spring, reference = tabulated_spring(x, F, 0.06, 1e5), PchipInterpolator(x, F)
    for value in np.linspace(x[0] + 1e-6, 0.06, 97):
        assert tendon_tension(spring, value) == pytest.approx(reference(value), abs=1e-10)
        assert tendon_tension_slope(spring, value) == pytest.approx(reference(value, 1), abs=1e-8)
    assert pytest.approx(reference(0.06), abs=1e-10) == spring.F_solid


@pytest.fixture(params=["polynomial", "table"])
def spring(request: pytest.FixtureRequest) -> Spring:
    return PAPER_SPRING if request.param == "polynomial" else tabulated_spring(*table_of(CUBIC_SPRING, 9), 0.06, 1e5)


def test_tendon_force_is_never_negative_and_never_decreases(spring: Spring) -> None:
    forces = np.array([tendon_tension(spring, x) for x in np.linspace(-0.2, 0.2, 2001)])
    assert forces[0] == 0.0
    assert np.all(np.diff(forces) >= 0.0)
    assert tendon_tension_slope(spring, spring.x_slack - 1e-9) == 0.0


def test_a_solid_spring_is_steep_and_continuous(spring: Spring) -> None:
    beyond, before = tendon_tension(spring, spring.x_solid + 1e-9), tendon_tension(spring, spring.x_solid - 1e-9)
    assert beyond == pytest.approx(before, abs=1e-3)
    assert tendon_tension(spring, spring.x_solid + 1e-3) == pytest.approx(spring.F_solid + 100.0)
    assert tendon_tension_slope(spring, spring.x_solid + 1e-6) > 50.0 * spring_slope(spring, spring.x_solid)


@given(st.floats(0.1, 49.9))
def test_elongation_inverts_tension(F: float) -> None:
    assert tendon_tension(PAPER_SPRING, spring_elongation(PAPER_SPRING, F)) == pytest.approx(F, rel=1e-12)


@contextmanager
def value_refused(message: str) -> Iterator[None]:
    with pytest.raises(ValueError, match=re.escape(message)):
        yield


@pytest.mark.parametrize("F", [-1.0, 0.0, 51.0])
def test_elongation_rejects_tensions_beyond_the_spring(F: float) -> None:
    with value_refused(messages.tension_outside_spring(F=F, F_solid=50.0)):
        spring_elongation(PAPER_SPRING, F)


def test_curves_that_do_not_rise_are_rejected() -> None:
    with value_refused(messages.spring_without_root(x_solid=0.06)):
        polynomial_spring((3.0, 300.0, 8000.0), 0.06, 1e5)
    with pytest.raises(ValueError, match=r"0\.05") as falling:
        polynomial_spring((-2.0, 400.0, 5000.0, -1e5), 0.06, 1e5)
    assert_reason(falling.value.args[0], "spring_falls", x_solid=0.06, x=pytest.approx(0.05, abs=0.01))
    x, F = table_of(K, 8)
    F[4] = F[3]
    with value_refused(messages.spring_table_falls(row=4, x=x[3], F=F[3])):
        tabulated_spring(x, F, 0.06, 1e5)


def test_a_curve_may_have_any_shape_below_its_root() -> None:
    """Its minimum may lie just below the root, where the tendon is slack."""
    k2, lowest, depth = 8000.0, 6e-3, 8e-7
    spring = polynomial_spring((k2 * lowest**2 - depth, -2.0 * k2 * lowest, k2), 0.06, 1e5)
    assert spring.x_slack == pytest.approx(lowest + (depth / k2) ** 0.5)


def test_unusable_tables_are_rejected() -> None:
    x, F = table_of(K, 8)
    with value_refused(messages.spring_table_of_wrong_shape(x=(2,), F=(2,))):
        tabulated_spring(x[:2], F[:2], 0.06, 1e5)
    with value_refused(messages.spring_table_not_finite()):
        tabulated_spring(x, np.where(F > 30.0, np.nan, F), 0.06, 1e5)
    with value_refused(messages.spring_table_not_from_zero(F=1.0)):
        tabulated_spring(x, F + 1.0, 0.06, 1e5)
    with value_refused(messages.x_solid_outside_table(x_solid=0.07, lowest=x[0], highest=x[-1])):
        tabulated_spring(x, F, 0.07, 1e5)


def test_a_spring_that_does_not_stiffen_cannot_set_stiffness() -> None:
    require_stiffening(PAPER_SPRING)
    require_stiffening(tabulated_spring(*table_of(CUBIC_SPRING, 9), 0.06, 1e5))
    with pytest.raises(ValueError, match="x = ") as straight:
        require_stiffening(polynomial_spring((-2.0, 300.0, 0.0), 0.06, 1e5))
    assert_reason(straight.value.args[0], "spring_does_not_stiffen")
    x, F = table_of(K, 9)
    F[4] += 1.0
    with pytest.raises(ValueError, match="x = ") as uneven:
        require_stiffening(tabulated_spring(x, F, 0.06, 1e5))
    assert_reason(uneven.value.args[0], "spring_does_not_stiffen")


def test_the_polynomial_is_evaluated_for_slack_tendons_too(ideal: PlantParameters) -> None:
    assert spring_polynomial(ideal.make_identified_spring("A"), 0.0) == pytest.approx(K[0])
    assert load_parameters("lab").make_dynamics().spring_A.k == pytest.approx([0.985 * k for k in K])


def test_a_table_with_uneven_steps_is_also_the_cubic_of_scipy() -> None:
    x = np.array([0.0, 0.004, 0.006, 0.02, 0.023, 0.05, 0.062])
    F = np.array([0.0, 1.0, 2.5, 9.0, 12.0, 40.0, 60.0])
    spring, reference = tabulated_spring(x, F, 0.06, 1e5), PchipInterpolator(x, F)
    for value in np.linspace(1e-6, 0.06, 211):
        assert tendon_tension(spring, value) == pytest.approx(reference(value), abs=1e-10)
        assert tendon_tension_slope(spring, value) == pytest.approx(reference(value, 1), abs=1e-8)


# An obstacle: closed forms of an impact, energy, rejected values, and no change without an obstacle.

LAB_OBSTACLE = load_parameters("lab")
H = T_s / SUBSTEPS
WALL = Obstacle(1.0, 0.3, 2e4, 0.0)
NAN = pytest.approx(math.nan, nan_ok=True)


def free() -> Dynamics:
    """The plant with its tendons slack and no friction at the joint: a mass m = J_j/r_j² at r_j."""
    plant = LAB_OBSTACLE.make_dynamics()
    return plant._replace(joint=plant.joint._replace(B_j=0.0))


def mass(joint: Joint) -> float:
    return joint.J_j / joint.r_j**2


def thrown(q: float, q_dot: float) -> PlantState:
    return PlantState(q, q_dot, SLACK_THETA, 0.0, 0.0, SLACK_THETA, 0.0, 0.0)


def flight(wall: Obstacle, q_dot: float, start: float = 0.0) -> tuple[np.ndarray, PlantState]:
    """Forces [N] in each integration step from before the contact until well after it, and the final state."""
    plant, x = free(), thrown(wall.q_wall - wall.side * start, wall.side * q_dot)
    forces = []
    for _ in range(4000):
        x = advance_state(plant, x, 0.0, 0.0, 0.0, H, 1, NO_LOAD, wall)
        forces.append(contact_force(wall, plant.joint, x.q, x.q_dot))
        if len(forces) > 3 and forces[-1] == 0.0 and x.q_dot * wall.side < 0.0:
            break
    return np.array(forces), x


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("k", "q_dot"), [(2e3, 0.5), (2e4, 2.0), (3.3e4, 3.0)])
def test_a_free_mass_on_an_undamped_wall_has_a_half_sine_contact_force(side: float, k: float, q_dot: float) -> None:
    wall = Obstacle(side, side * 0.3, k, 0.0)
    joint = free().joint
    for start in (0.0, 0.3 * H * q_dot, 0.7 * H * q_dot):
        forces, x = flight(wall, q_dot, start)
        v = joint.r_j * q_dot
        assert np.all(side * forces <= 0.0)
        assert np.abs(forces).max() == pytest.approx(v * math.sqrt(k * mass(joint)), rel=4e-3)
        duration_s = H * np.count_nonzero(forces)
        assert duration_s == pytest.approx(math.pi * math.sqrt(mass(joint) / k), abs=1.1 * H)
        assert side * x.q_dot == pytest.approx(-q_dot, rel=3e-3)
        assert H * np.abs(forces).sum() == pytest.approx(2.0 * mass(joint) * v, rel=5e-3)


@pytest.mark.parametrize("c", [0.5, 3.0, 7.0])
@pytest.mark.parametrize("q_dot", [0.5, 2.0])
def test_the_rebound_speed_follows_the_closed_form_for_any_stiffness(c: float, q_dot: float) -> None:
    r_j, v = LAB_OBSTACLE.geometry.r_j, LAB_OBSTACLE.geometry.r_j * q_dot

    def left(w: float) -> float:
        return (-c * w - math.log1p(-c * w)) - (c * v - math.log1p(c * v))

    back = brentq(left, 0.0, min(v, (1.0 - 1e-12) / c))
    for k in (3e3, 3e4):
        _, x = flight(Obstacle(1.0, 0.3, k, c), q_dot)
        assert -r_j * x.q_dot == pytest.approx(back, rel=5e-3)


@settings(max_examples=200, deadline=None)
@given(
    st.floats(K_LEAST, 3.3e4), st.floats(0.0, 7.0), st.floats(0.01, 20.0), st.floats(0.0, 1.0), st.sampled_from([-1, 1])
)
def test_an_obstacle_never_returns_more_energy_than_it_received(
    k: float, c: float, q_dot: float, part: float, side: int
) -> None:
    """Within the error of the integration step of the contact: a thousandth of the energy, anywhere in the step."""
    wall = Obstacle(float(side), 0.2 * side, k, c)
    plant, x = free(), thrown(0.2 * side - side * part * H * q_dot, side * q_dot)
    before = energy(plant, x)
    for _ in range(400):
        x = advance_state(plant, x, 0.0, 0.0, 0.0, T_s, SUBSTEPS, NO_LOAD, wall)
        depth = max(plant.joint.r_j * wall.side * (x.q - wall.q_wall), 0.0)
        assert energy(plant, x) + 0.5 * k * depth**2 <= 1.003 * before


@given(st.floats(0.0, 1.5), st.floats(-30.0, 30.0), st.floats(0.0, 7.0), st.sampled_from([-1.0, 1.0]))
def test_an_obstacle_only_pushes_away_from_itself(q: float, q_dot: float, c: float, side: float) -> None:
    wall = Obstacle(side, 0.4, 2e4, c)
    force = contact_force(wall, LAB_OBSTACLE.make_dynamics().joint, q, q_dot)
    assert side * force <= 0.0
    assert (force == 0.0) or side * (q - 0.4) > 0.0
    assert contact_force(NO_OBSTACLE, LAB_OBSTACLE.make_dynamics().joint, q, q_dot) == 0.0


def test_the_integration_is_stable_at_the_bounds_of_the_obstacle() -> None:
    joint, F_max = LAB_OBSTACLE.make_dynamics().joint, LAB_OBSTACLE.safety.F_max
    assert math.sqrt(largest_wall_stiffness(joint, H) / mass(joint)) * H == pytest.approx(0.15)
    assert largest_wall_damping(joint, F_max, H) * F_max * H / mass(joint) == pytest.approx(1.0)
    wall = Obstacle(1.0, 0.3, largest_wall_stiffness(joint, H), largest_wall_damping(joint, F_max, H))
    pressed, x = 50.0, thrown(0.29, 3.0)
    plant = LAB_OBSTACLE.make_dynamics()
    for _ in range(400):
        x = advance_state(plant, x, 0.0, 0.0, joint.r_j * pressed, T_s, SUBSTEPS, NO_LOAD, wall)
    assert contact_force(wall, joint, x.q, x.q_dot) == pytest.approx(-pressed, rel=1e-6)


@pytest.mark.parametrize(
    ("wall", "code", "values"),
    [
        (WALL._replace(side=0.5), "obstacle_side_invalid", {"side": 0.5}),
        (WALL._replace(side=math.nan), "obstacle_side_invalid", {"side": NAN}),
        (
            WALL._replace(q_wall=1.6),
            "obstacle_angle_out_of_range",
            {"q_wall": 1.6, "minimum": pytest.approx(-math.pi / 2.0), "maximum": pytest.approx(math.pi / 2.0)},
        ),
        (WALL._replace(q_wall=math.nan), "obstacle_angle_out_of_range", {"q_wall": NAN}),
        (
            WALL._replace(k_wall=4e4),
            "obstacle_stiffness_out_of_range",
            {"k_wall": 4e4, "minimum": 100.0, "maximum": pytest.approx(33280.0)},
        ),
        (WALL._replace(k_wall=50.0), "obstacle_stiffness_out_of_range", {"k_wall": 50.0, "minimum": 100.0}),
        (WALL._replace(k_wall=math.inf), "obstacle_stiffness_out_of_range", {"k_wall": math.inf}),
        (
            WALL._replace(c_wall=-0.1),
            "obstacle_damping_out_of_range",
            {"c_wall": -0.1, "minimum": 0.0, "maximum": pytest.approx(7.39556, abs=1e-5)},
        ),
        (WALL._replace(c_wall=8.0), "obstacle_damping_out_of_range", {"c_wall": 8.0}),
        (WALL._replace(q_wall=-0.1), "joint_inside_obstacle", {"q": 0.0, "q_wall": -0.1, "side": 1.0}),
        (WALL._replace(q_wall=0.1, side=-1.0), "joint_inside_obstacle", {"q": 0.0, "q_wall": 0.1, "side": -1.0}),
    ],
)
def test_an_invalid_obstacle_is_rejected_and_the_old_one_remains(
    wall: Obstacle, code: str, values: dict[str, object]
) -> None:
    simulator = Simulator(LAB_OBSTACLE)
    simulator.obstacle(WALL)
    with refused(PlantError, code, **values):
        simulator.obstacle(wall)
    assert simulator.simulated.field("obstacle").get() == WALL
    require_possible_wall(
        WALL, LAB_OBSTACLE.make_dynamics().joint, LAB_OBSTACLE.safety.F_max, LAB_OBSTACLE.geometry.q_max, H
    )


def test_an_obstacle_can_change_in_motion_and_its_force_is_measured() -> None:
    simulator = Simulator(LAB_OBSTACLE)
    simulator.open()
    assert simulator.read().F_wall == 0.0
    simulator.obstacle(WALL._replace(q_wall=0.05))
    simulator.push(20.0)
    for _ in range(400):
        simulator.write(MotorCommand(0.0, 0.0))
    m = simulator.read()
    assert m.F_wall == pytest.approx(-20.0, rel=1e-3)
    assert m.q == pytest.approx(0.05 + 20.0 / 2e4 / LAB_OBSTACLE.geometry.r_j, abs=2e-3)
    simulator.obstacle(None)
    for _ in range(100):
        simulator.write(MotorCommand(0.0, 0.0))
    assert (simulator.read().F_wall, simulator.read().q > 0.2) == (0.0, True)


@pytest.mark.parametrize("name", ["ideal", "lab", "lab-stick"])
def test_an_untouched_obstacle_changes_no_bit(name: str) -> None:
    bare, walled = Simulator(load_parameters(name), seed=3), Simulator(load_parameters(name), seed=3)
    walled.obstacle(WALL._replace(q_wall=1.57))
    random = np.random.default_rng(5)
    for tick in range(5000):
        if tick % 200 == 0:
            command = MotorCommand(*random.uniform(0.0, 2.0, 2))
            for simulator in (bare, walled):
                simulator.push(float(tick % 7))
        for simulator in (bare, walled):
            simulator.write(command)
        assert bare.x == walled.x
        assert bare.read() == walled.read()
    assert bare.x.q != 0.0
