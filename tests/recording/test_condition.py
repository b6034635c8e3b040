"""The tick at which a condition is met, against signals whose crossings follow from a formula."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from backend.experiments.parser import parse_derived_signal
from backend.recording.trigger import Condition, ConditionKind
from backend.sample import INDEX, NAMES
from plant.quantity import Angle

T_s = 1e-3
TIMES = np.arange(4000) * T_s
SINE = np.sin(2 * math.pi * 0.5 * TIMES)


def condition(kind: ConditionKind, level: float, upper: float | None = None) -> Condition:
    return Condition("F_A", kind, level, upper)


def test_a_ramp_is_above_a_level_at_the_first_tick_past_it() -> None:
    ramp = np.arange(0.0, 500.0, 0.5)
    assert condition(ConditionKind.ABOVE, 100.0).first(ramp, -1.0) == 201
    assert condition(ConditionKind.ABOVE, 99.9).first(ramp, -1.0) == 200
    assert condition(ConditionKind.BELOW, 100.0).first(-ramp, 1.0) == 0
    assert condition(ConditionKind.BELOW, -100.0).first(-ramp, 1.0) == 201


def test_a_sine_rises_and_falls_through_a_level_where_its_arc_sine_says() -> None:
    level = 0.5
    rises, falls = math.asin(level) / math.pi, 1.0 - math.asin(level) / math.pi
    assert condition(ConditionKind.RISING, level).first(SINE, 0.0) == math.floor(rises / T_s) + 1
    assert condition(ConditionKind.FALLING, level).first(SINE, 0.0) == math.floor(falls / T_s) + 1
    second = math.floor((2.0 + rises) / T_s) + 1
    met = np.flatnonzero(condition(ConditionKind.RISING, level).met(SINE, 0.0))
    assert met.tolist() == [math.floor(rises / T_s) + 1, second]


def test_a_level_is_met_at_once_and_an_edge_only_by_crossing_it() -> None:
    high = np.full(100, 2.0)
    assert condition(ConditionKind.ABOVE, 1.0).first(high, 2.0) == 0
    assert condition(ConditionKind.RISING, 1.0).first(high, 2.0) is None
    assert condition(ConditionKind.RISING, 1.0).first(high, 0.5) == 0, "across the border of two blocks"
    assert condition(ConditionKind.FALLING, 1.0).first(np.array([2.0, 1.0, 0.5]), 2.0) == 2, "at the level is not past"


def test_a_window_includes_its_ends() -> None:
    inside, outside = condition(ConditionKind.INSIDE, 1.0, 2.0), condition(ConditionKind.OUTSIDE, 1.0, 2.0)
    values = np.array([0.9, 1.0, 1.5, 2.0, 2.1])
    assert inside.met(values, 0.0).tolist() == [False, True, True, True, False]
    assert outside.met(values, 0.0).tolist() == [True, False, False, False, True]


@pytest.mark.parametrize("kind", list(ConditionKind))
def test_nan_never_triggers_nor_does_the_sample_after_it_by_an_edge(kind: ConditionKind) -> None:
    asked = condition(kind, 1.0, 2.0)
    assert asked.first(np.full(50, np.nan), np.nan) is None
    if kind in (ConditionKind.RISING, ConditionKind.FALLING):
        assert asked.first(np.array([0.0, np.nan, 3.0]), 0.0) is None
        assert asked.first(np.array([3.0, np.nan, 0.0]), 3.0) is None


@given(
    values=st.lists(st.one_of(st.just(math.nan), st.integers(-3, 3).map(float)), min_size=1, max_size=40),
    cut=st.integers(0, 40),
    kind=st.sampled_from(list(ConditionKind)),
)
def test_blocks_meet_it_where_the_whole_does(values: list[float], cut: int, kind: ConditionKind) -> None:
    asked, array = condition(kind, 0.0, 1.0), np.array(values)
    first, rest = array[:cut], array[cut:]
    met = [asked.met(first, math.nan), asked.met(rest, first[-1] if len(first) else math.nan)]
    assert np.concatenate(met).tolist() == asked.met(array, math.nan).tolist()
    for n, value in enumerate(values):
        before = values[n - 1] if n else math.nan
        expected = {
            ConditionKind.ABOVE: value > 0,
            ConditionKind.BELOW: value < 0,
            ConditionKind.RISING: before <= 0 < value,
            ConditionKind.FALLING: before >= 0 > value,
            ConditionKind.INSIDE: 0 <= value <= 1,
            ConditionKind.OUTSIDE: value < 0 or value > 1,
        }
        assert asked.met(array, math.nan)[n] == expected[kind]


def test_combined_signals_are_sums_of_columns_with_the_lengths_of_the_joint() -> None:
    rows = np.arange(2.0 * len(NAMES)).reshape(2, -1)
    lengths = {"r_m": 0.01, "r_j": 0.1}

    def values(signal: str) -> NDArray[np.float64]:
        return Condition(signal, ConditionKind.ABOVE, 0.0).values(rows, lengths)

    np.testing.assert_array_equal(values("F_A - F_B"), rows[:, INDEX["F_A"]] - rows[:, INDEX["F_B"]])
    np.testing.assert_allclose(values("x_B"), 0.01 * rows[:, INDEX["theta_B"]] + 0.1 * rows[:, INDEX["q"]])


def test_a_formula_is_computed_for_each_sample_and_told_in_its_unit() -> None:
    rows = np.arange(2.0 * len(NAMES)).reshape(2, -1)
    derived = parse_derived_signal("F_sum", "N", "F_A + 2 * F_B")
    asked = Condition("F_sum", ConditionKind.RISING, 3.0, derived=derived)
    expected = rows[:, INDEX["F_A"]] + 2.0 * rows[:, INDEX["F_B"]]
    np.testing.assert_array_equal(asked.values(rows, {"r_m": 0.01, "r_j": 0.1}), expected)
    assert asked.describe() == "F_sum rising through 3 N"
    rows[0, INDEX["F_A"]] = np.nan
    assert np.isnan(asked.values(rows, {})[0])  # a gap meets nothing


def test_it_is_told_with_its_unit() -> None:
    assert condition(ConditionKind.RISING, 20.0).describe() == "F_A rising through 20 N"
    assert Condition("q", ConditionKind.INSIDE, -0.1, 0.2).describe() == f"q inside {Angle(-0.1, 0.2)}"
    assert Condition("mode", ConditionKind.ABOVE, 1.5).describe() == "mode above 1.5"
