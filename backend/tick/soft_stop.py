"""Soft stop: brake both motors and keep braking until the joint has come to rest under tension."""

import math
from typing import NamedTuple

from backend.controllers import brake, cascade
from backend.tick.decision import Carry, Decision, Target, clipped
from plant.compiled import compiled
from plant.interface import Measurement, T_s

SOFT_STOP_S = 0.5
"""Length of a soft stop [s]: the joint stands after 0.15 s, the rest lets it settle before the outputs go to zero."""


RELEASE_S = 0.010
"""Time constant with which the voltages that were there before are let go [s]."""

LARGEST_STEP_V = 1.8
"""The voltages change by no more than this in a tick [V]: full reversal takes 11 ms."""


class State(NamedTuple):
    """Both motors' brake, how long it has been on [s], and the voltages of the tick before and when it began [V]."""

    brake: brake.State
    elapsed_s: float
    u_A: float
    u_B: float
    began_A: float
    began_B: float


@compiled
def step(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: State, m: Measurement
) -> tuple[Decision, Carry, State]:
    """One tick of braking."""
    braked_A, braked_B, braking = brake.step(state.brake, m.theta_A, m.theta_B, tuning.u_max)
    elapsed_s = state.elapsed_s + T_s
    left = math.exp(-elapsed_s / RELEASE_S)
    u_A = _stepped(state.u_A, braked_A + left * state.began_A, tuning.u_max)
    u_B = _stepped(state.u_B, braked_B + left * state.began_B, tuning.u_max)
    limits = clipped(abs(u_A) == tuning.u_max, abs(u_B) == tuning.u_max)
    nan = math.nan
    decision = Decision(u_A, u_B, nan, nan, target, nan, nan, nan, limits, False, elapsed_s >= SOFT_STOP_S)
    return decision, carry, State(braking, elapsed_s, u_A, u_B, state.began_A, state.began_B)


@compiled
def _stepped(before: float, wanted: float, u_max: float) -> float:
    """Voltage [V] within ±u_max, as near to the wanted one as a tick allows."""
    wanted = min(max(wanted, -u_max), u_max)
    return before + min(max(wanted - before, -LARGEST_STEP_V), LARGEST_STEP_V)


def begin(u_A: float, u_B: float, m: Measurement) -> State:
    """Brake from here on, and from the voltages [V] that there are."""
    return State(brake.State(m.theta_A, m.theta_B, 0.0, 0.0), 0.0, u_A, u_B, u_A, u_B)
