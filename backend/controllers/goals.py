"""Where the two axes of a plan are sent, how fast that moves, and where it is going to stand."""

import math
from typing import NamedTuple

from backend.controllers import decoupler
from backend.controllers.axis import Goal
from backend.controllers.decoupler import Decoupler
from plant.compiled import compiled
from plant.interface import T_s


class References(NamedTuple):
    """Position [rad] and stiffness [N·m/rad] of this tick, and where a move of theirs ends and stays.

    nan: they stand already, or nobody has announced an end.
    """

    q: float
    S: float
    q_end: float = math.nan
    S_end: float = math.nan


@compiled
def goals(d: Decoupler, before_d: Goal, before_c: Goal, r: References, V: float) -> tuple[Goal, Goal]:
    """Goals of difference and common axis after those of the tick before, for motors that reach V [rad/s]."""
    theta_A, theta_B = decoupler.motor_positions(d, r.q, r.S)
    end_d, end_c = _ends(d, r)
    return (
        _goal(before_d, 0.5 * (theta_A - theta_B), end_d, V),
        _goal(before_c, 0.5 * (theta_A + theta_B), end_c, V),
    )


@compiled
def jumps(before: Goal, goal: Goal) -> bool:
    """Whether a goal is not where the one before was, and has not gone there in steps that a motor could follow."""
    return goal.theta != before.theta and (goal.rate == 0.0 or before.rate == 0.0)


@compiled
def _goal(before: Goal, theta: float, end: float, V: float) -> Goal:
    """Goal of this tick: one that has gone no further than a motor could follow is moving, any other has jumped."""
    moved = theta - before.theta
    return Goal(theta, moved / T_s if abs(moved) <= V * T_s else 0.0, end)


@compiled
def _ends(d: Decoupler, r: References) -> tuple[float, float]:
    """Return the ends [rad] of difference and common axis; nan where that of its own reference is not known."""
    if math.isnan(r.q_end) and math.isnan(r.S_end):
        return math.nan, math.nan
    q, S = r.q if math.isnan(r.q_end) else r.q_end, r.S if math.isnan(r.S_end) else r.S_end
    theta_A, theta_B = decoupler.motor_positions(d, q, S)
    return (
        math.nan if math.isnan(r.q_end) else 0.5 * (theta_A - theta_B),
        math.nan if math.isnan(r.S_end) else 0.5 * (theta_A + theta_B),
    )
