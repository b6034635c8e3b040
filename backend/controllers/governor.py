"""Reference governor: both references move together, no faster than the motors can follow.

A step of the references asks for motor speeds that ±10 V cannot give; the loops would saturate, couple and wind up.
The governor keeps the linear design valid instead: it walks (q_ref, S_ref) along the straight line to the target so
that neither motor reference moves faster than ``omega_max`` (method section 5).
"""

from typing import NamedTuple

from backend.controllers.decoupler import Decoupler, motor_positions
from plant.compiled import compiled
from plant.interface import T_s


class State(NamedTuple):
    """References handed to the outer loops [rad, N·m/rad]."""

    q_ref: float
    S_ref: float


@compiled
def step(d: Decoupler, omega_max: float, state: State, q_ref: float, S_ref: float) -> tuple[State, bool]:
    """One tick towards (q_ref, S_ref). Returns the governed references and whether the governor held them back."""
    now_A, now_B = motor_positions(d, state.q_ref, state.S_ref)
    target_A, target_B = motor_positions(d, q_ref, S_ref)
    distance = max(abs(target_A - now_A), abs(target_B - now_B))
    reach = omega_max * T_s
    if distance <= reach:
        return State(q_ref, S_ref), False
    share = reach / distance
    return State(state.q_ref + share * (q_ref - state.q_ref), state.S_ref + share * (S_ref - state.S_ref)), True
