"""When the target of an axis counts as one that has jumped."""

import itertools

import pytest

from backend.control.trajectory import AxisTarget, has_jumped


@pytest.mark.parametrize(("rate_before", "rate"), list(itertools.product((0.0, -0.4, 0.7), repeat=2)))
def test_a_goal_jumps_where_it_is_another_and_did_not_go_there(rate_before: float, rate: float) -> None:
    before = AxisTarget(0.2, rate_before)
    assert has_jumped(before, AxisTarget(0.3, rate)) == (rate_before == 0.0 or rate == 0.0)
    assert not has_jumped(before, AxisTarget(0.2, rate))
