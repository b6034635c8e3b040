"""A slow sweep of both tensions at once, for the springs: the joint stays where antagonism holds it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.controllers import cascade
from backend.tick.decision import Carry, Decision, Target, follow, walk
from plant.compiled import compiled
from plant.interface import Measurement


class State(NamedTuple):
    """``goals`` (n + 1, 2) are theta_A and theta_B [rad] where the sweep starts and where each leg ends.

    ``ticks`` (n,) of the legs; ``leg`` is -1 on the way to the start.
    """

    goals: NDArray[np.float64]
    ticks: NDArray[np.int64]
    settle_ticks: int
    leg: int
    elapsed: int


@compiled
def step(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: State, m: Measurement
) -> tuple[Decision, Carry, State]:
    """One tick: to the start, settle, then along the legs."""
    goals, ticks, leg, elapsed, done = state.goals, state.ticks, state.leg, state.elapsed, False
    if leg < 0:
        theta_A, theta_B = walk(carry.theta_A_ref, carry.theta_B_ref, goals[0, 0], goals[0, 1])
        if theta_A == goals[0, 0] and theta_B == goals[0, 1]:
            elapsed += 1
            if elapsed >= state.settle_ticks:
                leg, elapsed = 0, 0
    else:
        elapsed += 1
        share = elapsed / ticks[leg]
        theta_A = goals[leg, 0] + share * (goals[leg + 1, 0] - goals[leg, 0])
        theta_B = goals[leg, 1] + share * (goals[leg + 1, 1] - goals[leg, 1])
        if elapsed >= ticks[leg]:
            done = leg + 1 == ticks.shape[0]
            if not done:
                leg, elapsed = leg + 1, 0
    decision, carry = follow(tuning, carry, target, theta_A, theta_B, m, done)
    return decision, carry, State(goals, ticks, state.settle_ticks, leg, elapsed)
