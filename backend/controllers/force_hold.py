"""The slow force loop C_p of the actuator identification (figure 5): tendon tension to motor A, motor B at zero."""

from typing import NamedTuple

from plant.compiled import compiled
from plant.interface import T_s

K_I = 0.05
"""Integral gain [rad/(N·s)]. One radian of motor A moves the mean tension by 2.7 to 4.8 N over 10 to 40 N, so the loop
has a time constant of 4 to 7 s: stable far from the motor loops' lag, and slow against the excitation."""

TRIM_MAX = 1.0
"""Bound of the trim [rad]: 2.7 to 4.8 N of tension, 0.05 rad of the joint. What is announced before a run holds for any
trim within it; springs that need more are not those that were identified, and have to be identified first."""


class State(NamedTuple):
    """``trim`` [rad] added to the feed-forward position of motor A."""

    trim: float


@compiled
def step(state: State, F_ref: float, F_A: float, F_B: float) -> tuple[float, State]:
    """One tick. Returns the trim [rad] and the new state; the tension held is the mean of both tendons [N]."""
    trim = state.trim + T_s * K_I * (F_ref - 0.5 * (F_A + F_B))
    return state.trim, State(min(max(trim, -TRIM_MAX), TRIM_MAX))
