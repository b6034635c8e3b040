"""The governor: bounded motor references, both references along one straight line, exact arrival."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.control import cascade
from backend.control.decoupler import Decoupler, motor_positions
from plant.interface import T_s

D = Decoupler(7.5e-3, 75e-3, -2.498, 331.49, 8543.8)
OMEGA = 20.0


@given(st.floats(-1.4, 1.4), st.floats(8.0, 15.0), st.floats(-1.4, 1.4), st.floats(8.0, 15.0))
def test_walks_straight_no_faster_than_bound_and_arrives(q_0: float, S_0: float, q_1: float, S_1: float) -> None:
    state = cascade.GovernorState(q_0, S_0)
    before = np.array(motor_positions(D, q_0, S_0))
    travel = np.max(np.abs(np.array(motor_positions(D, q_1, S_1)) - before))
    ticks = int(np.ceil(travel / (OMEGA * T_s))) + 1
    for _ in range(ticks):
        state, governed = cascade.step_governor(D, OMEGA, state, q_1, S_1)
        now = np.array(motor_positions(D, state.q_ref, state.S_ref))
        assert np.max(np.abs(now - before)) <= OMEGA * T_s * (1.0 + 1e-9)
        # On the line from start to target: the cross product of way gone and way to go vanishes.
        assert (state.q_ref - q_0) * (S_1 - S_0) == pytest.approx((state.S_ref - S_0) * (q_1 - q_0), abs=1e-9)
        before = now
    assert state == cascade.GovernorState(q_1, S_1)
    assert not governed
