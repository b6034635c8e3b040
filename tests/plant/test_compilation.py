"""Machine code for one place in the tick: the same numbers, and never compiled again."""

import math
import random
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from numba.core.errors import TypingError

from plant.compilation import PrecompiledCall, compiled
from plant.dynamics import AT_REST, PlantState
from plant.interface import ZERO_VOLTS
from plant.parameters import load_parameters
from plant.simulator import SafetyBounds, Simulator, actuate_plant, is_limit_exceeded

LAB = load_parameters("lab")
PLANT, BOUNDS = LAB.make_dynamics(), SafetyBounds(40.0, 1.5)
is_exceeded = PrecompiledCall(is_limit_exceeded, PLANT, BOUNDS, AT_REST)


def test_it_says_what_the_function_says() -> None:
    numbers = random.Random(12)
    answers = []
    for _ in range(200):
        q, theta_A, theta_B = numbers.uniform(-1.8, 1.8), numbers.uniform(0.0, 6.0), numbers.uniform(0.0, 6.0)
        x = PlantState(q, 0.0, theta_A, 0.0, 0.0, theta_B, 0.0, 0.0)
        answers.append(is_exceeded(PLANT, BOUNDS, x))
        assert answers[-1] == is_limit_exceeded.py_func(PLANT, BOUNDS, x)  # type: ignore[attr-defined]  # of numba
    assert 20 < sum(answers) < 180  # both answers were to be had


def test_a_whole_number_stands_for_a_float_and_compiles_nothing() -> None:
    simulator, whole = Simulator(LAB), Simulator(LAB, x=PlantState(0, 0, 0, 0, 0, 0, 0, 0))
    known = len(actuate_plant.signatures)  # type: ignore[attr-defined]  # of numba
    simulator.write(ZERO_VOLTS._replace(u_A=2.0))
    whole.write(ZERO_VOLTS._replace(u_A=2))
    assert whole.x == simulator.x != AT_REST
    assert len(actuate_plant.signatures) == known  # type: ignore[attr-defined]  # of numba


class Weights(NamedTuple):
    """Of a sum; ``shift`` counts places."""

    a: float
    b: float
    shift: int


@compiled
def weighted(weights: Weights, pair: tuple[float, float], times: int, x: float) -> float:
    """Return a sum in which every number shows."""
    return times * (weights.a * x + weights.b * pair[0]) + pair[1] + weights.shift


WHOLE, BROKEN = (Weights(2, 3, 1), (4, 5), 2, 6), (Weights(2.5, 3.25, 1), (4.5, 5.75), 2, 6.125)


@pytest.mark.parametrize("like", [WHOLE, BROKEN], ids=["made of whole numbers", "made of floats"])
def test_where_a_float_is_declared_whole_numbers_and_floats_are_both_right(like: tuple[Weights, Any, int, Any]) -> None:
    called = PrecompiledCall(weighted, *like)
    mixed = (Weights(2, 3.25, 1), (4.5, 5), 2, 6)
    for given in (WHOLE, BROKEN, mixed):
        assert called(*given) == weighted.py_func(*given)  # type: ignore[attr-defined]  # of numba


@compiled
def summed(parts: tuple[float, ...]) -> float:
    """Return the sum of as many floats as there are."""
    total = 0.0
    for part in parts:
        total += part
    return total


@compiled
def allocated(count: int) -> float:
    """Return the first of some zeros, from an array that needs numba's runtime."""
    return float(np.zeros(count)[0])


def test_what_allocates_in_the_tick_does_not_compile() -> None:
    with pytest.raises(TypingError, match="zeros"):
        allocated(3)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_of_a_tuple_of_any_length_each_part_is_a_float(count: int) -> None:
    whole: tuple[float, ...] = tuple(range(count))
    called = PrecompiledCall(summed, whole)
    assert called(tuple(part + 0.5 for part in whole)) == sum(range(count)) + 0.5 * count


@pytest.mark.parametrize(
    "given",
    [
        (Weights(2.0, 3.0, 1), (4.0, 5.0), 2.5, 6.0),
        (Weights(2.0, 3.0, 1), (4.0, 5.0), 2.0, 6.0),
        (Weights(2.0, 3.0, cast(int, 1.5)), (4.0, 5.0), 2, 6.0),
        (Weights(2.0, 3.0, 1), (4.0, 5.0), math.nan, 6.0),
    ],
    ids=["broken", "whole", "in a tuple", "nan"],
)
def test_a_float_where_a_whole_number_is_declared_is_refused_and_not_cut_off(given: tuple[Any, Any, Any, Any]) -> None:
    called = PrecompiledCall(weighted, *BROKEN)
    with pytest.raises(TypeError, match="float"):
        called(*given)


@pytest.mark.parametrize(
    "x", [BOUNDS, AT_REST[:7], 0.0, AT_REST._replace(q=cast(float, "left"))], ids=["other", "short", "float", "text"]
)
def test_what_cannot_be_read_so_is_refused(x: PlantState) -> None:
    with pytest.raises(TypeError):
        is_exceeded(PLANT, BOUNDS, x)
