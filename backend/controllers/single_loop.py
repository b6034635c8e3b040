"""Baseline without cascade: one I-PD loop on joint position and one on stiffness, straight to the motor voltages.

What the paper compares its cascade with. Both motors pull against each other, so a voltage with opposite signs turns
the joint and a voltage with equal signs stiffens it: u_A = u_S + u_q, u_B = u_S − u_q, the directions of the
decoupler (equations 18, 19). Governor, voltage limit and references are the cascade's.
"""

import math
from typing import NamedTuple

from backend.controllers import cascade, decoupler, governor, i_pd
from backend.controllers.decoupler import Decoupler
from plant.compiled import compiled
from plant.interface import Measurement, T_s

NOT_USED = math.nan
"""What the sample shows for motor references, which this law does not have."""


class Gains(NamedTuple):
    """``position``: volts from rad; ``stiffness``: volts from N·m/rad."""

    position: i_pd.Gains
    stiffness: i_pd.Gains


class Tuning(NamedTuple):
    """All the tick needs; ``omega_max`` [rad/s] of the governor, ``u_max`` [V]."""

    gains: Gains
    decoupler: Decoupler
    omega_max: float
    u_max: float


class State(NamedTuple):
    """Everything the law remembers from tick to tick."""

    governor: governor.State
    position: i_pd.State
    stiffness: i_pd.State


@compiled
def step(tuning: Tuning, state: State, q_ref: float, S_ref: float, m: Measurement) -> tuple[cascade.Output, State]:
    """One tick: references [rad, N·m/rad] and a measurement to motor voltages [V]."""
    S = decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B)
    reference, governed = governor.step(tuning.decoupler, tuning.omega_max, state.governor, q_ref, S_ref)
    u_q, _, position = i_pd.step(tuning.gains.position, state.position, reference.q_ref, m.q, math.inf)
    u_S, _, stiffness = i_pd.step(tuning.gains.stiffness, state.stiffness, reference.S_ref, S, math.inf)
    u_A = min(max(u_S + u_q, -tuning.u_max), tuning.u_max)
    u_B = min(max(u_S - u_q, -tuning.u_max), tuning.u_max)
    clipped_A, clipped_B = u_S + u_q - u_A, u_S - u_q - u_B
    output = cascade.Output(
        u_A,
        u_B,
        NOT_USED,
        NOT_USED,
        S,
        reference.q_ref,
        reference.S_ref,
        0.0,
        clipped_A != 0.0,
        clipped_B != 0.0,
        governed,
        False,
        False,
        False,
    )
    return output, State(
        reference,
        _bled(position, 0.5 * (clipped_A - clipped_B)),
        _bled(stiffness, 0.5 * (clipped_A + clipped_B)),
    )


@compiled
def _bled(state: i_pd.State, excess: float) -> i_pd.State:
    """Anti-windup: the voltage that the motors did not get bleeds the integrator, as in the cascade's inner loops."""
    return i_pd.State(state.integral - T_s * excess / i_pd.TRACKING_TIME_S, state.integral_f, state.y_f)


@compiled
def take_over(tuning: Tuning, u_A: float, u_B: float, m: Measurement) -> State:
    """State that continues from the voltages u_A, u_B [V] at a standing joint; references where the joint is."""
    S = decoupler.stiffness(tuning.decoupler, m.theta_A, m.theta_B)
    return State(
        governor.State(m.q, S),
        i_pd.at_rest(tuning.gains.position, m.q, 0.5 * (u_A - u_B)),
        i_pd.at_rest(tuning.gains.stiffness, S, 0.5 * (u_A + u_B)),
    )
