"""Where the two axes of a plan are sent, how fast that moves, and where it is going to stand."""

import math
from typing import NamedTuple

from backend.controllers import decoupler
from backend.controllers.axis import BRAKING, LANDING_S, Axis, Goal, braking_distance, least_voltage
from backend.controllers.decoupler import Decoupler
from plant.compiled import compiled
from plant.interface import T_s

LEAST_RAD_S = 1e-3
"""An axis that has nothing left of the budget brakes with this, as speed [rad/s]."""


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
def soonest_stand(
    K: float, T: float, U: float, d: Axis, c: Axis, goal_d: Goal, goal_c: Goal
) -> tuple[Goal, Goal, float]:
    """Where both axes come to stand soonest within U [V], none beyond where it was sent; share of the difference axis.

    Each is given volts as it is fast, or what it takes to stop where it was sent: the common axis first.
    """
    before_d, before_c = _sent_before(d, goal_d), _sent_before(c, goal_c)
    w_d, w_c = abs(d.omega), abs(c.omega)
    share = w_d / (w_d + w_c) if w_d + w_c > 0.0 else 0.5
    share = max(share, least_voltage(K, T, w_d, before_d, U) / U)
    share = min(share, 1.0 - least_voltage(K, T, w_c, before_c, U) / U)
    return _stopped(K * share * U, T, d, before_d), _stopped(K * (1.0 - share) * U, T, c, before_c), share


@compiled
def _sent_before(axis: Axis, goal: Goal) -> float:
    """How far [rad] ahead of an axis lies where it was sent to stand; inf: nowhere ahead of it, or not known."""
    ahead = math.copysign(1.0, axis.omega) * ((goal.theta if goal.rate == 0.0 else goal.end) - axis.theta)
    return ahead if ahead > 0.0 else math.inf


@compiled
def _stopped(V: float, T: float, axis: Axis, most: float) -> Goal:
    """Where an axis stands once V [rad/s] have stopped it, ``most`` [rad] ahead of where it is."""
    V = max(BRAKING * V, LEAST_RAD_S)
    landing = 0.5 * V / T * LANDING_S**2
    way = min(braking_distance(V, T, abs(axis.omega)) + landing, most)
    return Goal(axis.theta + math.copysign(way, axis.omega), 0.0, math.nan, 0.0)


@compiled
def _goal(before: Goal, theta: float, end: float, V: float) -> Goal:
    """Goal of this tick: one that has gone no further than a motor could follow is moving, any other has jumped.

    So has one that begins to move, as a small step cannot be told from a ramp in its first tick.
    """
    moved, reach = theta - before.theta, V * T_s
    moves = 0.0 < abs(before.moved) <= reach and abs(moved) <= reach
    return Goal(theta, moved / T_s if moves else 0.0, end, moved)


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
