"""Inner loop: I-PD on motor position with a filter on the whole control signal (table 2)."""

import math
from typing import NamedTuple

from plant.compiled import compiled
from plant.interface import T_s

TRACKING_TIME_S = 0.030
"""Time constant with which the clipped voltage bleeds the integrator (method section 5)."""

HOLDS = 1.5
"""A motor that rests is held where it stands by so many times k_p more: what it creeps against friction, it creeps so
much faster and less far. Without any friction its loop still has a damping ratio of 0.25."""


class Gains(NamedTuple):
    """``k_p`` [V/rad], ``k_i`` [V/(rad·s)], ``k_d`` [V·s/rad], ``t_f`` [s]."""

    k_p: float
    k_i: float
    k_d: float
    t_f: float


class State(NamedTuple):
    """``integral`` [V]; ``integral_f`` [V] and ``y_f`` [rad], both behind the filter 1/(t_f s + 1)."""

    integral: float
    integral_f: float
    y_f: float


@compiled
def _filtered(gains: Gains, state: State, y: float) -> tuple[float, float, float]:
    """Return u [V] before its limit, and the filtered integral and measurement it is made of.

    u = (k_i ∫(r − y) dt − k_p y − k_d dy/dt) / (t_f s + 1), with the derivative taken from the filter itself:
    s y/(t_f s + 1) = (y − y_f)/t_f.
    """
    pass_through = 1.0 - math.exp(-T_s / gains.t_f)
    integral_f = state.integral_f + pass_through * (state.integral - state.integral_f)
    y_f = state.y_f + pass_through * (y - state.y_f)
    u = integral_f - gains.k_p * y_f - gains.k_d / gains.t_f * (y - y_f)
    return u, integral_f, y_f


@compiled
def step(
    gains: Gains, state: State, r: float, y: float, u_max: float, u_forward: float = 0.0, resting: bool = False
) -> tuple[float, float, State]:
    """One tick. Returns u [V] within ±u_max, the excess that was clipped off [V], and the new state.

    r, y: reference and measured motor position [rad], as they are or both counted from where a model is, whose voltage
    ``u_forward`` [V] comes on top. The integral takes up this tick's error for the next tick, so that u depends on the
    past of the error only and a change of gains cannot show in the tick it arrives. While it is ``resting`` it sees no
    error, and takes up what the motor turns instead.
    """
    u, integral_f, y_f = _filtered(gains, state, y)
    u += u_forward
    u_limited = min(max(u, -u_max), u_max)
    e, held = (0.0, HOLDS * gains.k_p * (y_f - state.y_f)) if resting else (r - y, 0.0)
    integral = state.integral + T_s * (gains.k_i * e + (u_limited - u) / TRACKING_TIME_S)
    return u_limited, u - u_limited, State(integral - held, integral_f - held, y_f)


@compiled
def bumpless(before: Gains, after: Gains, state: State, y: float) -> State:
    """State with which ``after`` gives the voltage that ``before`` would have given in this tick."""
    u_before, _, _ = _filtered(before, state, y)
    u_after, _, _ = _filtered(after, state, y)
    offset = u_before - u_after
    return State(state.integral + offset, state.integral_f + offset, state.y_f)


@compiled
def at_rest(gains: Gains, y: float, u: float) -> State:
    """State that holds the voltage u [V] at the standing position y [rad]."""
    return State(u + gains.k_p * y, u + gains.k_p * y, y)


@compiled
def carried(gains: Gains, state: State, y: float, offset: float, rate: float, u_more: float) -> State:
    """State after y was counted anew: ``offset`` [rad] comes on top of it, ``rate`` [rad/s] on top of its speed.

    With it this tick's voltage is the one from before and ``u_more`` [V].
    """
    u, _, _ = _filtered(gains, state, y)
    y_f = state.y_f + offset - gains.t_f * rate
    after, _, _ = _filtered(gains, State(state.integral, state.integral_f, y_f), y + offset)
    more = u + u_more - after
    return State(state.integral + more, state.integral_f + more, y_f)


@compiled
def shift(gains: Gains, state: State, offset: float) -> State:
    """State after the zero of y moved by ``offset`` [rad] (new reading minus old): the voltage goes on unchanged."""
    return State(state.integral + gains.k_p * offset, state.integral_f + gains.k_p * offset, state.y_f + offset)
