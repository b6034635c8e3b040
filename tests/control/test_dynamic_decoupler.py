"""The compiled step of the dynamic decoupler against its equations, solved in other ways."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import signal

from backend.control import dynamic_decoupler
from backend.control.dynamic_decoupler import (
    COLUMNS,
    NO_FILTER,
    NO_LIMITS,
    NO_STATIC_PART,
    STATIC_ONLY,
    DynamicDecoupler,
    DynamicDecouplerState,
    HighPassSection,
    InputLimits,
    ResidualFilter,
    ResidualState,
    SecondOrderSection,
    StaticPart,
    at_rest,
    bumpless,
    follow_inputs,
    interpolate_decoupler,
    solve_inputs,
    step,
)

FIRST = ResidualFilter(HighPassSection(0.03, 2e-4, 0.4, 0.003), SecondOrderSection(0.05, 6e-4, 0.6, 0.02, 6e-4))
SECOND = ResidualFilter(HighPassSection(0.02, 1e-4, -0.5, -0.004), SecondOrderSection(0.08, 1.5e-3, 0.9, 0.1, 1.5e-3))
COUPLED = DynamicDecoupler(FIRST, SECOND, StaticPart(1.1, 0.2, -0.5, 1.1))
OTHER = DynamicDecoupler(SECOND, FIRST, StaticPart(0.9, -0.1, 0.3, 1.0))


def in_powers_of_z(r: ResidualFilter) -> tuple[np.ndarray, np.ndarray]:
    """Return numerator and denominator of a filter in powers of z."""
    delta = np.poly1d([1.0, -1.0])
    first = np.poly1d([r.first.b_0, r.first.b_1, 0.0])(delta), np.poly1d([1.0, r.first.a_1, r.first.a_2])(delta)
    second = np.poly1d(r.second[2:])(delta), np.poly1d([1.0, *r.second[:2]])(delta)
    return (first[0] * second[0]).coeffs, (first[1] * second[1]).coeffs


def follow(d: DynamicDecoupler, inputs: np.ndarray) -> np.ndarray:
    """Return the contributions of the filters for inputs (n, 2) that are applied from rest at zero."""
    state, rows = at_rest(0.0, 0.0), []
    for q_c, S_c in inputs:
        # Solve for v: the filters' outputs are what is missing to the inputs.
        zero_q, zero_S = solve_inputs(d, state, 0.0, 0.0, NO_LIMITS)
        one_q, one_S = solve_inputs(d, state, 1.0, 0.0, NO_LIMITS)
        two_q, two_S = solve_inputs(d, state, 0.0, 1.0, NO_LIMITS)
        gain = np.array([[one_q - zero_q, two_q - zero_q], [one_S - zero_S, two_S - zero_S]])
        v = np.linalg.solve(gain, [q_c - zero_q, S_c - zero_S])
        rows.append([q_c - v[0], S_c - v[1]])
        state = follow_inputs(d, state, q_c, S_c)
    return np.array(rows)


def test_the_filters_equal_their_transfer_functions() -> None:
    inputs = np.random.default_rng(3).standard_normal((300, 2))
    M = np.array([[1.1, 0.2], [-0.5, 1.1]])
    driven = inputs @ M.T
    expected = np.column_stack(
        [signal.lfilter(*in_powers_of_z(FIRST), driven[:, 1]), signal.lfilter(*in_powers_of_z(SECOND), driven[:, 0])]
    )
    assert np.max(np.abs(follow(COUPLED, inputs) - expected)) < 1e-9


def test_both_outputs_of_a_step_satisfy_their_equations_without_delay() -> None:
    v = np.random.default_rng(4).standard_normal((200, 2))
    state, inputs = at_rest(0.0, 0.0), []
    for v_q, v_S in v:
        q_c, S_c, state = step(COUPLED, state, v_q, v_S)
        inputs.append([q_c, S_c])
    assert np.max(np.abs(np.array(inputs) - v - follow(COUPLED, np.array(inputs)))) < 1e-11


def test_without_filters_the_inputs_pass_unchanged() -> None:
    state = at_rest(0.3, 9.0)
    for v_q, v_S in np.random.default_rng(5).standard_normal((50, 2)):
        q_c, S_c, state = step(STATIC_ONLY, state, v_q, v_S)
        assert (q_c, S_c) == pytest.approx((v_q, v_S), abs=1e-14)


# Rest and changes of filters -----------------------------------------------------------------------


@given(q=st.floats(-1.5, 1.5), S=st.floats(7.0, 16.0))
def test_rest_does_not_depend_on_the_filters(q: float, S: float) -> None:
    state = at_rest(q, S)
    for d in (COUPLED, OTHER, STATIC_ONLY, COUPLED):
        for _ in range(3):
            q_c, S_c, state = step(d, state, q, S)
            assert (q_c, S_c) == (q, S)


def test_a_change_of_filters_after_a_motion_came_to_rest_leaves_the_outputs_unchanged() -> None:
    state = at_rest(0.0, 8.0)
    for k in range(6000):
        q_c, S_c, state = step(COUPLED, state, min(1.0, 0.01 * k), 8.0 + min(2.0, 0.02 * k))
    assert (q_c, S_c) == pytest.approx((1.0, 10.0), abs=1e-12)
    for _ in range(100):
        q_c, S_c, state = step(OTHER, state, 1.0, 10.0)
        assert (q_c, S_c) == pytest.approx((1.0, 10.0), abs=1e-12)


def test_a_change_of_filters_in_motion_continues_the_outputs() -> None:
    rng = np.random.default_rng(6)
    state = at_rest(0.0, 0.0)
    for v_q, v_S in rng.standard_normal((100, 2)):
        _, _, state = step(COUPLED, state, v_q, v_S)
    expected = step(COUPLED, state, 0.4, -0.7)[:2]
    assert step(OTHER, state, 0.4, -0.7)[:2] != pytest.approx(expected, abs=1e-3)
    changed = bumpless(COUPLED, OTHER, state, 0.4, -0.7)
    assert step(OTHER, changed, 0.4, -0.7)[:2] == pytest.approx(expected, abs=1e-13)
    unchanged = bumpless(COUPLED, COUPLED, state, 0.4, -0.7)
    assert [*unchanged.r_12, *unchanged.r_21] == pytest.approx([*state.r_12, *state.r_21], abs=1e-13)


def test_bumpless_at_rest_is_the_same_state() -> None:
    state = at_rest(0.5, 11.0)
    assert bumpless(COUPLED, OTHER, state, 0.5, 11.0) == state


# Limits --------------------------------------------------------------------------------------------


finite = st.floats(-3.0, 3.0)
bounds = st.tuples(st.floats(-2.0, 1.0), st.floats(0.0, 2.0)).map(lambda b: (b[0], b[0] + b[1]))


@given(v_q=finite, v_S=finite, q=bounds, S=bounds, seed=st.integers(0, 100))
def test_limited_inputs_are_the_one_solution_of_the_limited_equations(
    v_q: float, v_S: float, q: tuple[float, float], S: tuple[float, float], seed: int
) -> None:
    """Projected iteration, a contraction here, finds the same solution."""
    x = np.random.default_rng(seed).standard_normal(8)
    state = DynamicDecouplerState(ResidualState(*x[:4]), ResidualState(*x[4:]), 0.1, -0.2)
    found = solve_inputs(COUPLED, state, v_q, v_S, InputLimits(*q, *S))
    free_12 = state.r_12.second_1 + FIRST.second.b_0 * state.r_12.first_1
    free_21 = state.r_21.second_1 + SECOND.second.b_0 * state.r_21.first_1
    gain_12, gain_21 = FIRST.first.b_0 * FIRST.second.b_0, SECOND.first.b_0 * SECOND.second.b_0
    q_c, S_c = 0.0, 0.0
    for _ in range(60):
        q_c = float(np.clip(v_q + free_12 + gain_12 * (-0.5 * (q_c - 0.1) + 1.1 * (S_c + 0.2)), *q))
        S_c = float(np.clip(v_S + free_21 + gain_21 * (1.1 * (q_c - 0.1) + 0.2 * (S_c + 0.2)), *S))
    assert found == pytest.approx((q_c, S_c), abs=1e-9)


def test_filters_follow_limited_inputs() -> None:
    """While a limit is active the state is that of the limited inputs; it does not wind up."""
    limits = InputLimits(-0.2, 0.2, -np.inf, np.inf)
    state = at_rest(0.0, 8.0)
    for _ in range(4000):
        q_c, S_c, state = step(COUPLED, state, 5.0, 8.0, limits)
    assert q_c == 0.2
    assert S_c == pytest.approx(8.0, abs=1e-9)
    assert [*state.r_12, *state.r_21] == pytest.approx([0.0] * 8, abs=1e-9)


# Schedule ------------------------------------------------------------------------------------------


def row(d: DynamicDecoupler) -> list[float]:
    return [*d.r_12.first, *d.r_12.second, *d.r_21.first, *d.r_21.second, *d.static]


def test_coefficients_are_linear_between_entries() -> None:
    entries = np.array([row(COUPLED), row(OTHER)])
    assert entries.shape[1] == COLUMNS
    assert interpolate_decoupler(entries, 0.0) == COUPLED
    assert interpolate_decoupler(entries, 1.0) == OTHER
    between = row(interpolate_decoupler(entries, 0.25))
    assert between == pytest.approx(0.75 * entries[0] + 0.25 * entries[1], abs=1e-15)


@given(shares=st.lists(st.floats(0.0, 1.0), min_size=5, max_size=30))
def test_interpolation_never_moves_a_rest(shares: list[float]) -> None:
    entries = np.array([row(COUPLED), row(OTHER)])
    state = at_rest(0.7, 12.0)
    for share in shares:
        q_c, S_c, state = step(interpolate_decoupler(entries, share), state, 0.7, 12.0)
        assert (q_c, S_c) == (0.7, 12.0)


def test_the_unused_filter_has_no_output() -> None:
    d = DynamicDecoupler(NO_FILTER, SECOND, NO_STATIC_PART)
    state = at_rest(0.0, 0.0)
    for v_q, v_S in np.random.default_rng(7).standard_normal((50, 2)):
        q_c, _, state = dynamic_decoupler.step(d, state, v_q, v_S)
        assert q_c == pytest.approx(v_q, abs=1e-14)
