"""Braking of both motors as fast as ±10 V allow, without letting the tendons go.

The motor loops follow a reference through four lags: frozen references would let the joint run on for 0.66 s. Damping
the measured speed directly stops it in a fifth of that. The tendons' load makes both motors creep meanwhile, by 0.3
rad/s at 20 N and both alike, so that the joint stands; no load cell is needed: a stop works with a broken one too.
"""

import math
from typing import NamedTuple

from plant.compiled import compiled
from plant.interface import T_s

DAMPING = 1.5
"""Braking voltage per speed [V·s/rad]: above 7 rad/s it is the full 10 V, below it a time constant of 42 ms."""

SPEED_FILTER_S = 0.005
"""Time constant of the speed estimate [s]: one encoder count in one tick would read as 0.8 rad/s."""


class State(NamedTuple):
    """Last angles [rad] and estimated speeds [rad/s] of both motors."""

    theta_A: float
    theta_B: float
    omega_A: float
    omega_B: float


@compiled
def step(state: State, theta_A: float, theta_B: float, u_max: float) -> tuple[float, float, State]:
    """One tick: measured angles [rad] to braking voltages [V] within ±u_max."""
    pass_through = 1.0 - math.exp(-T_s / SPEED_FILTER_S)
    omega_A = state.omega_A + pass_through * ((theta_A - state.theta_A) / T_s - state.omega_A)
    omega_B = state.omega_B + pass_through * ((theta_B - state.theta_B) / T_s - state.omega_B)
    u_A = min(max(-DAMPING * omega_A, -u_max), u_max)
    u_B = min(max(-DAMPING * omega_B, -u_max), u_max)
    return u_A, u_B, State(theta_A, theta_B, omega_A, omega_B)
