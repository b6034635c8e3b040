"""Plays a program's segments tick by tick, in constant time whatever the length of the program."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.tick.decision import Target
from plant.compiled import compiled
from plant.interface import ShaftLoad, T_s

_SHAPE, _TICKS, _DURATION, _Q, _S, _PUSH, _PERIOD, _LOAD_A, _LOAD_B = range(9)
STEP, RAMP, SINE = 0.0, 1.0, 2.0
"""Shapes of a segment, as its first column has them."""


class Player(NamedTuple):
    """``segments``, the one that is played and how many of its ticks were, and the target before it.

    ``segments`` (n, 9): shape, ticks, duration [s], q_ref [rad], S_ref [N·m/rad], F_push [N], period [s] of a sine,
    loads of shafts A and B [N·m].
    """

    segments: NDArray[np.float64]
    position: int
    elapsed: int
    start: Target


@compiled
def play(player: Player, last: Target) -> tuple[bool, Target, Player]:
    """Return whether the last segment has ended, the target, which is ``last`` then, and the player after it."""
    segments, position, elapsed, start = player.segments, player.position, player.elapsed, player.start
    while position < segments.shape[0]:
        segment = segments[position]
        if elapsed < segment[_TICKS]:
            elapsed += 1
            return False, _within(segment, start, elapsed * T_s), Player(segments, position, elapsed, start)
        start = _within(segment, start, segment[_DURATION])
        position += 1
        elapsed = 0
    return True, last, Player(segments, position, elapsed, start)


@compiled
def _within(segment: NDArray[np.float64], start: Target, time_s: float) -> Target:
    share = 1.0
    if segment[_SHAPE] == RAMP:
        share = min(time_s / segment[_DURATION], 1.0)
    elif segment[_SHAPE] == SINE:
        share = math.sin(2.0 * math.pi * time_s / segment[_PERIOD])
    return Target(
        start.q_ref + share * (segment[_Q] - start.q_ref),
        start.S_ref + share * (segment[_S] - start.S_ref),
        start.F_push + share * (segment[_PUSH] - start.F_push),
        ShaftLoad(segment[_LOAD_A], segment[_LOAD_B]),
    )
