"""Dynamic decoupler: inverted decoupling of position and stiffness away from rest.

The outputs of the outer loops, v = (v_q, v_S), and the inputs of the static decoupler, u = (q_c, S_c), satisfy

    q_c = v_q + r_12 (M u)_S        S_c = v_S + r_21 (M u)_q

where r_12 and r_21 are filters with gain 0 at zero frequency, and M is the static part of the decoupling, which the
static decoupler contains (Wade 1997; Garrido, Vázquez and Morilla 2011). The loops then see g_11 and g_22 alone.

The filters get the increments of M u, so that every state is zero at rest, whatever the filters are. States have the
unit of the filter's output: a change of filters changes no output at rest, and ``bumpless`` continues it in motion.
``backend.tuning.decoupling`` computes the filters.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant import compiled

# Filters -------------------------------------------------------------------------------------------
# Two sections per filter, in powers of δ = z − 1. Poles near z = 1 lose no digits in it, unlike in powers of z, and a
# section is stable on a convex set of (a_1, a_2), so that interpolated sections are stable too.


class HighPassSection(NamedTuple):
    """Section (b_0 δ² + b_1 δ)/(δ² + a_1 δ + a_2), zero at zero frequency.

    ``b_0``, ``b_1``: unit of the filter's output per unit of its input; ``a_1``, ``a_2`` [1].
    """

    a_1: float
    a_2: float
    b_0: float
    b_1: float


class SecondOrderSection(NamedTuple):
    """Section (b_0 δ² + b_1 δ + b_2)/(δ² + a_1 δ + a_2), without unit."""

    a_1: float
    a_2: float
    b_0: float
    b_1: float
    b_2: float


class ResidualFilter(NamedTuple):
    """Product of both sections: at most four poles, and gain 0 at zero frequency."""

    first: HighPassSection
    second: SecondOrderSection


class StaticPart(NamedTuple):
    """Matrix M from (q_c, S_c) to the inputs of the identified model; the identity without static coupling.

    ``q_S`` [rad per N·m/rad] multiplies S_c, ``S_q`` [N·m/rad per rad] multiplies q_c; the others have no unit.
    """

    q_q: float
    q_S: float
    S_q: float
    S_S: float


class DynamicDecoupler(NamedTuple):
    """Filters ``r_12`` (from S_c to q_c) and ``r_21`` (from q_c to S_c), and the static part M of their inputs."""

    r_12: ResidualFilter
    r_21: ResidualFilter
    static: StaticPart


NO_FILTER = ResidualFilter(HighPassSection(2.0, 1.0, 0.0, 0.0), SecondOrderSection(2.0, 1.0, 1.0, 2.0, 1.0))
"""Filter whose output is always zero; unused poles are at z = 0."""

NO_STATIC_PART = StaticPart(1.0, 0.0, 0.0, 1.0)

STATIC_ONLY = DynamicDecoupler(NO_FILTER, NO_FILTER, NO_STATIC_PART)
"""Decoupler that passes its inputs unchanged."""


class InputLimits(NamedTuple):
    """Limits of the inputs of the static decoupler: q_c [rad] and S_c [N·m/rad]."""

    q_min: float
    q_max: float
    S_min: float
    S_max: float


NO_LIMITS = InputLimits(-math.inf, math.inf, -math.inf, math.inf)


# State ---------------------------------------------------------------------------------------------


class ResidualState(NamedTuple):
    """States of both sections, in the unit of the filter's output; zero at rest."""

    first_1: float
    first_2: float
    second_1: float
    second_2: float


class DynamicDecouplerState(NamedTuple):
    """States of the filters, and the inputs ``q_c`` [rad], ``S_c`` [N·m/rad] of the previous step."""

    r_12: ResidualState
    r_21: ResidualState
    q_c: float
    S_c: float


@compiled
def at_rest(q_c: float, S_c: float) -> DynamicDecouplerState:
    """Return the state at constant inputs q_c [rad], S_c [N·m/rad]."""
    return DynamicDecouplerState(ResidualState(0.0, 0.0, 0.0, 0.0), ResidualState(0.0, 0.0, 0.0, 0.0), q_c=q_c, S_c=S_c)


# Step ----------------------------------------------------------------------------------------------


@compiled
def step(
    d: DynamicDecoupler, state: DynamicDecouplerState, v_q: float, v_S: float, limits: InputLimits = NO_LIMITS
) -> tuple[float, float, DynamicDecouplerState]:
    """Step the decoupler: outputs of the outer loops to q_c [rad], S_c [N·m/rad] and the state.

    Both results are within ``limits``. The filters get the limited inputs (anti-windup), and the input that is not
    limited is computed from the limited one, so that its output stays decoupled.
    """
    q_c, S_c = solve_inputs(d, state, v_q, v_S, limits)
    return q_c, S_c, follow_inputs(d, state, q_c, S_c)


@compiled
def solve_inputs(
    d: DynamicDecoupler, state: DynamicDecouplerState, v_q: float, v_S: float, limits: InputLimits
) -> tuple[float, float]:
    """Return q_c [rad], S_c [N·m/rad] within ``limits``, without a delay between them.

    The outputs of this step depend on each other: A Δu = c with Δu the increments. The principal minors of A are
    positive (condition ALGEBRAIC_LOOP of the tuning), so that the limited equations have one solution too.
    """
    A_qq, A_qS, A_Sq, A_SS = _algebraic_loop(d)
    c_q = v_q + _free_output(d.r_12, state.r_12) - state.q_c
    c_S = v_S + _free_output(d.r_21, state.r_21) - state.S_c
    determinant = A_qq * A_SS - A_qS * A_Sq
    q_c = state.q_c + (A_SS * c_q - A_qS * c_S) / determinant
    S_c = state.S_c + (A_qq * c_S - A_Sq * c_q) / determinant
    q_limited, S_limited = min(max(q_c, limits.q_min), limits.q_max), min(max(S_c, limits.S_min), limits.S_max)
    if q_limited == q_c and S_limited == S_c:
        return q_c, S_c
    # Solve each input from the other, limited one. An S_c that is limited for the limited q_c stays so for the new q_c.
    if q_limited != q_c:
        S_c = state.S_c + (c_S - A_Sq * (q_limited - state.q_c)) / A_SS
        S_limited = min(max(S_c, limits.S_min), limits.S_max)
    if S_limited != S_c:
        q_c = state.q_c + (c_q - A_qS * (S_limited - state.S_c)) / A_qq
        q_limited = min(max(q_c, limits.q_min), limits.q_max)
    return q_limited, S_limited


@compiled
def follow_inputs(d: DynamicDecoupler, state: DynamicDecouplerState, q_c: float, S_c: float) -> DynamicDecouplerState:
    """Return the state after the inputs q_c [rad], S_c [N·m/rad] that were in fact applied.

    For inputs that another component has limited or replaced.
    """
    to_12, to_21 = _filter_inputs(d.static, q_c - state.q_c, S_c - state.S_c)
    return DynamicDecouplerState(
        _step_filter(d.r_12, state.r_12, to_12), _step_filter(d.r_21, state.r_21, to_21), q_c=q_c, S_c=S_c
    )


@compiled
def bumpless(
    before: DynamicDecoupler, after: DynamicDecoupler, state: DynamicDecouplerState, v_q: float, v_S: float
) -> DynamicDecouplerState:
    """Return the state with which ``after`` gives the inputs of ``before`` in this step.

    At rest it equals ``state``.
    """
    q_c, S_c = solve_inputs(before, state, v_q, v_S, NO_LIMITS)
    before_12, before_21 = _filter_inputs(before.static, q_c - state.q_c, S_c - state.S_c)
    after_12, after_21 = _filter_inputs(after.static, q_c - state.q_c, S_c - state.S_c)
    return DynamicDecouplerState(
        _continue_filter(before.r_12, after.r_12, state.r_12, before_12, after_12),
        _continue_filter(before.r_21, after.r_21, state.r_21, before_21, after_21),
        q_c=state.q_c,
        S_c=state.S_c,
    )


@compiled
def _algebraic_loop(d: DynamicDecoupler) -> tuple[float, float, float, float]:
    """Return the rows of A = I − F M, F with the direct feedthroughs of the filters."""
    F_12, F_21 = d.r_12.first.b_0 * d.r_12.second.b_0, d.r_21.first.b_0 * d.r_21.second.b_0
    M = d.static
    return 1.0 - F_12 * M.S_q, -F_12 * M.S_S, -F_21 * M.q_q, 1.0 - F_21 * M.q_S


@compiled
def _filter_inputs(static: StaticPart, delta_q: float, delta_S: float) -> tuple[float, float]:
    """Return the inputs of r_12 and r_21 for increments of q_c and S_c."""
    return static.S_q * delta_q + static.S_S * delta_S, static.q_q * delta_q + static.q_S * delta_S


@compiled
def _free_output(r: ResidualFilter, state: ResidualState) -> float:
    """Return the output of a filter for an unchanged input."""
    return state.second_1 + r.second.b_0 * state.first_1


@compiled
def _step_filter(r: ResidualFilter, state: ResidualState, increment: float) -> ResidualState:
    """Return the states after an increment of the input (transposed direct form II in δ)."""
    first, second = r.first, r.second
    y = state.first_1 + first.b_0 * increment
    output = state.second_1 + second.b_0 * y
    return ResidualState(
        state.first_1 + state.first_2 + (first.b_0 + first.b_1) * increment - first.a_1 * y,
        state.first_2 + first.b_1 * increment - first.a_2 * y,
        state.second_1 + state.second_2 + second.b_1 * y - second.a_1 * output,
        state.second_2 + second.b_2 * y - second.a_2 * output,
    )


@compiled
def _continue_filter(
    before: ResidualFilter, after: ResidualFilter, state: ResidualState, increment_before: float, increment_after: float
) -> ResidualState:
    """Return the states with which ``after`` gives the outputs of both sections of ``before``."""
    y = state.first_1 + before.first.b_0 * increment_before
    return ResidualState(
        y - after.first.b_0 * increment_after,
        state.first_2,
        state.second_1 + (before.second.b_0 - after.second.b_0) * y,
        state.second_2,
    )


# Schedule ------------------------------------------------------------------------------------------
# One row of coefficients per entry of the bank; the index of the active entry is that of the gains.


COLUMNS = 22
"""Columns of a row: four and five coefficients of the sections of r_12, then of r_21, then the static part."""


@compiled
def interpolate_decoupler(entries: NDArray[np.float64], active: float) -> DynamicDecoupler:
    """Return the decoupler at ``active``, the index of ``backend.control.decoupler.select_entry``.

    ``entries`` (n, COLUMNS), sorted by nominal stiffness. Between two entries the coefficients are linear.
    """
    lower = int(active)
    upper = min(lower + 1, entries.shape[0] - 1)
    low, high, share = entries[lower], entries[upper], active - lower
    return DynamicDecoupler(
        _filter_at(low, high, share, 0),
        _filter_at(low, high, share, 9),
        StaticPart(
            _mix(low[18], high[18], share),
            _mix(low[19], high[19], share),
            _mix(low[20], high[20], share),
            _mix(low[21], high[21], share),
        ),
    )


@compiled
def _filter_at(low: NDArray[np.float64], high: NDArray[np.float64], share: float, k: int) -> ResidualFilter:
    return ResidualFilter(
        HighPassSection(
            _mix(low[k], high[k], share),
            _mix(low[k + 1], high[k + 1], share),
            _mix(low[k + 2], high[k + 2], share),
            _mix(low[k + 3], high[k + 3], share),
        ),
        SecondOrderSection(
            _mix(low[k + 4], high[k + 4], share),
            _mix(low[k + 5], high[k + 5], share),
            _mix(low[k + 6], high[k + 6], share),
            _mix(low[k + 7], high[k + 7], share),
            _mix(low[k + 8], high[k + 8], share),
        ),
    )


@compiled
def _mix(low: float, high: float, share: float) -> float:
    return (1.0 - share) * low + share * high
