"""Time-optimal trajectories of both axes within a voltage limit."""

import math
from typing import NamedTuple

from backend.control import decoupler
from backend.control.decoupler import Decoupler
from plant import Mechanism, MotorAxes, T_s, compiled, elastic_torques

# Axis ----------------------------------------------------------------------------------------------
# One axis of a trajectory: a motor T θ'' + θ' = K u within a voltage limit, moving to a target in the least time.


LANDING_S = 0.010
"""Time constant with which an axis settles at its target, where the braking curve has no finite slope [s]."""

BRAKING_SHARE = 0.98
"""Fraction of the voltage limit that braking uses: the rest keeps an axis on its curve."""

HALVINGS = 24
"""Iterations of a bisection."""

MIN_VOLTAGE_V = 1e-3
"""Least voltage limit of an axis [V], for one without a remaining share."""


class AxisMotion(NamedTuple):
    """Angle [rad] and speed [rad/s] of one axis of the model."""

    theta: float
    omega: float


class Lagged(NamedTuple):
    """Angle [rad], speed [rad/s] and voltage [V] after the motors' electrical lag."""

    theta: float
    omega: float
    u: float


class AxisTarget(NamedTuple):
    """Target of an axis [rad], its speed [rad/s], 0 after a jump, and its end [rad].

    ``end`` is NaN if unknown. ``displacement`` [rad]: change since the previous tick.
    """

    theta: float
    rate: float
    end: float = math.nan
    displacement: float = 0.0


@compiled
def braking_distance(V: float, T: float, omega: float) -> float:
    """Return the distance [rad] in which −V/K volts stop an axis from ``omega`` ≥ 0.

    T ω − V T ln(1 + ω/V), with speeds in rad/s.
    """
    return T * omega - V * T * math.log1p(omega / V)


@compiled
def braking_speed(V: float, T: float, distance: float) -> float:
    """Return the speed [rad/s] from which −V/K volts stop an axis within ``distance``.

    ``distance`` ≥ 0 [rad]; the inverse of ``braking_distance``.
    """
    E = max(distance, 0.0) / (V * T)
    y = math.sqrt(2.0 * E) + E / 1.5
    for _ in range(3):  # solves y − ln(1 + y) = E; the start is exact for small E, Newton's steps for any
        y -= (y - math.log1p(y) - E) * (1.0 + y) / max(y, 1e-12)
    return V * y


@compiled
def least_voltage(K: float, T: float, omega: float, distance: float, U_max: float) -> float:
    """Return the least voltage [V] that stops an axis within ``distance`` [rad].

    ``omega`` [rad/s] is the speed in that direction; the result is 0 if it is not positive, and ``U_max`` if no less is
    enough.
    """
    if omega <= 0.0:
        return 0.0
    low, high = 0.0, U_max
    for _ in range(HALVINGS):
        U = 0.5 * (low + high)
        if braking_distance(BRAKING_SHARE * K * U, T, omega) > distance:
            low = U
        else:
            high = U
    return high


@compiled
def compute_duration(V: float, T: float, distance: float, omega: float) -> float:
    """Return the least time [s] from speed ``omega`` to rest at ``distance`` [rad].

    The voltage is at most V/K: full voltage in one direction, then in the other (T θ'' + θ' = K u, |K u| ≤ V);
    ``omega`` in rad/s.
    """
    brake = math.copysign(braking_distance(V, T, abs(omega)), omega)
    s = 1.0 if distance >= brake else -1.0
    e, w = s * distance, s * omega
    if V <= 0.0:
        return math.inf if e != 0.0 else 0.0
    a = 1.0 - w / V
    E = math.exp(min((e - T * w) / (V * T), 700.0))
    x = E + math.sqrt(max(E * E - a * E, 0.0))
    forward = T * math.log(max(x, 1.0))
    peak = V - (V - w) / max(x, 1.0)
    return forward + T * math.log1p(max(peak, 0.0) / V)


@compiled
def compute_approach_voltage(K: float, T: float, U: float, axis: AxisMotion, target: AxisTarget) -> float:
    """Return the voltage [V] within ±U up to the speed from which the axis can stop.

    For a moving target this speed is relative to the target's, and the axis can still stop at the target's end.
    """
    U = max(U, MIN_VOLTAGE_V)
    u = _compute_approach_voltage(K, T, U, axis, target)
    if target.rate == 0.0 or math.isnan(target.end):
        return u
    to_end = _compute_approach_voltage(K, T, U, axis, AxisTarget(target.end, 0.0, math.nan, 0.0))
    return min(u, to_end) if target.rate > 0.0 else max(u, to_end)


@compiled
def _compute_approach_voltage(K: float, T: float, U: float, axis: AxisMotion, target: AxisTarget) -> float:
    """Return the voltage [V] within ±U that reaches the target at the target's speed."""
    e, w = target.theta - axis.theta, axis.omega - target.rate
    e -= T_s * w  # after this voltage has acted
    s = 1.0 if e >= 0.0 else -1.0
    V = max(K * BRAKING_SHARE * U + s * target.rate, 0.05 * K * U)
    a = V / T
    landing = a * LANDING_S**2
    wanted = abs(e) / LANDING_S if abs(e) <= landing else braking_speed(V, T, abs(e) - 0.5 * landing)
    g = math.exp(-T_s / T)
    u = (target.rate + s * wanted - g * axis.omega) / (K * (1.0 - g))
    return min(max(u, -U), U)


@compiled
def advance_axis(K: float, T: float, axis: AxisMotion, u: float) -> AxisMotion:
    """Return the axis one tick later under u [V], exactly: T θ'' + θ' = K u."""
    g = math.exp(-T_s / T)
    transient = axis.omega - K * u
    return AxisMotion(axis.theta + K * u * T_s + transient * T * (1.0 - g), K * u + transient * g)


@compiled
def advance_lagged_axis(K: float, T: float, tau_e: float, axis: Lagged, u: float) -> Lagged:
    """Return the axis one tick later under u [V]: T θ'' + θ' = K v, τ_e v' + v = u.

    The solution is exact.
    """
    if abs(T - tau_e) < 1e-7 * T:
        tau_e *= 1.0 + 1e-7  # the solution below requires different lags
    g, h = math.exp(-T_s / T), math.exp(-T_s / tau_e)
    lagged = K * (axis.u - u) * tau_e / (tau_e - T)
    transient = axis.omega - K * u - lagged
    return Lagged(
        axis.theta + K * u * T_s + lagged * tau_e * (1.0 - h) + transient * T * (1.0 - g),
        K * u + lagged * h + transient * g,
        u + (axis.u - u) * h,
    )


# Targets -------------------------------------------------------------------------------------------
# Targets of the two axes of a trajectory, their speeds and ends.


MIN_SPEED_RAD_S = 1e-3
"""Least braking speed of an axis without a remaining share of the voltage limit [rad/s]."""


class LoopReferences(NamedTuple):
    """Position [rad] and stiffness [N·m/rad] of this tick, and the end of a ramp.

    ``q_end``, ``S_end``: NaN if the reference is constant or its end unknown.
    """

    q: float
    S: float
    q_end: float = math.nan
    S_end: float = math.nan


@compiled
def compute_targets(
    d: Decoupler, before_d: AxisTarget, before_c: AxisTarget, r: LoopReferences, V: float
) -> tuple[AxisTarget, AxisTarget]:
    """Return the targets of difference and common axis, for motors that reach V [rad/s].

    ``before_d``, ``before_c`` are the targets of the previous tick.
    """
    theta_A, theta_B = decoupler.motor_positions(d, r.q, r.S)
    end_d, end_c = _compute_target_ends(d, r)
    return (
        _make_target(before_d, 0.5 * (theta_A - theta_B), end_d, V),
        _make_target(before_c, 0.5 * (theta_A + theta_B), end_c, V),
    )


@compiled
def has_jumped(before: AxisTarget, target: AxisTarget) -> bool:
    """Return whether a target has changed by more than a motor could follow."""
    return target.theta != before.theta and (target.rate == 0.0 or before.rate == 0.0)


@compiled
def plan_fastest_stop(
    K: float, T: float, U: float, d: AxisMotion, c: AxisMotion, target_d: AxisTarget, target_c: AxisTarget
) -> tuple[AxisTarget, AxisTarget, float]:
    """Return targets at which both axes stop soonest, and the difference axis's share.

    No target is beyond the old one. U [V] is shared in proportion to speed, but each axis gets the voltage that stops
    it at its old target, the common axis first.
    """
    remaining_d, remaining_c = _compute_remaining_distance(d, target_d), _compute_remaining_distance(c, target_c)
    w_d, w_c = abs(d.omega), abs(c.omega)
    share = w_d / (w_d + w_c) if w_d + w_c > 0.0 else 0.5
    share = max(share, least_voltage(K, T, w_d, remaining_d, U) / U)
    share = min(share, 1.0 - least_voltage(K, T, w_c, remaining_c, U) / U)
    return (
        _make_stopping_target(K * share * U, T, d, remaining_d),
        _make_stopping_target(K * (1.0 - share) * U, T, c, remaining_c),
        share,
    )


@compiled
def _compute_remaining_distance(axis: AxisMotion, target: AxisTarget) -> float:
    """Return the distance [rad] from an axis to the end of its target.

    The result is inf if the end is behind the axis or unknown.
    """
    ahead = math.copysign(1.0, axis.omega) * ((target.theta if target.rate == 0.0 else target.end) - axis.theta)
    return ahead if ahead > 0.0 else math.inf


@compiled
def _make_stopping_target(V: float, T: float, axis: AxisMotion, distance_max: float) -> AxisTarget:
    """Return the target at which V [rad/s] stops an axis, at most ``distance_max`` away."""
    V = max(BRAKING_SHARE * V, MIN_SPEED_RAD_S)
    landing = 0.5 * V / T * LANDING_S**2
    distance = min(braking_distance(V, T, abs(axis.omega)) + landing, distance_max)
    return AxisTarget(axis.theta + math.copysign(distance, axis.omega), 0.0, math.nan, 0.0)


@compiled
def _make_target(before: AxisTarget, theta: float, end: float, V: float) -> AxisTarget:
    """Return the target of this tick, with its speed if it moves continuously.

    A target that changed by no more than a motor could follow is moving, any other has jumped. So has one that begins
    to move, as a small step looks like a ramp in its first tick.
    """
    displacement, reach = theta - before.theta, V * T_s
    is_moving = 0.0 < abs(before.displacement) <= reach and abs(displacement) <= reach
    return AxisTarget(theta, displacement / T_s if is_moving else 0.0, end, displacement)


@compiled
def _compute_target_ends(d: Decoupler, r: LoopReferences) -> tuple[float, float]:
    """Return the ends [rad] of difference and common axis, NaN if unknown."""
    if math.isnan(r.q_end) and math.isnan(r.S_end):
        return math.nan, math.nan
    q, S = r.q if math.isnan(r.q_end) else r.q_end, r.S if math.isnan(r.S_end) else r.S_end
    theta_A, theta_B = decoupler.motor_positions(d, q, S)
    return (
        math.nan if math.isnan(r.q_end) else 0.5 * (theta_A - theta_B),
        math.nan if math.isnan(r.S_end) else 0.5 * (theta_A + theta_B),
    )


# Trajectory ----------------------------------------------------------------------------------------
# Motion of motors and joint in each tick, as fast as a voltage limit allows, for the loops to track.
#
# Two axes move an exact model of the motors: the difference of the motor angles, which turns the joint, and their
# common part, which stiffens it. Each brakes along the curve from which full reverse voltage just stops it at the
# target, so a step takes the shortest possible time, and a moving reference is followed as long as the voltage limit
# suffices. The voltages of the model go directly to the motors (model following: the paper's loops act on the
# difference).


WINDOW_TICKS = 10
"""Ticks over which the voltages are averaged: end point and voltage limit are unchanged, a full reversal takes 10
ms."""

NEAR_TARGET_RAD = 0.05
"""Distance from its target [rad] within which an axis leaves its unused voltage to the other one."""

ARRIVED_RAD = 1e-3
"""Distance from its target [rad] within which an axis has arrived."""

SMALL_MOVE_RAD = 0.2
"""Move of both axes together [rad] that uses the whole voltage limit, 0.02 rad of the joint; a smaller one uses the
share (move/SMALL_MOVE_RAD)²: one count of the joint encoder must not cause a kick of 8 V."""

SMALL_MOVE_MIN_V = 0.05
"""Voltage of the smallest move [V]."""

STANDSTILL_RAD_S = 0.05
"""Speed of the axes, and of their voltages, below which the model is at rest [rad/s]."""


class TrajectoryModel(NamedTuple):
    """Model of the actuator.

    Motors (equation 17), torque per volt [N·m/V], joint (equations 5, 13), electrical lags [s] (equations 8, 9).
    """

    K_A: float
    T_A: float
    K_B: float
    T_B: float
    K_t_A: float
    K_t_B: float
    J_j: float
    B_j: float
    tau_e_A: float
    tau_e_B: float


Window = tuple[float, float, float, float, float, float, float, float, float, float]
"""Voltages of the last WINDOW_TICKS ticks [V], the newest first."""


class TrajectoryState(NamedTuple):
    """State of the model and its trajectory.

    - ``d``, ``c``: difference and common axis before smoothing.
    - ``smooth_d``, ``smooth_c``: the same after smoothing and electrical lag, the state of the model's motors.
    - ``share``: the difference axis's share of the voltage limit.
    - ``budget`` [V]: voltage limit of the tuning; ``voltage_limit`` [V]: the active one, larger while moving axes could
      otherwise not be stopped in time.
    - ``q`` [rad], ``q_dot`` [rad/s]: joint of the model.
    - ``F_held_A``, ``F_held_B`` [N]: tensions that the integrators of the motor loops already hold.
    """

    target_d: AxisTarget
    target_c: AxisTarget
    d: AxisMotion
    c: AxisMotion
    window_d: Window
    window_c: Window
    smooth_d: Lagged
    smooth_c: Lagged
    share: float
    budget: float
    voltage_limit: float
    q: float
    q_dot: float
    F_held_A: float
    F_held_B: float


class AxisState(NamedTuple):
    """State of the model: angles [rad], motor speeds [rad/s], stiffness [N·m/rad].

    Angles of motors and joint, and the joint's equilibrium ``q_e``.
    """

    theta_A: float
    theta_B: float
    omega_A: float
    omega_B: float
    q: float
    q_e: float
    S: float


class Driven(NamedTuple):
    """Voltages [V] that move the model in a tick, and whether it still moves."""

    u_A: float
    u_B: float
    moving: bool


@compiled
def begin_trajectory(
    d: Decoupler, model: TrajectoryModel, q: float, S: float, omega_A: float, omega_B: float
) -> TrajectoryState:
    """Return a model at ``q`` [rad], ``S`` [N·m/rad] with no other target.

    Its motors move at ``omega_A``, ``omega_B`` [rad/s] and hold its joint, moving or at rest. The loops keep the offset
    of the actuator's motors, which a push or springs other than the identified ones cause, so nothing has to move.
    """
    q_dot = _joint_speed(d, d.axes, omega_A, omega_B)
    q_e = q + model.B_j * q_dot / S
    theta_A, theta_B = decoupler.motor_positions(d, q_e, S)
    difference = AxisMotion(0.5 * (theta_A - theta_B), 0.5 * (omega_A - omega_B))
    common = AxisMotion(0.5 * (theta_A + theta_B), 0.5 * (omega_A + omega_B))
    F_A, F_B = _compute_tensions(d, d.mechanism, q_e, S, q)
    K = min(model.K_A, model.K_B)
    return TrajectoryState(
        target_d=AxisTarget(difference.theta, 0.0, math.nan, 0.0),
        target_c=AxisTarget(common.theta, 0.0, math.nan, 0.0),
        d=difference,
        c=common,
        window_d=_fill_window(difference.omega / K),
        window_c=_fill_window(common.omega / K),
        smooth_d=Lagged(difference.theta, difference.omega, difference.omega / K),
        smooth_c=Lagged(common.theta, common.omega, common.omega / K),
        share=0.5,
        budget=-1.0,
        voltage_limit=(abs(difference.omega) + abs(common.omega)) / K,
        q=q,
        q_dot=q_dot,
        F_held_A=F_A,
        F_held_B=F_B,
    )


@compiled
def compute_axis_state(d: Decoupler, state: TrajectoryState) -> AxisState:
    """Return positions, speeds and stiffness of the model."""
    A, B = _combine_axes(state.smooth_d, state.smooth_c)
    q_e, S = decoupler.equilibrium(d, A.theta, B.theta), decoupler.stiffness(d, A.theta, B.theta)
    return AxisState(theta_A=A.theta, theta_B=B.theta, omega_A=A.omega, omega_B=B.omega, q=state.q, q_e=q_e, S=S)


@compiled
def is_at_rest(model: TrajectoryModel, state: TrajectoryState) -> bool:
    """Return whether the model is at rest."""
    K = min(model.K_A, model.K_B)
    speed = max(abs(state.smooth_d.omega), abs(state.smooth_c.omega))
    mean_voltage = max(
        abs(_mean(state.window_d)), abs(_mean(state.window_c)), abs(state.smooth_d.u), abs(state.smooth_c.u)
    )
    return max(speed, K * mean_voltage) < STANDSTILL_RAD_S


@compiled
def step(
    d: Decoupler, model: TrajectoryModel, budget: float, state: TrajectoryState, at: AxisState, r: LoopReferences
) -> tuple[Driven, TrajectoryState]:
    """Step from ``at`` towards the references; 0 V bring the model to rest.

    ``budget`` [V] is the voltage limit of both axes together.
    """
    K, T = min(model.K_A, model.K_B), max(model.T_A, model.T_B)
    if budget > 0.0:
        target_d, target_c = compute_targets(d, state.target_d, state.target_c, r, K * budget)
    else:
        target_d, target_c = state.target_d, state.target_c
    share, voltage_limit = state.share, state.voltage_limit
    distance = abs(target_d.theta - state.smooth_d.theta) + abs(target_c.theta - state.smooth_c.theta)
    if budget == 0.0:
        if state.budget != 0.0:
            target_d, target_c, share = plan_fastest_stop(
                K=K, T=T, U=voltage_limit, d=state.d, c=state.c, target_d=target_d, target_c=target_c
            )
    elif budget != state.budget or has_jumped(state.target_d, target_d) or has_jumped(state.target_c, target_c):
        share, voltage_limit = share_budget(
            K=K,
            T=T,
            usable=_compute_usable_voltage(budget, state, target_d, target_c),
            budget=budget,
            state=state,
            target_d=target_d,
            target_c=target_c,
        )
    elif distance < ARRIVED_RAD:
        voltage_limit = min(voltage_limit, budget)
    tracking_d, tracking_c = abs(target_d.rate) / K, abs(target_c.rate) / K
    free = max(voltage_limit - tracking_d - tracking_c, 0.0)
    limit_d = tracking_d + share * free
    if abs(target_c.theta - state.c.theta) < NEAR_TARGET_RAD:  # the voltage that the common axis does not use
        limit_d = max(limit_d, voltage_limit - abs(state.window_c[0]))
    limit_d = min(limit_d, voltage_limit)
    u_d = compute_approach_voltage(K, T, limit_d, state.d, target_d)
    u_c = compute_approach_voltage(K, T, voltage_limit - abs(u_d), state.c, target_c)
    window_d, window_c = _shift_window(state.window_d, u_d), _shift_window(state.window_c, u_c)
    mean_d, mean_c = _mean(window_d), _mean(window_c)
    tau_e = max(model.tau_e_A, model.tau_e_B)
    smooth_d = advance_lagged_axis(K, T, tau_e, state.smooth_d, mean_d)
    smooth_c = advance_lagged_axis(K, T, tau_e, state.smooth_c, mean_c)

    A, B = _combine_axes(smooth_d, smooth_c)
    q_e, S = decoupler.equilibrium(d, A.theta, B.theta), decoupler.stiffness(d, A.theta, B.theta)
    q, q_dot = _advance_joint(model=model, q=state.q, q_dot=state.q_dot, q_e=at.q_e, S=at.S, q_e_next=q_e, S_next=S)

    feedforward_state = TrajectoryState(
        target_d=target_d,
        target_c=target_c,
        d=state.d,
        c=state.c,
        window_d=window_d,
        window_c=window_c,
        smooth_d=state.smooth_d,
        smooth_c=state.smooth_c,
        share=share,
        budget=budget,
        voltage_limit=voltage_limit,
        q=state.q,
        q_dot=state.q_dot,
        F_held_A=state.F_held_A,
        F_held_B=state.F_held_B,
    )
    u_A, u_B = compute_voltages(d, model, feedforward_state, at)
    moving = distance > ARRIVED_RAD or target_d.rate != 0.0 or target_c.rate != 0.0
    drive = Driven(u_A, u_B, moving)
    return drive, TrajectoryState(
        target_d=target_d,
        target_c=target_c,
        d=advance_axis(K, T, state.d, u_d),
        c=advance_axis(K, T, state.c, u_c),
        window_d=window_d,
        window_c=window_c,
        smooth_d=smooth_d,
        smooth_c=smooth_c,
        share=share,
        budget=budget,
        voltage_limit=voltage_limit,
        q=q,
        q_dot=q_dot,
        F_held_A=state.F_held_A,
        F_held_B=state.F_held_B,
    )


@compiled
def compute_voltages(
    d: Decoupler, model: TrajectoryModel, state: TrajectoryState, at: AxisState
) -> tuple[float, float]:
    """Return the voltages [V] of both motors for the windows and the added tension.

    The tension counts from ``begin_trajectory``. The axes move as with one motor; each real motor needs the voltage
    that its own constants require for the same motion: u − F r_m/K_t = (ω + (T + τ_e) dω/dt + T τ_e d²ω/dt²)/K, and a
    change of tension is compensated ahead of the lag τ_e.
    """
    K, T, tau_e = min(model.K_A, model.K_B), max(model.T_A, model.T_B), max(model.tau_e_A, model.tau_e_B)
    turning_d = (K * state.smooth_d.u - state.smooth_d.omega) / T
    turning_c = (K * state.smooth_c.u - state.smooth_c.omega) / T
    jerk_d = (K * (_mean(state.window_d) - state.smooth_d.u) / tau_e - turning_d) / T
    jerk_c = (K * (_mean(state.window_c) - state.smooth_c.u) / tau_e - turning_c) / T
    F_A, F_B = _predict_tensions(d, d.mechanism, model, at, state.q_dot)
    A, B = model.T_A * model.tau_e_A, model.T_B * model.tau_e_B
    u_A = at.omega_A + (model.T_A + model.tau_e_A) * (turning_c + turning_d) + A * (jerk_c + jerk_d)
    u_B = at.omega_B + (model.T_B + model.tau_e_B) * (turning_c - turning_d) + B * (jerk_c - jerk_d)
    return (
        u_A / model.K_A + d.r_m * (F_A - state.F_held_A) / model.K_t_A,
        u_B / model.K_B + d.r_m * (F_B - state.F_held_B) / model.K_t_B,
    )


@compiled
def _compute_usable_voltage(budget: float, state: TrajectoryState, target_d: AxisTarget, target_c: AxisTarget) -> float:
    """Return the voltage [V] for a move of this length, all of it for moving targets."""
    if target_d.rate != 0.0 or target_c.rate != 0.0:
        return budget
    share = (abs(target_d.theta - state.d.theta) + abs(target_c.theta - state.c.theta)) / SMALL_MOVE_RAD
    return min(max(budget * share * share, SMALL_MOVE_MIN_V), budget)


@compiled
def share_budget(
    K: float, T: float, usable: float, budget: float, state: TrajectoryState, target_d: AxisTarget, target_c: AxisTarget
) -> tuple[float, float]:
    """Return the difference axis's share and the voltage limit [V].

    With this share both axes arrive together. Each axis gets at least the voltage that stops it at its old or new
    target, whichever is farther, the common axis first: beyond its target springs become solid. The limit may therefore
    exceed ``usable``, or a ``budget`` [V] that has just been reduced, for a while.
    """
    voltage_max = max(budget, state.voltage_limit)
    needs_c = _compute_stopping_voltage(
        K=K, T=T, axis=state.c, before=state.target_c, target=target_c, U_max=voltage_max
    )
    needs_d = _compute_stopping_voltage(
        K=K, T=T, axis=state.d, before=state.target_d, target=target_d, U_max=voltage_max - needs_c
    )
    voltage_limit = max(usable, needs_c + needs_d)
    low, high = needs_d / voltage_limit, 1.0 - needs_c / voltage_limit
    far_d, far_c = target_d.theta - state.d.theta, target_c.theta - state.c.theta
    w_d, w_c = state.d.omega - target_d.rate, state.c.omega - target_c.rate
    free = max(K * voltage_limit - abs(target_d.rate) - abs(target_c.rate), 0.0)
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        if compute_duration(share * free, T, far_d, w_d) > compute_duration((1.0 - share) * free, T, far_c, w_c):
            low = share
        else:
            high = share
    return 0.5 * (low + high), voltage_limit


@compiled
def _compute_stopping_voltage(
    K: float, T: float, axis: AxisMotion, before: AxisTarget, target: AxisTarget, U_max: float
) -> float:
    """Return the least voltage [V] that stops an axis at its old or new target.

    Whichever is farther ahead counts.
    """
    w = axis.omega - target.rate
    s = 1.0 if w >= 0.0 else -1.0
    ahead = max(s * (before.theta - axis.theta), s * (target.theta - axis.theta))
    return least_voltage(K, T, s * w, ahead, U_max)


@compiled
def _combine_axes(d: Lagged, c: Lagged) -> tuple[AxisMotion, AxisMotion]:
    """Return motors A and B from the two axes."""
    return AxisMotion(c.theta + d.theta, c.omega + d.omega), AxisMotion(c.theta - d.theta, c.omega - d.omega)


@compiled
def _advance_joint(
    model: TrajectoryModel, q: float, q_dot: float, q_e: float, S: float, q_e_next: float, S_next: float
) -> tuple[float, float]:
    """Return the joint one tick later: J_j q'' = S (q_e − q) − B_j q'.

    Integrates with one Runge-Kutta step and interpolated q_e and S.
    """
    h, J, B = T_s, model.J_j, model.B_j
    q_e_half, S_half = 0.5 * (q_e + q_e_next), 0.5 * (S + S_next)
    v1, a1 = q_dot, (S * (q_e - q) - B * q_dot) / J
    q2, v2 = q + 0.5 * h * v1, q_dot + 0.5 * h * a1
    a2 = (S_half * (q_e_half - q2) - B * v2) / J
    q3, v3 = q + 0.5 * h * v2, q_dot + 0.5 * h * a2
    a3 = (S_half * (q_e_half - q3) - B * v3) / J
    q4, v4 = q + h * v3, q_dot + h * a3
    a4 = (S_next * (q_e_next - q4) - B * v4) / J
    return q + h / 6.0 * (v1 + 2.0 * (v2 + v3) + v4), q_dot + h / 6.0 * (a1 + 2.0 * (a2 + a3) + a4)


@compiled
def _joint_speed(d: Decoupler, axes: MotorAxes | None, omega_A: float, omega_B: float) -> float:
    """Return the joint speed [rad/s] at which the motors' speeds leave S unchanged."""
    if axes is None:
        return d.r_m / d.r_j * 0.5 * (omega_A - omega_B)
    return axes.v_A * omega_A + axes.v_B * omega_B


@compiled
def _compute_tensions(d: Decoupler, mechanism: Mechanism | None, q_e: float, S: float, q: float) -> tuple[float, float]:
    """Return the tensions [N] with the joint q_e − q [rad] off its equilibrium.

    Half of S (q_e − q)/r_j is added to one and subtracted from the other. For another mechanism the results are the
    loads of the motors [N·m].
    """
    if mechanism is not None:
        theta_A, theta_B = decoupler.motor_positions(d, q_e, S)
        _, load_A, load_B, _ = elastic_torques(mechanism, q, theta_A, theta_B)
        return load_A, load_B
    F, pull = decoupler.tension_under(d, S), 0.5 * S * (q_e - q) / d.r_j
    return F + pull, F - pull


@compiled
def _predict_tensions(
    d: Decoupler, mechanism: Mechanism | None, model: TrajectoryModel, at: AxisState, q_dot: float
) -> tuple[float, float]:
    """Return the tensions [N], or loads [N·m], ahead by each motor's lag τ_e."""
    if mechanism is not None:
        lag_A, lag_B = model.tau_e_A, model.tau_e_B
        _, load_A, _, _ = elastic_torques(
            mechanism, at.q + lag_A * q_dot, at.theta_A + lag_A * at.omega_A, at.theta_B + lag_A * at.omega_B
        )
        _, _, load_B, _ = elastic_torques(
            mechanism, at.q + lag_B * q_dot, at.theta_A + lag_B * at.omega_A, at.theta_B + lag_B * at.omega_B
        )
        return load_A, load_B
    F_A, F_B = _compute_tensions(d, mechanism, at.q_e, at.S, at.q)
    tendon = 0.5 * at.S / (d.r_j * d.r_j)
    F_A += model.tau_e_A * tendon * (d.r_m * at.omega_A - d.r_j * q_dot)
    F_B += model.tau_e_B * tendon * (d.r_m * at.omega_B + d.r_j * q_dot)
    return F_A, F_B


@compiled
def _fill_window(u: float) -> Window:
    return (u, u, u, u, u, u, u, u, u, u)


@compiled
def _shift_window(window: Window, u: float) -> Window:
    return (u, *window[:-1])


@compiled
def _mean(window: Window) -> float:
    total = 0.0
    for u in window:
        total += u
    return total / WINDOW_TICKS
