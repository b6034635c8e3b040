"""Elastic mechanisms against numerical derivatives of their energy, published figures and symmetries."""

import cmath
import math
from collections.abc import Callable
from functools import partial
from itertools import product

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from plant.dynamics import PlantState, advance_state
from plant.mechanisms import (
    ANTAGONISTIC_AXES,
    SERIES_AXES,
    Bidirectional,
    Lever,
    Mechanism,
    MotorAxes,
    Pretension,
    TorqueTable,
    build_torque_table,
    compute_rest,
    elastic_energy,
    elastic_torques,
    motor_axes,
    tendon_axes,
)
from plant.parameters import load_parameters
from tests.reasons import assert_reason

Array = NDArray[np.float64]

QBMOVE = Bidirectional(0.0013, 0.0013, 8.9995, 0.00055, 0.00055, 8.9989)
BAVS = Bidirectional(0.3808, 0.1936, 8.71, 0.1936, 0.3808, 8.71)
AWAS = Lever(K_s=10.0, L=0.05, r_t=0.015, y_0=0.01, lead=0.002)
MACCEPA = Pretension(B=0.03, C=0.1, r=0.01, kappa=1500.0)

DELTA, PRESET = np.linspace(-0.5, 0.6, 23), np.linspace(0.0, 0.8, 9)


def tabulated(axes: MotorAxes) -> TorqueTable:
    """Return a table of the energy ½ (2 + 3 p²) δ² + δ⁴, whose torque and stiffness are polynomials."""
    d, p = np.meshgrid(DELTA, PRESET, indexing="ij")
    return build_torque_table(DELTA, PRESET, -(2.0 + 3.0 * p**2) * d - 4.0 * d**3, 2.0 + 3.0 * p**2 + 12.0 * d**2, axes)


MECHANISMS: dict[str, Mechanism] = {
    "qbmove": QBMOVE,
    "bavs": BAVS,
    "lever": AWAS,
    "pretension": MACCEPA,
    "table, antagonistic": tabulated(ANTAGONISTIC_AXES),
    "table, series": tabulated(SERIES_AXES),
}


def differentiate(function: Callable[..., float], at: tuple[float, float, float], along: int) -> float:
    """Return a partial derivative by Richardson extrapolation of central differences."""

    def difference(h: float) -> float:
        ahead, behind = list(at), list(at)
        ahead[along] += h
        behind[along] -= h
        return (function(*ahead) - function(*behind)) / (2.0 * h)

    rows = [[difference(4e-3 / 2.0**k)] for k in range(4)]
    for k in range(1, 4):
        for j in range(1, k + 1):
            rows[k].append(rows[k][j - 1] + (rows[k][j - 1] - rows[k - 1][j - 1]) / (4.0**j - 1.0))
    return rows[3][3]


@pytest.mark.parametrize("name", MECHANISMS)
def test_torques_loads_and_stiffness_are_derivatives_of_the_energy(name: str) -> None:
    mechanism = MECHANISMS[name]
    # inside cells of the table, so that the differences do not cross their edges
    for q, theta_A, theta_B in product((-0.113, 0.031), (-0.087, 0.143), (0.253, 0.343)):
        at = (q, theta_A, theta_B if motor_axes(mechanism) == SERIES_AXES else theta_A - theta_B)
        tau, load_A, load_B, S = elastic_torques(mechanism, *at)
        energy = partial(elastic_energy, mechanism)
        assert tau == pytest.approx(-differentiate(energy, at, 0), abs=1e-8)
        assert load_A == pytest.approx(differentiate(energy, at, 1), abs=1e-8)
        assert load_B == pytest.approx(differentiate(energy, at, 2), abs=1e-8)
        assert pytest.approx(-differentiate(lambda *x: elastic_torques(mechanism, *x)[0], at, 0), abs=1e-8) == S


@pytest.mark.parametrize("name", MECHANISMS)
def test_a_common_turn_of_joint_and_motors_changes_no_torque(name: str) -> None:
    mechanism = MECHANISMS[name]
    axes = motor_axes(mechanism)
    at = (0.05, 0.1 + 0.3 * axes.n_A, 0.3 * axes.n_B)
    turned = (at[0] + 0.7, at[1] + 0.7 * axes.g_A, at[2] + 0.7 * axes.g_B)
    assert elastic_torques(mechanism, *turned) == pytest.approx(elastic_torques(mechanism, *at), rel=1e-12)


@pytest.mark.parametrize("axes", [ANTAGONISTIC_AXES, SERIES_AXES, tendon_axes(0.01, 0.025)])
def test_the_axes_are_inverse_to_each_other(axes: MotorAxes) -> None:
    forth = np.array([[axes.g_A, axes.n_A], [axes.g_B, axes.n_B]])
    back = np.array([[axes.v_A, axes.v_B], [axes.w_A, axes.w_B]])
    assert back @ forth == pytest.approx(np.eye(2), abs=1e-15)


def stiffness_at_rest(mechanism: Mechanism, preset: float) -> float:
    axes = motor_axes(mechanism)
    return elastic_torques(mechanism, 0.0, axes.n_A * preset, axes.n_B * preset)[3]


def test_published_stiffnesses_are_reproduced() -> None:
    """qbmove: Advanced manual. BAVS: Petit 2015. AwAS-II: Jafari 2014."""
    assert stiffness_at_rest(QBMOVE, 0.0) == pytest.approx(0.033, abs=5e-4)
    assert stiffness_at_rest(QBMOVE, 0.6) == pytest.approx(3.7, abs=0.05)
    assert stiffness_at_rest(BAVS, 0.0) == pytest.approx(10.0, abs=0.05)
    for y, S in ((0.005, 2.7), (0.010, 13.9), (0.020, 99.0)):
        assert stiffness_at_rest(AWAS, (y - AWAS.y_0) / AWAS.lead) == pytest.approx(S, rel=0.02)


def test_the_lever_has_no_stiffness_at_45_degrees() -> None:
    assert elastic_torques(AWAS, math.pi / 4.0, 0.0, 1.0)[3] == pytest.approx(0.0, abs=1e-12)


def test_pretension_at_zero_deflection_has_the_published_stiffness() -> None:
    """At α = 0 the spring of length C − B is stretched by r θ_B: S = κ B C (r θ_B)/(C − B)."""
    S = 1500.0 * 0.03 * 0.1 * 0.01 * 2.0 / 0.07
    assert elastic_torques(MACCEPA, 0.2, 0.2, 2.0) == pytest.approx((0.0, 0.0, 1500.0 * 0.01 * 0.02, S))


def test_a_table_reproduces_its_points() -> None:
    table = tabulated(SERIES_AXES)
    for d, p in product(DELTA, PRESET):
        energy = elastic_energy(table, d, 0.0, p)
        tau, _, load, S = elastic_torques(table, d, 0.0, p)
        assert tau == pytest.approx(-(2.0 + 3.0 * p**2) * d - 4.0 * d**3, abs=1e-12)
        assert pytest.approx(2.0 + 3.0 * p**2 + 12.0 * d**2, abs=1e-10) == S
        assert energy == pytest.approx((1.0 + 1.5 * p**2) * d**2 + d**4, abs=1e-12)
        if 0.0 < p < PRESET[-1]:  # at the ends the derivative over the preset is one-sided
            assert load == pytest.approx(3.0 * p * d**2, abs=1e-12)


@pytest.mark.parametrize(
    ("delta", "preset", "torque", "code"),
    [
        ([0.0, 0.1], [0.0, 1.0, 2.0], [[0.0, 0.0, 0.0], [-1.0, -1.0, -1.0]], "torque_table_too_small"),
        ([-0.1, 0.0, 0.1], [0.0, 1.0, 2.0], [[0.0, 0.0], [0.0, 0.0], [0.0, 0.0]], "torque_table_of_wrong_shape"),
        ([-0.1, 0.0, 0.1], [0.0, 1.0, 1.0], 3 * [[0.0, 0.0, 0.0]], "torque_table_does_not_rise"),
        ([0.1, 0.2, 0.3], [0.0, 1.0, 2.0], 3 * [[0.0, 0.0, 0.0]], "torque_table_without_zero"),
        ([-0.1, 0.0, 0.1], [0.0, 1.0, 2.0], 3 * [[0.0, math.nan, 0.0]], "torque_table_not_finite"),
    ],
)
def test_an_unusable_table_is_refused(
    delta: list[float], preset: list[float], torque: list[list[float]], code: str
) -> None:
    tau = np.array(torque)
    with pytest.raises(ValueError) as refused:  # noqa: PT011 - the code is asserted below
        build_torque_table(np.array(delta), np.array(preset), tau, np.ones_like(tau), SERIES_AXES)
    assert_reason(refused.value.args[0], code)


# The plant with each mechanism against an integrator of SciPy. The energies are written a second time, for complex
# numbers: the imaginary part of E(x + i h)/h is the derivative, without rounding of differences.


def qbmove_energy(q: complex, theta_A: complex, theta_B: complex) -> complex:
    k, a = (0.0026, 0.0011), (8.9995, 8.9989)
    return sum(k[i] / a[i] * cmath.cosh(a[i] * (q - theta)) for i, theta in enumerate((theta_A, theta_B)))


def bavs_energy(q: complex, theta_A: complex, theta_B: complex) -> complex:
    k, kappa, a, b = 1.6e5, 8.71, 1.21e-6, 2.38e-6
    d_1, d_2 = kappa * (theta_A - q), kappa * (theta_B - q)
    return k / kappa * (b * cmath.exp(d_1) + a * cmath.exp(-d_1) + a * cmath.exp(d_2) + b * cmath.exp(-d_2))


def awas2_energy(q: complex, theta_A: complex, theta_B: complex) -> complex:
    y = 0.01 + 2e-3 * theta_B
    alpha = 0.05 / 0.015 * y / (0.05 - y)
    return 10.0 * alpha**2 * cmath.sin(q - theta_A) ** 2


def maccepa_energy(q: complex, theta_A: complex, theta_B: complex) -> complex:
    B, C = 0.03, 0.10
    length = cmath.sqrt(B**2 + C**2 - 2.0 * B * C * cmath.cos(theta_A - q))
    return 0.5 * 4000.0 * (length + 0.01 * theta_B - (C - B)) ** 2


ENERGIES = {"qbmove": qbmove_energy, "bavs": bavs_energy, "awas2": awas2_energy, "maccepa": maccepa_energy}
START = PlantState(
    q=0.1, q_dot=0.3, theta_A=0.18, omega_A=0.5, tau_A=0.2, theta_B=0.4, omega_B=-0.4, tau_B=-0.1, z_A=0.0, z_B=0.0
)
VOLTS, TAU_EXT = (1.5, -0.8), 0.05


@pytest.mark.parametrize("name", ENERGIES)
def test_the_plant_moves_as_an_independent_integration_of_its_energy(name: str) -> None:
    parameters, energy = load_parameters(name), ENERGIES[name]
    g, motor = parameters.geometry, parameters.motor
    start = START if parameters.axes == SERIES_AXES else START._replace(theta_B=-0.1)

    def slope(at: Array, along: int) -> float:
        angles = [complex(at[0]), complex(at[2]), complex(at[5])]
        angles[along] += 1e-30j
        return energy(*angles).imag / 1e-30

    def friction(omega: float, load: float) -> float:
        return (motor.c0 + motor.c1 * abs(load)) * math.tanh(omega / motor.omega_smooth)

    def rate(_: float, x: Array) -> list[float]:
        B_m = motor.K_t / motor.K_m
        changes = [x[1], (-slope(x, 0) + TAU_EXT - g.B_j * x[1]) / g.J_j]
        for at, along, u in ((2, 1, VOLTS[0]), (5, 2, VOLTS[1])):
            load = slope(x, along)
            torque = x[at + 2] - B_m * x[at + 1] - load - friction(x[at + 1], load)
            changes += [x[at + 1], torque / (B_m * motor.T_m), (motor.K_t * u - x[at + 2]) / motor.tau_e]
        return changes

    x = np.array(start[:8])
    exact = solve_ivp(rate, (0.0, 0.02), x, method="DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
    reached = advance_state(
        plant=parameters.make_dynamics(),
        x=start,
        u_A=VOLTS[0],
        u_B=VOLTS[1],
        tau_ext=TAU_EXT,
        duration_s=0.02,
        substeps=20_000,
    )
    assert np.array(reached[:8]) == pytest.approx(exact, abs=1e-8)


def test_an_asymmetric_pair_of_springs_moves_the_rest_position() -> None:
    """(1/2a) ln[(k1 e^(a p) + k2 e^(−a p))/(k1 e^(−a p) + k2 e^(a p))], 48 mrad at a high preset."""
    k_1, k_2, a = 0.0026, 0.0011, 9.0
    springs = Bidirectional(k_1 / 2.0, k_1 / 2.0, a, k_2 / 2.0, k_2 / 2.0, a)
    for p in (0.05, 0.2, 0.6):
        up, down = math.exp(a * p), math.exp(-a * p)
        q = math.log((k_1 * up + k_2 * down) / (k_1 * down + k_2 * up)) / (2.0 * a)
        assert compute_rest(springs, p)[0] == pytest.approx(q, abs=1e-12)
    qbmove = load_parameters("qbmove").mechanism
    assert qbmove is not None
    assert compute_rest(qbmove.make_mechanism(), 0.6)[0] == pytest.approx(0.048, abs=5e-4)
