"""Pretension from slack: both motors wind until both load cells read the pretension."""

from typing import NamedTuple

from backend.controllers import cascade, pretension
from backend.tick.decision import Carry, Decision, Target, follow
from plant.compiled import compiled
from plant.interface import Measurement

PRETENSION_N = 10.0
"""Tension that pretension winds up to (method section 7)."""


class State(NamedTuple):
    """Both motors' winding."""

    winding: pretension.State


@compiled
def step(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: State, m: Measurement
) -> tuple[Decision, Carry, State]:
    """One tick of winding."""
    wound = pretension.step(state.winding, PRETENSION_N, m.F_A, m.F_B)
    done = wound.steady_s >= pretension.STANDSTILL_S
    decision, carry = follow(tuning, carry, target, wound.theta_A_ref, wound.theta_B_ref, m, done)
    return decision, carry, State(wound)


def begin(carry: Carry) -> State:
    """Wind from where the motors are sent now; the tendons are taken for slack."""
    return State(pretension.State(0.0, 0.0, carry.theta_A_ref, carry.theta_B_ref, 0.0))
