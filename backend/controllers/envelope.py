"""Where the joint may be sent: both tendons taut, neither near its limit, the equilibrium inside the joint's range.

The outer loops ask for an equilibrium (q_c, S_c). At rest both tendons then carry the tension that belongs to S_c, and
an external push shares itself out: half of F_A − F_B on top of one, half off the other. So the push that the load cells
show raises the floor of S_c and lowers its ceiling; beyond both, the ceiling wins, because a slack tendon can be wound
up again and a solid spring cannot be undone.
"""

import math
from typing import NamedTuple

from backend.controllers.decoupler import Decoupler, stiffness_under
from plant.compiled import compiled
from plant.interface import T_s

FILTER_TIME_S = 0.05
"""Low-pass on F_A − F_B: far above the load cells' noise and delay, far below the 0.34 s of the motor loops."""


class Envelope(NamedTuple):
    """``F_floor``, ``F_ceiling`` [N]: wanted of each tendon; ``q_max`` [rad]: furthest equilibrium to either side."""

    F_floor: float
    F_ceiling: float
    q_max: float


class State(NamedTuple):
    """``pull``: F_A − F_B behind the low-pass [N]."""

    pull: float


class Output(NamedTuple):
    """What may be asked for, ``q_c`` [rad] and ``S_c`` [N·m/rad], and which bound held it back."""

    q_c: float
    S_c: float
    at_floor: bool
    at_ceiling: bool
    at_range: bool


@compiled
def step(
    envelope: Envelope, d: Decoupler, state: State, q_c: float, S_c: float, F_A: float, F_B: float
) -> tuple[Output, State]:
    """One tick: what the outer loops ask for and the load cells' readings [N] to what may be asked for."""
    pull = state.pull + (1.0 - math.exp(-T_s / FILTER_TIME_S)) * (F_A - F_B - state.pull)
    share = 0.5 * abs(pull)
    lowest = stiffness_under(d, envelope.F_floor + share)
    highest = stiffness_under(d, envelope.F_ceiling - share)
    S_held = min(max(S_c, lowest), highest)
    q_held = min(max(q_c, -envelope.q_max), envelope.q_max)
    return Output(q_held, S_held, S_held > S_c, S_held < S_c, q_held != q_c), State(pull)
