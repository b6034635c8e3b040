"""Outer loops: I-P on joint position and on stiffness (table 2, corrected by erratum E1)."""

from typing import NamedTuple

from backend.controllers.dead_zone import beyond
from plant.compiled import compiled
from plant.interface import T_s


class Gains(NamedTuple):
    """``k_p``, ``k_r`` [1], ``k_i`` [1/s]: the controlled quantity and the control signal have the same unit."""

    k_p: float
    k_i: float
    k_r: float


class State(NamedTuple):
    """``integral`` in units of the control signal, so that gains may change while it stands."""

    integral: float


@compiled
def step(gains: Gains, state: State, r: float, y: float, correction: float, unseen: float = 0.0) -> tuple[float, State]:
    """One tick of u = k_i ∫(r − y) dt + k_r r − k_p y.

    ``correction`` [unit of u per s] is what the anti-windup adds to the integral. As in the inner loop the error of
    this tick shows in u from the next one on. Of the error the integral sees what is beyond ``unseen`` [unit of y].
    """
    u = state.integral + gains.k_r * r - gains.k_p * y
    return u, State(state.integral + T_s * (gains.k_i * beyond(r - y, unseen) + correction))


@compiled
def bumpless(before: Gains, after: Gains, state: State, r: float, y: float) -> State:
    """State with which ``after`` gives the control signal that ``before`` would have given in this tick."""
    return State(state.integral + (after.k_p - before.k_p) * y - (after.k_r - before.k_r) * r)


@compiled
def raised(state: State, more: float) -> State:
    """State that gives ``more`` [unit of u] on top, for what is no longer added to u elsewhere."""
    return State(state.integral + more)


@compiled
def at_rest(gains: Gains, r: float, y: float, u: float) -> State:
    """State that gives the control signal u at reference r and measurement y."""
    return State(u + gains.k_p * y - gains.k_r * r)
