"""Walk the motor references along a straight line to a goal and hold there."""

from typing import NamedTuple

from backend.controllers import cascade, pretension
from backend.tick.decision import Carry, Decision, Target, follow, walk
from plant.compiled import compiled
from plant.interface import Measurement, T_s


class State(NamedTuple):
    """``theta_A``, ``theta_B`` [rad] of the goal, and how long it has been reached [s]."""

    theta_A: float
    theta_B: float
    settled_s: float


@compiled
def step(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: State, m: Measurement
) -> tuple[Decision, Carry, State]:
    """One tick of walking, or of holding the goal."""
    theta_A, theta_B, settled_s = state.theta_A, state.theta_B, state.settled_s
    theta_A_ref, theta_B_ref = walk(carry.theta_A_ref, carry.theta_B_ref, theta_A, theta_B)
    if theta_A_ref == theta_A and theta_B_ref == theta_B:
        settled_s += T_s
    done = settled_s >= pretension.STANDSTILL_S
    decision, carry = follow(tuning, carry, target, theta_A_ref, theta_B_ref, m, done)
    return decision, carry, State(theta_A, theta_B, settled_s)
