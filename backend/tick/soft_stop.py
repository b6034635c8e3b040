"""Soft stop: brake both motors and keep braking until the joint has come to rest under tension."""

import math
from typing import NamedTuple

from backend.controllers import brake, cascade
from backend.tick.decision import Carry, Decision, Target, clipped
from plant.compiled import compiled
from plant.interface import Measurement, T_s

SOFT_STOP_S = 0.5
"""Length of a soft stop [s]: the joint stands after 0.15 s, the rest lets it settle before the outputs go to zero."""


class State(NamedTuple):
    """Both motors' brake, and how long it has been on [s]."""

    brake: brake.State
    elapsed_s: float


@compiled
def step(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: State, m: Measurement
) -> tuple[Decision, Carry, State]:
    """One tick of braking."""
    u_A, u_B, braking = brake.step(state.brake, m.theta_A, m.theta_B, tuning.u_max)
    elapsed_s = state.elapsed_s + T_s
    limits = clipped(abs(u_A) == tuning.u_max, abs(u_B) == tuning.u_max)
    nan = math.nan
    decision = Decision(u_A, u_B, nan, nan, target, nan, nan, nan, limits, False, elapsed_s >= SOFT_STOP_S)
    return decision, carry, State(braking, elapsed_s)


def begin(m: Measurement) -> State:
    """Brake from here on."""
    return State(brake.State(m.theta_A, m.theta_B, 0.0, 0.0), 0.0)
