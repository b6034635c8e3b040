"""Actuator identification: theta_B_ref at zero, the tension held by motor A, the excitation on top (figure 5)."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.controllers import cascade, force_hold
from backend.tick.decision import Carry, Decision, Target, follow, walk
from plant.compiled import compiled
from plant.interface import Measurement


class Chips(NamedTuple):
    """An excitation: offsets of theta_A_ref [rad] of one period (n,), ticks of a chip and of the whole."""

    levels: NDArray[np.float64]
    chip_ticks: int
    ticks: int


class State(NamedTuple):
    """``base_A``, ``base_B`` [rad] on their way to ``goal_A`` and zero; ``tick`` of the excitation."""

    F_ref: float
    goal_A: float
    base_A: float
    base_B: float
    settle_ticks: int
    chips: Chips
    tick: int
    hold: force_hold.State


@compiled
def step(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: State, m: Measurement
) -> tuple[Decision, Carry, State]:
    """One tick: travel to the tension, settle, excite."""
    base_A, base_B, settle_ticks, tick = state.base_A, state.base_B, state.settle_ticks, state.tick
    chips, hold = state.chips, state.hold
    arrived = base_A == state.goal_A and base_B == 0.0
    offset, done = 0.0, False
    if not arrived:
        base_A, base_B = walk(base_A, base_B, state.goal_A, 0.0)
    elif settle_ticks > 0:
        settle_ticks -= 1
    elif tick >= chips.ticks:
        done = True
    else:
        offset = chips.levels[(tick // chips.chip_ticks) % chips.levels.shape[0]]
        tick += 1
    trim, held = force_hold.step(hold, state.F_ref, m.F_A, m.F_B)
    if arrived:
        hold = held
    decision, carry = follow(tuning, carry, target, base_A + trim + offset, base_B, m, done)
    return decision, carry, State(state.F_ref, state.goal_A, base_A, base_B, settle_ticks, chips, tick, hold)
