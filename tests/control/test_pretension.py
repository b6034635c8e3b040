"""Winding up against the linear differential equation that its constants promise, and when it counts as done."""

import numpy as np
import pytest
from scipy.linalg import expm

from backend.control import motion_primitives

T_S = 1e-3
FROM_SLACK = motion_primitives.PretensionState(0.0, 0.0, 0.0, 0.0, 0.0)


def test_tension_comes_up_as_filter_and_winding_say() -> None:
    """0.1 F' = stiffness θ − F,  θ' = 0.15 (5 N − F): too little is missing for the fastest winding."""
    stiffness = np.array([5.5, 11.0])
    state = FROM_SLACK
    for tick in range(1, 4001):
        F_A, F_B = stiffness * (state.theta_A_ref, state.theta_B_ref)
        state = motion_primitives.step_pretension(state, 5.0, F_A, F_B)
        if tick % 500 == 0:
            for k, found in zip(
                stiffness, ((state.F_A, state.theta_A_ref), (state.F_B, state.theta_B_ref)), strict=True
            ):
                rest = np.array([5.0, 5.0 / k])
                expected = rest - expm(np.array([[-10.0, 10.0 * k], [-0.15, 0.0]]) * tick * T_S) @ rest
                assert found == pytest.approx(expected, rel=0.01)


def test_winding_is_no_faster_than_its_bound_and_unwinds_what_is_too_much() -> None:
    state = motion_primitives.step_pretension(FROM_SLACK._replace(F_B=40.0), 20.0, 0.0, 40.0)
    assert (state.theta_A_ref, state.theta_B_ref) == pytest.approx((1.5 * T_S, -1.5 * T_S))


def test_it_is_right_only_where_both_are_and_its_time_begins_anew() -> None:
    right = motion_primitives.PretensionState(10.05, 9.95, 3.0, 3.0, 0.2)
    assert motion_primitives.step_pretension(right, 10.0, 10.05, 9.95).steady_s == pytest.approx(0.201)
    assert motion_primitives.step_pretension(right._replace(F_A=10.2), 10.0, 10.2, 9.95).steady_s == 0.0
    assert motion_primitives.step_pretension(right._replace(F_B=9.8), 10.0, 10.05, 9.8).steady_s == 0.0
