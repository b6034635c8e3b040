"""The envelope around what the outer loops may ask for: which stiffness a tension takes, and what a push does to it."""

import math

import numpy as np
import pytest

from backend.control import decoupler
from backend.control.decoupler import (
    Decoupler,
    Envelope,
    EnvelopeState,
    build_decoupler,
    build_equilibrium_table,
    stiffness_under,
)
from plant.parameters import load_parameters

PARAMETERS = load_parameters("ideal")
D = build_decoupler(PARAMETERS)
BOUNDS = Envelope(F_floor=4.0, F_ceiling=48.0, q_max=1.4)
AT_REST = EnvelopeState(0.0)


@pytest.mark.parametrize(("tension", "S"), [(10.0, 8.24), (20.0, 10.55), (30.0, 12.43), (40.0, 14.06)])
def test_nominal_points_of_the_paper(tension: float, S: float) -> None:
    assert stiffness_under(D, tension) == pytest.approx(S, abs=0.01)


def test_table_says_what_the_closed_form_says() -> None:
    spring = PARAMETERS.make_identified_spring("A")
    table = build_equilibrium_table(spring, spring, D.r_m, D.r_j)
    by_table = Decoupler(D.r_m, D.r_j, math.nan, math.nan, math.nan, table)
    for tension in np.linspace(0.5, 49.5, 50):
        assert stiffness_under(by_table, tension) == pytest.approx(stiffness_under(D, tension), abs=1e-5)


def test_inside_nothing_is_held_back() -> None:
    y, _ = decoupler.step_envelope(BOUNDS, D, AT_REST, 1.0, 10.0, 18.0, 18.0)
    assert y == (1.0, 10.0, False, False, False)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_each_bound_holds_and_says_so(side: float) -> None:
    y, _ = decoupler.step_envelope(BOUNDS, D, AT_REST, side * 1.5, 6.0, 4.0, 4.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 4.0))
    assert (y.q_c, y.at_floor, y.at_ceiling, y.at_range) == (side * 1.4, True, False, True)
    y, _ = decoupler.step_envelope(BOUNDS, D, AT_REST, side * 0.2, 16.0, 40.0, 40.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 48.0))
    assert (y.q_c, y.at_floor, y.at_ceiling, y.at_range) == (side * 0.2, False, True, False)


@pytest.mark.parametrize("pull", [12.0, -12.0])
def test_a_push_takes_half_of_itself_off_both_ends(pull: float) -> None:
    state = EnvelopeState(pull)
    y, state = decoupler.step_envelope(BOUNDS, D, state, 0.0, 6.0, 20.0 + pull / 2.0, 20.0 - pull / 2.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 10.0))
    y, _ = decoupler.step_envelope(BOUNDS, D, state, 0.0, 16.0, 20.0 + pull / 2.0, 20.0 - pull / 2.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 42.0))


def test_beyond_both_ends_the_ceiling_wins() -> None:
    y, _ = decoupler.step_envelope(BOUNDS, D, EnvelopeState(60.0), 0.0, 12.0, 80.0, 20.0)
    assert y.S_c == pytest.approx(stiffness_under(D, 18.0))
    assert (y.at_floor, y.at_ceiling) == (False, True)


def test_the_pull_follows_the_load_cells_within_its_time() -> None:
    state = AT_REST
    for _ in range(50):
        _, state = decoupler.step_envelope(BOUNDS, D, state, 0.0, 10.0, 15.0, 5.0)
    assert state.force_difference == pytest.approx(10.0 * (1.0 - math.exp(-1.0)))
