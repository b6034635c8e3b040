"""The decoupler and the envelope of its inputs."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from backend.control import decoupler
from backend.control.decoupler import (
    OFFSET,
    PRESET,
    Decoupler,
    Envelope,
    EnvelopeState,
    build_decoupler,
    build_equilibrium_table,
    equilibrium,
    motor_positions,
    rates,
    stiffness,
    stiffness_slope,
    stiffness_under,
)
from plant.parameters import PlantParameters, load_parameters

# The decoupler against equations 18-21 written anew, and against equilibria that SciPy finds on the curves.

r_m, r_j = 7.5e-3, 75e-3
QUADRATIC = (-2.498, 331.49, 8543.8)
CUBIC = (-2.0, 300.0, 7000.0, 40_000.0)
STIFFER = (-2.9, 350.0, 9300.0)

positions = st.floats(-1.4, 1.4)
stiffnesses = st.floats(8.0, 14.5)


def points_of(k: tuple[float, ...]) -> tuple[tuple[float, float], ...]:
    curve = np.polynomial.Polynomial(k)
    x = np.linspace(max(curve.roots().real), 0.0625, 14)
    return ((float(x[0]), 0.0), *((float(at), float(curve(at))) for at in x[1:]))


def with_springs(A: tuple[float, ...], B: tuple[float, ...], tabulated_B: bool = False) -> PlantParameters:
    known_B = {"k": (), "points": points_of(B)} if tabulated_B else {"k": B, "points": ()}
    return replace(load_parameters("ideal"), sided={"identified_A": {"k": A, "points": ()}, "identified_B": known_B})


PAPER = build_decoupler(with_springs(QUADRATIC, QUADRATIC))
LIKE_CUBIC = build_decoupler(with_springs(CUBIC, CUBIC))
UNLIKE = build_decoupler(with_springs(CUBIC, STIFFER))
WITH_TABLE = build_decoupler(with_springs(QUADRATIC, CUBIC, tabulated_B=True))

decouplers = pytest.mark.parametrize(
    "d", [PAPER, LIKE_CUBIC, UNLIKE, WITH_TABLE], ids=["paper", "cubic", "unlike", "table"]
)


@given(positions, stiffnesses)
def test_like_quadratic_springs_follow_equations_18_to_21(q: float, S: float) -> None:
    _, k_1, k_2 = QUADRATIC
    D = np.array(
        [
            [r_j / r_m, 1.0 / (4.0 * r_j**2 * r_m * k_2), -k_1 / (2.0 * k_2 * r_m)],
            [-r_j / r_m, 1.0 / (4.0 * r_j**2 * r_m * k_2), -k_1 / (2.0 * k_2 * r_m)],
        ]
    )
    assert motor_positions(PAPER, q, S) == pytest.approx(D @ [q, S, 1.0], rel=1e-12, abs=1e-12)


def test_the_closed_form_is_used_only_where_it_is_valid() -> None:
    assert Decoupler(r_m, r_j, *QUADRATIC) == PAPER
    assert build_decoupler(load_parameters("lab")).table is None
    for d in (LIKE_CUBIC, UNLIKE, WITH_TABLE):
        assert d.table is not None


@decouplers
@given(q=positions, S=stiffnesses)
def test_the_decoupler_and_its_inverse_cancel_exactly(d: Decoupler, q: float, S: float) -> None:
    theta_A, theta_B = motor_positions(d, q, S)
    assert stiffness(d, theta_A, theta_B) == pytest.approx(S, rel=1e-12)
    assert equilibrium(d, theta_A, theta_B) == pytest.approx(q, abs=1e-12)


@decouplers
@given(theta_A=st.floats(-2.0, 12.0), theta_B=st.floats(-2.0, 12.0))
def test_the_inverse_and_the_decoupler_cancel_beyond_the_range_of_the_springs(
    d: Decoupler, theta_A: float, theta_B: float
) -> None:
    q, S = equilibrium(d, theta_A, theta_B), stiffness(d, theta_A, theta_B)
    assert motor_positions(d, q, S) == pytest.approx((theta_A, theta_B), abs=1e-9)


@pytest.mark.parametrize(("A", "B", "d"), [(CUBIC, CUBIC, LIKE_CUBIC), (CUBIC, STIFFER, UNLIKE)])
@given(q=positions, S=stiffnesses)
def test_the_joint_rests_at_the_decoupled_position_and_stiffness(
    A: tuple[float, ...], B: tuple[float, ...], d: Decoupler, q: float, S: float
) -> None:
    F_A, F_B = np.polynomial.Polynomial(A), np.polynomial.Polynomial(B)
    theta_A, theta_B = motor_positions(d, q, S)
    q_e = brentq(lambda at: F_A(r_m * theta_A - r_j * at) - F_B(r_m * theta_B + r_j * at), q - 0.02, q + 0.02)
    x_A, x_B = r_m * theta_A - r_j * q_e, r_m * theta_B + r_j * q_e
    assert q_e == pytest.approx(q, abs=1e-6)
    assert r_j**2 * (F_A.deriv()(x_A) + F_B.deriv()(x_B)) == pytest.approx(S, abs=1e-5)


def test_for_like_quadratic_springs_the_table_matches_the_closed_form() -> None:
    spring = load_parameters("ideal").make_identified_spring("A")
    by_table = Decoupler(r_m, r_j, np.nan, np.nan, np.nan, build_equilibrium_table(spring, spring, r_m, r_j))
    for q, S in ((0.0, 8.24), (1.0, 10.55), (-0.7, 12.43), (0.2, 14.06)):
        assert motor_positions(by_table, q, S) == pytest.approx(motor_positions(PAPER, q, S), abs=1e-7)


@given(positions, stiffnesses)
def test_swapping_the_springs_mirrors_the_motors(q: float, S: float) -> None:
    swapped = build_decoupler(with_springs(STIFFER, CUBIC))
    theta_A, theta_B = motor_positions(UNLIKE, q, S)
    assert motor_positions(swapped, -q, S) == pytest.approx((theta_B, theta_A), abs=1e-6)


@pytest.mark.parametrize("more", [1e-2, 1e-5])
def test_the_table_of_two_springs_does_not_depend_on_their_order(more: float) -> None:
    """However small their difference: the table ends where the weaker spring becomes solid."""
    k_0, k_1, k_2, k_3 = CUBIC
    stronger = k_0, (1.0 + more) * k_1, (1.0 + more) * k_2, (1.0 + more) * k_3
    pair = with_springs(CUBIC, stronger)
    A, B = pair.make_identified_spring("A"), pair.make_identified_spring("B")
    there, back = build_equilibrium_table(A, B, r_m, r_j), build_equilibrium_table(B, A, r_m, r_j)
    back[:, OFFSET] *= -1.0
    np.testing.assert_array_equal(there, back)


@decouplers
@given(q=positions, S=stiffnesses, rate_A=st.floats(-20.0, 20.0), rate_B=st.floats(-20.0, 20.0))
def test_rates_are_the_derivatives(d: Decoupler, q: float, S: float, rate_A: float, rate_B: float) -> None:
    theta_A, theta_B = motor_positions(d, q, S)
    dt = 1e-6
    before = theta_A - dt * rate_A, theta_B - dt * rate_B
    after = theta_A + dt * rate_A, theta_B + dt * rate_B
    q_rate, S_rate = rates(d, theta_A, theta_B, rate_A, rate_B)
    # Across a corner of the table the two-sided difference lies between the two pieces' slopes, 0.2 % apart.
    assert (equilibrium(d, *after) - equilibrium(d, *before)) / (2.0 * dt) == pytest.approx(q_rate, rel=3e-3, abs=1e-3)
    assert (stiffness(d, *after) - stiffness(d, *before)) / (2.0 * dt) == pytest.approx(S_rate, rel=3e-3, abs=1e-3)


@pytest.mark.parametrize(("k", "d"), [(QUADRATIC, PAPER), (CUBIC, LIKE_CUBIC)])
def test_stiffness_slope_of_one_motor(k: tuple[float, ...], d: Decoupler) -> None:
    """With one motor turning, each spring has half of it: dS/dθ = r_j² r_m F''."""
    curve = np.polynomial.Polynomial(k)
    for S in (8.24, 10.55, 14.06):
        x = brentq(lambda at, S=S: 2.0 * r_j**2 * curve.deriv()(at) - S, 0.005, 0.07)
        assert stiffness_slope(d, S) == pytest.approx(r_j**2 * r_m * curve.deriv(2)(x), rel=1e-3)


def test_the_table_rises_monotonically() -> None:
    for d in (LIKE_CUBIC, UNLIKE, WITH_TABLE):
        assert d.table is not None
        steps = np.diff(d.table, axis=0)
        assert np.all(steps[:, :2] > 0.0)
        assert steps[:, PRESET] == pytest.approx(steps[0, PRESET])


# The envelope of the inputs: the stiffness of each tension limit, and the effect of a push.

PARAMETERS = load_parameters("ideal")
D = build_decoupler(PARAMETERS)
BOUNDS = Envelope(F_floor=4.0, F_ceiling=48.0, q_max=1.4)
AT_REST = EnvelopeState(0.0)


@pytest.mark.parametrize(("tension", "S"), [(10.0, 8.24), (20.0, 10.55), (30.0, 12.43), (40.0, 14.06)])
def test_nominal_points_of_the_paper(tension: float, S: float) -> None:
    assert stiffness_under(D, tension) == pytest.approx(S, abs=0.01)


def test_the_stiffness_table_matches_the_closed_form() -> None:
    spring = PARAMETERS.make_identified_spring("A")
    table = build_equilibrium_table(spring, spring, D.r_m, D.r_j)
    by_table = Decoupler(D.r_m, D.r_j, math.nan, math.nan, math.nan, table)
    for tension in np.linspace(0.5, 49.5, 50):
        assert stiffness_under(by_table, tension) == pytest.approx(stiffness_under(D, tension), abs=1e-5)


def test_references_inside_the_envelope_are_unchanged() -> None:
    y, _ = decoupler.step_envelope(BOUNDS, D, AT_REST, 1.0, 10.0, 18.0, 18.0)
    assert y == (1.0, 10.0, False, False, False)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_bound_of_the_envelope_holds_and_sets_its_flag(side: float) -> None:
    y, _ = decoupler.step_envelope(BOUNDS, D, AT_REST, side * 1.5, 6.0, 4.0, 4.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 4.0))
    assert (y.q_c, y.at_floor, y.at_ceiling, y.at_range) == (side * 1.4, True, False, True)
    y, _ = decoupler.step_envelope(BOUNDS, D, AT_REST, side * 0.2, 16.0, 40.0, 40.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 48.0))
    assert (y.q_c, y.at_floor, y.at_ceiling, y.at_range) == (side * 0.2, False, True, False)


@pytest.mark.parametrize("pull", [12.0, -12.0])
def test_a_push_narrows_the_envelope_by_half_its_force_at_both_ends(pull: float) -> None:
    state = EnvelopeState(pull)
    y, state = decoupler.step_envelope(BOUNDS, D, state, 0.0, 6.0, 20.0 + pull / 2.0, 20.0 - pull / 2.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 10.0))
    y, _ = decoupler.step_envelope(BOUNDS, D, state, 0.0, 16.0, 20.0 + pull / 2.0, 20.0 - pull / 2.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 42.0))


def test_the_ceiling_of_the_envelope_overrides_the_floor() -> None:
    y, _ = decoupler.step_envelope(BOUNDS, D, EnvelopeState(60.0), 0.0, 12.0, 80.0, 20.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 18.0))
    assert (y.at_floor, y.at_ceiling) == (False, True)


def test_the_force_difference_follows_the_load_cells_with_its_time_constant() -> None:
    state = AT_REST
    for _ in range(50):
        _, state = decoupler.step_envelope(BOUNDS, D, state, 0.0, 10.0, 15.0, 5.0)
    assert state.force_difference == pytest.approx(10.0 * (1.0 - math.exp(-1.0)))
