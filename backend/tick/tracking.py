"""The cascade, following the operator's references or a program's segments."""

import math
from typing import NamedTuple

from backend.controllers import cascade, decoupler
from backend.controllers.goals import References
from backend.controllers.limits import Bounds
from backend.faults import Limit
from backend.tick.decision import VOLTAGE_A, VOLTAGE_B, Carry, Decision, Target
from backend.tick.player import Player, announced, play
from plant.compiled import compiled
from plant.interface import Measurement

_GOVERNOR, _FLOOR, _CEILING, _RANGE = (
    int(flag) for flag in (Limit.GOVERNOR, Limit.TENSION_FLOOR, Limit.TENSION_CEILING, Limit.JOINT_RANGE)
)


class State(NamedTuple):
    """``position_loop``: closed; without it the decoupler's geometry alone positions the joint. ``plays`` a program.

    ``tau_ext`` [N·m]: outside torque in this tick, nan as long as its bias is not known.
    """

    law: cascade.State
    position_loop: bool
    plays: bool
    player: Player
    tau_ext: float = math.nan


@compiled
def step(
    tuning: cascade.Tuning, carry: Carry, target: Target, state: State, m: Measurement
) -> tuple[Decision, Carry, State]:
    """One tick of the cascade."""
    done, player, q_end, S_end = False, state.player, math.nan, math.nan
    if state.plays:
        done, target, player = play(player, target)
        q_end, S_end = announced(player)
    references = References(target.q_ref, target.S_ref, q_end, S_end)
    y, law = cascade.step(tuning, state.law, references, state.position_loop, m, state.tau_ext)
    carry = Carry(law.alone, tuning.motors, y.theta_A_ref, y.theta_B_ref)
    return (
        decided(y, target, state.plays, done),
        carry,
        State(law, state.position_loop, state.plays, player, state.tau_ext),
    )


@compiled
def decided(y: cascade.Output, target: Target, pushes: bool, done: bool) -> Decision:
    """Decision of a law of position and stiffness."""
    return Decision(
        y.u_A,
        y.u_B,
        y.theta_A_ref,
        y.theta_B_ref,
        target,
        y.q_ref_gov,
        y.S_ref_gov,
        y.bank_entry,
        acting(y),
        pushes,
        done,
    )


@compiled
def acting(y: cascade.Output) -> int:
    """Limit flags of a tick."""
    return (
        (VOLTAGE_A if y.clipped_A else 0)
        | (VOLTAGE_B if y.clipped_B else 0)
        | (_GOVERNOR if y.governed else 0)
        | (_FLOOR if y.at_floor else 0)
        | (_CEILING if y.at_ceiling else 0)
        | (_RANGE if y.at_range else 0)
    )


def here(tuning: cascade.Tuning, m: Measurement, bounds: Bounds, *, position_loop: bool = True) -> Target:
    """Return references with which nothing has to move, as far as references may go.

    Without position loop q_ref is the equilibrium of the motors [rad], and not where a push holds the joint.
    """
    d = tuning.decoupler
    q = m.q if position_loop else decoupler.equilibrium(d, m.theta_A, m.theta_B)
    S = decoupler.stiffness(d, m.theta_A, m.theta_B)
    return Target(min(max(q, bounds.q_min), bounds.q_max), min(max(S, bounds.S_min), bounds.S_max), 0.0)
