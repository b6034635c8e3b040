"""References outside the bounds of the plant are rejected with line and bound."""

from dataclasses import replace

import pytest

from backend.control.decoupler import compute_bounds
from backend.experiments.compiler import CompiledExperiment, require_reach
from backend.experiments.parser import ExperimentError
from backend.realtime.program import OSCILLATING, Segment, Shape
from plant.parameters import load_parameters

_LAB = load_parameters("lab")
PLANT = replace(_LAB, geometry=replace(_LAB.geometry, q_max=1.0))
BOUNDS = compute_bounds(PLANT)
HELD = Segment(1.0, 0.0, 10.0)
LINES = {(): 1, ("phases", 0, "parts", 0): 9, ("phases", 0, "parts", 1): 10, ("phases", 0, "parts", 2): 11}


def of(*segments: Segment) -> CompiledExperiment:
    places = tuple(("phases", 0, "parts", at) for at in range(len(segments)))
    return CompiledExperiment(segments, places, (), (), ())


@pytest.mark.parametrize("shape", [Shape.STEP, Shape.RAMP])
@pytest.mark.parametrize(
    ("q_ref", "S_ref", "quantity"),
    [
        (BOUNDS.q_max, 10.0, "q_ref"),
        (BOUNDS.q_min, 10.0, "q_ref"),
        (0.0, BOUNDS.S_max, "S_ref"),
        (0.0, BOUNDS.S_min, "S_ref"),
    ],
)
def test_a_bound_itself_is_reached_and_what_lies_beyond_is_not(
    shape: Shape, q_ref: float, S_ref: float, quantity: str
) -> None:
    require_reach(of(HELD, Segment(1.0, q_ref, S_ref, shape=shape)), PLANT, LINES)
    beyond = Segment(
        1.0,
        q_ref * 1.001 if quantity == "q_ref" else q_ref,
        S_ref * (1.001 if S_ref > 10.0 else 0.999) if quantity == "S_ref" else S_ref,
        shape=shape,
    )
    with pytest.raises(ExperimentError) as refused:
        require_reach(of(HELD, beyond, HELD), PLANT, LINES)
    assert refused.value.line == 10
    assert "is outside" in str(refused.value)
    assert str(refused.value).startswith("line 10: ")


@pytest.mark.parametrize("shape", OSCILLATING)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_what_oscillates_is_looked_at_on_both_sides_of_where_it_began(shape: Shape, sign: float) -> None:
    middle = Segment(1.0, 0.5 * BOUNDS.q_max, 10.0)
    room = 0.5 * BOUNDS.q_max
    within = replace(middle, q_ref=middle.q_ref + sign * 0.99 * room, shape=shape)
    require_reach(of(HELD, middle, within), PLANT, LINES)
    beyond = replace(middle, q_ref=middle.q_ref + sign * 1.01 * room, shape=shape)
    with pytest.raises(ExperimentError, match="position reference") as refused:
        require_reach(of(HELD, middle, beyond), PLANT, LINES)
    assert refused.value.line == 11


def test_an_excitation_that_is_over_has_moved_no_middle() -> None:
    excited = Segment(1.0, 0.9 * BOUNDS.q_max, 10.0, shape=Shape.MULTISINE)
    require_reach(of(HELD, excited, excited), PLANT, LINES)
