"""Pretension: wind both motors up from slack, each watching its own load cell."""

import math
from typing import NamedTuple

from plant.compiled import compiled
from plant.interface import T_s

RATE_PER_NEWTON = 0.15
"""Winding speed per newton still missing [rad/(s·N)]: with 5.5 N/rad at 10 N a time constant of 1.2 s, four times
slower than the motor loops."""

RATE_MAX = 1.5
"""Fastest winding [rad/s]."""

FILTER_S = 0.1
"""Time constant of the load cell filter [s]."""

TOLERANCE_N = 0.1
"""How near the wanted tension counts as reached [N]."""

STANDSTILL_S = 0.5
"""How long both tensions must stay within tolerance [s]."""


class State(NamedTuple):
    """Filtered tensions [N], motor references [rad], and how long both tensions have been right [s]."""

    F_A: float
    F_B: float
    theta_A_ref: float
    theta_B_ref: float
    steady_s: float


@compiled
def step(state: State, F_ref: float, F_A: float, F_B: float) -> State:
    """One tick towards F_ref [N] in each tendon, from load cell readings [N]."""
    pass_through = 1.0 - math.exp(-T_s / FILTER_S)
    F_A = state.F_A + pass_through * (F_A - state.F_A)
    F_B = state.F_B + pass_through * (F_B - state.F_B)
    rate_A = min(max(RATE_PER_NEWTON * (F_ref - F_A), -RATE_MAX), RATE_MAX)
    rate_B = min(max(RATE_PER_NEWTON * (F_ref - F_B), -RATE_MAX), RATE_MAX)
    right = abs(F_A - F_ref) < TOLERANCE_N and abs(F_B - F_ref) < TOLERANCE_N
    return State(
        F_A,
        F_B,
        state.theta_A_ref + T_s * rate_A,
        state.theta_B_ref + T_s * rate_B,
        state.steady_s + T_s if right else 0.0,
    )
