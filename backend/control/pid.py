"""I-PD and I-P laws with anti-windup (table 2), force loop, and motor loop pair."""

import math
from typing import NamedTuple

from plant import T_s, compiled

# Dead zone -----------------------------------------------------------------------------------------
# Error that an integrator uses: zero within a dead zone, the excess beyond.


@compiled
def apply_dead_zone(e: float, dead_zone: float) -> float:
    """Return the part of the error ``e`` beyond ±``dead_zone``, in the same unit.

    It is continuous at the edge. Within the dead zone an integrator would hunt against static friction.
    """
    return e - min(max(e, -dead_zone), dead_zone)


# Force hold ----------------------------------------------------------------------------------------
# The slow force loop C_p of the actuator identification (figure 5): tendon tension to motor A, motor B at zero.


K_I = 0.05
"""Integral gain [rad/(N·s)]. One radian of motor A changes the mean tension by 2.7 to 4.8 N over 10 to 40 N, so the
loop has a time constant of 4 to 7 s: far slower than the motor loops, hence stable, and slow compared with the
excitation."""

TRIM_MAX = 1.0
"""Limit of the trim [rad]: 2.7 to 4.8 N of tension, 0.05 rad of the joint. The forecast of a run holds for any trim
within it; springs that need more differ from the identified ones and must be identified first."""


class ForceHoldState(NamedTuple):
    """State of the force loop: ``trim`` [rad] added to motor A's feed-forward angle."""

    trim: float


@compiled
def step_force_hold(state: ForceHoldState, F_ref: float, F_A: float, F_B: float) -> tuple[float, ForceHoldState]:
    """Step the force loop; return the trim [rad] and the new state.

    The controlled tension is the mean of both tendons [N].
    """
    trim = state.trim + T_s * K_I * (F_ref - 0.5 * (F_A + F_B))
    return state.trim, ForceHoldState(min(max(trim, -TRIM_MAX), TRIM_MAX))


# I-P -----------------------------------------------------------------------------------------------
# Outer loops: I-P on joint position and on stiffness (table 2, corrected by erratum E1).


class IPGains(NamedTuple):
    """Gains ``k_p``, ``k_r`` [1], ``k_i`` [1/s].

    The controlled quantity and the control signal have the same unit.
    """

    k_p: float
    k_i: float
    k_r: float


class IPState(NamedTuple):
    """State of an I-P loop.

    ``integral`` is in units of the control signal, so gains can change without a jump.
    """

    integral: float


@compiled
def step_i_p(
    gains: IPGains, state: IPState, r: float, y: float, correction: float, dead_zone: float = 0.0
) -> tuple[float, IPState]:
    """Step u = k_i ∫(r − y) dt + k_r r − k_p y; return u and the new state.

    ``correction`` [unit of u per s] is added to the integral's rate by the anti-windup. As in the inner loop, the error
    of this tick affects u from the next one on. The integral uses the error beyond ``dead_zone`` [unit of y].
    """
    u = state.integral + gains.k_r * r - gains.k_p * y
    return u, IPState(state.integral + T_s * (gains.k_i * apply_dead_zone(r - y, dead_zone) + correction))


@compiled
def bumpless_i_p(before: IPGains, after: IPGains, state: IPState, r: float, y: float) -> IPState:
    """Return the state with which ``after`` gives the u of ``before`` in this tick."""
    return IPState(state.integral + (after.k_p - before.k_p) * y - (after.k_r - before.k_r) * r)


@compiled
def add_to_integral(state: IPState, increment: float) -> IPState:
    """Return the state with ``increment`` [unit of u] added to u."""
    return IPState(state.integral + increment)


@compiled
def at_rest_i_p(gains: IPGains, r: float, y: float, u: float) -> IPState:
    """Return the state that gives the control signal u at reference r, measurement y."""
    return IPState(u + gains.k_p * y - gains.k_r * r)


# I-PD ----------------------------------------------------------------------------------------------
# Inner loop: I-PD on motor position with a filter on the whole control signal (table 2).


TRACKING_TIME_S = 0.030
"""Time constant with which clipped voltage bleeds the integrator [s] (method section 5)."""

HOLD_GAIN = 1.5
"""Additional gain, as a multiple of k_p, that holds a motor at rest: it creeps faster against friction, and less far.
Without friction its loop still has a damping ratio of 0.25."""


class IPDGains(NamedTuple):
    """Gains ``k_p`` [V/rad], ``k_i`` [V/(rad·s)], ``k_d`` [V·s/rad], ``t_f`` [s]."""

    k_p: float
    k_i: float
    k_d: float
    t_f: float


class IPDState(NamedTuple):
    """State of an I-PD loop.

    ``integral`` [V]; ``integral_f`` [V] and ``y_f`` [rad] after the filter 1/(t_f s + 1).
    """

    integral: float
    integral_f: float
    y_f: float


@compiled
def _filter_output(gains: IPDGains, state: IPDState, y: float) -> tuple[float, float, float]:
    """Return u [V] before its limit, and the filtered integral and measurement.

    u = (k_i ∫(r − y) dt − k_p y − k_d dy/dt) / (t_f s + 1), with the derivative taken from the filter itself: s y/(t_f
    s + 1) = (y − y_f)/t_f.
    """
    pass_through = 1.0 - math.exp(-T_s / gains.t_f)
    integral_f = state.integral_f + pass_through * (state.integral - state.integral_f)
    y_f = state.y_f + pass_through * (y - state.y_f)
    u = integral_f - gains.k_p * y_f - gains.k_d / gains.t_f * (y - y_f)
    return u, integral_f, y_f


@compiled
def step_i_pd(
    gains: IPDGains, state: IPDState, r: float, y: float, u_max: float, u_forward: float = 0.0, resting: bool = False
) -> tuple[float, float, IPDState]:
    """Step the loop; return u [V] within ±u_max, the clipped excess [V] and the state.

    r, y: reference and measured motor position [rad], absolute or relative to a model, whose voltage ``u_forward`` [V]
    is added. The integral adds this tick's error for the next tick, so u depends only on past errors and a change of
    gains has no effect in its first tick. While ``resting`` the integral ignores the error and compensates the motor's
    motion instead.
    """
    u, integral_f, y_f = _filter_output(gains, state, y)
    u += u_forward
    u_limited = min(max(u, -u_max), u_max)
    e, hold_correction = (0.0, HOLD_GAIN * gains.k_p * (y_f - state.y_f)) if resting else (r - y, 0.0)
    integral = state.integral + T_s * (gains.k_i * e + (u_limited - u) / TRACKING_TIME_S)
    return u_limited, u - u_limited, IPDState(integral - hold_correction, integral_f - hold_correction, y_f)


@compiled
def bumpless_i_pd(before: IPDGains, after: IPDGains, state: IPDState, y: float) -> IPDState:
    """Return the state with which ``after`` gives the u of ``before`` in this tick."""
    u_before, _, _ = _filter_output(before, state, y)
    u_after, _, _ = _filter_output(after, state, y)
    offset = u_before - u_after
    return IPDState(state.integral + offset, state.integral_f + offset, state.y_f)


@compiled
def at_rest_i_pd(gains: IPDGains, y: float, u: float) -> IPDState:
    """Return the state that holds the voltage u [V] at the constant position y [rad]."""
    return IPDState(u + gains.k_p * y, u + gains.k_p * y, y)


@compiled
def rebase_i_pd(gains: IPDGains, state: IPDState, y: float, offset: float, rate: float, u_added: float) -> IPDState:
    """Return the state for another origin of y.

    ``offset`` [rad] is added to y, ``rate`` [rad/s] to its speed; this tick's voltage changes by ``u_added`` [V].
    """
    u, _, _ = _filter_output(gains, state, y)
    y_f = state.y_f + offset - gains.t_f * rate
    after, _, _ = _filter_output(gains, IPDState(state.integral, state.integral_f, y_f), y + offset)
    increment = u + u_added - after
    return IPDState(state.integral + increment, state.integral_f + increment, y_f)


@compiled
def shift_i_pd(gains: IPDGains, state: IPDState, offset: float) -> IPDState:
    """Return the state after a shift of y's zero by ``offset`` [rad], u unchanged.

    ``offset`` is the new reading minus the old one.
    """
    return IPDState(state.integral + gains.k_p * offset, state.integral_f + gains.k_p * offset, state.y_f + offset)


# Motors --------------------------------------------------------------------------------------------
# The two inner loops as a pair.


class MotorPairGains(NamedTuple):
    """Gains of the loop of each motor."""

    A: IPDGains
    B: IPDGains


class MotorPairState(NamedTuple):
    """State of the loop of each motor."""

    A: IPDState
    B: IPDState


class MotorPairOutput(NamedTuple):
    """Voltages within their limit [V], and the clipped excess [V]."""

    u_A: float
    u_B: float
    excess_A: float
    excess_B: float


@compiled
def step_motor_pair(
    gains: MotorPairGains,
    state: MotorPairState,
    theta_A_ref: float,
    theta_B_ref: float,
    theta_A: float,
    theta_B: float,
    u_max: float,
    forward_A: float = 0.0,
    forward_B: float = 0.0,
    resting: bool = False,
) -> tuple[MotorPairOutput, MotorPairState]:
    """Step both loops: references and positions [rad] to voltages [V] within ±u_max.

    ``forward_A``, ``forward_B`` [V] are added to the voltages of the loops. While ``resting`` the integrators ignore
    errors.
    """
    u_A, excess_A, state_A = step_i_pd(
        gains=gains.A, state=state.A, r=theta_A_ref, y=theta_A, u_max=u_max, u_forward=forward_A, resting=resting
    )
    u_B, excess_B, state_B = step_i_pd(
        gains=gains.B, state=state.B, r=theta_B_ref, y=theta_B, u_max=u_max, u_forward=forward_B, resting=resting
    )
    return MotorPairOutput(u_A, u_B, excess_A, excess_B), MotorPairState(state_A, state_B)


@compiled
def bumpless_motor_pair(
    before: MotorPairGains, after: MotorPairGains, state: MotorPairState, theta_A: float, theta_B: float
) -> MotorPairState:
    """Return the state with which ``after`` continues the voltages of ``before``."""
    return MotorPairState(
        bumpless_i_pd(before.A, after.A, state.A, theta_A),
        bumpless_i_pd(before.B, after.B, state.B, theta_B),
    )


@compiled
def at_rest_motor_pair(gains: MotorPairGains, theta_A: float, theta_B: float, u_A: float, u_B: float) -> MotorPairState:
    """Return the state that holds voltages u_A, u_B [V] at motors at rest."""
    return MotorPairState(at_rest_i_pd(gains.A, theta_A, u_A), at_rest_i_pd(gains.B, theta_B, u_B))


@compiled
def shift_motor_pair(gains: MotorPairGains, state: MotorPairState, offset_A: float, offset_B: float) -> MotorPairState:
    """Return the state after the encoders' zeros moved, with the same voltages.

    ``offset_A``, ``offset_B`` [rad] are the new readings minus the old ones.
    """
    return MotorPairState(shift_i_pd(gains.A, state.A, offset_A), shift_i_pd(gains.B, state.B, offset_B))
