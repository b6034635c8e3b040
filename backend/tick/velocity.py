"""How fast the joint moves: its encoder's differences, smoothed."""

import math
from typing import NamedTuple

from plant.compiled import compiled
from plant.interface import T_s

VELOCITY_FILTER_S = 0.010
"""Time constant of the estimate [s]: an encoder count in one tick would read as 1.6 rad/s."""

_PASS_THROUGH = 1.0 - math.exp(-T_s / VELOCITY_FILTER_S)


class State(NamedTuple):
    """The estimate ``q_dot`` [rad/s], and the angle before [rad]."""

    q_dot: float
    q_before: float


@compiled
def step(state: State, q: float) -> State:
    """Take the reading of a tick [rad]; one that is no number is passed over, as its nan would stay for ever."""
    if not math.isfinite(q):
        return state
    before = state.q_before if math.isfinite(state.q_before) else q
    return State(state.q_dot + _PASS_THROUGH * ((q - before) / T_s - state.q_dot), q)
