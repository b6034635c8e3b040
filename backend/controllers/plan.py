"""Where motors and joint are to be in each tick: as fast as a budget of voltage allows, for the loops to hold on to.

Two axes move an exact model of the motors: the difference of the motor angles, which turns the joint, and their common
part, which makes it stiff. Each brakes along the curve from which full reverse voltage just stops it at the target, so
that a step takes the shortest time there is, and whatever moves in each tick is followed as long as the budget lasts.
The voltages that the model needed go straight to the motors (model following: the paper's loops act on the rest).
"""

import math
from typing import NamedTuple

from backend.controllers import decoupler
from backend.controllers.axis import (
    HALVINGS,
    Axis,
    Goal,
    Lagged,
    duration,
    least_voltage,
    toward,
    turned,
    turned_lagged,
)
from backend.controllers.decoupler import Decoupler
from backend.controllers.goals import References, goals, jumps, soonest_stand
from plant.compiled import compiled
from plant.interface import T_s

SMOOTHED = 10
"""Ticks over which the voltages are averaged: the end point and the bound stay, a full reversal takes 10 ms."""

NEAR = 0.05
"""An axis so near its target [rad] leaves the voltage that it does not use to the other one."""

STANDING = 1e-3
"""An axis so near its target [rad] has arrived."""

GENTLE = 0.2
"""A move of both axes together [rad] from which on the whole budget is used, 0.02 rad of the joint; of a smaller one
the share (move/GENTLE)²: one count of the joint's encoder is no reason for a kick of 8 V."""

GENTLE_LEAST_V = 0.05
"""The smallest move is made with this [V]."""

STANDS = 0.05
"""A model whose axes are so slow [rad/s], and driven no faster, stands."""


class Model(NamedTuple):
    """What the plan knows of the actuator.

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
"""Voltages of the last SMOOTHED ticks [V], the newest first."""


class State(NamedTuple):
    """The model and its way.

    ``d``, ``c``: difference and common axis before smoothing; ``smooth_d``, ``smooth_c`` behind it and behind the
    electrical lag, where the motors of the model are. ``share`` of the budget is the difference axis's; ``asked`` [V]
    of it is what the tuning has, ``allowed`` [V] what is in use: more where axes that move could not be stopped in time
    with less. ``q`` [rad], ``q_dot`` [rad/s]: joint of the model. ``F_held`` [N]: tension that the motor loops'
    integrators carry already.
    """

    goal_d: Goal
    goal_c: Goal
    d: Axis
    c: Axis
    window_d: Window
    window_c: Window
    smooth_d: Lagged
    smooth_c: Lagged
    share: float
    asked: float
    allowed: float
    q: float
    q_dot: float
    F_held_A: float
    F_held_B: float


class Now(NamedTuple):
    """The model now: motor angles [rad], their speeds [rad/s], joint and its equilibrium [rad], stiffness [N·m/rad]."""

    theta_A: float
    theta_B: float
    omega_A: float
    omega_B: float
    q: float
    q_e: float
    S: float


class Driven(NamedTuple):
    """Voltages [V] that move the model in a tick, and whether it is still on its way."""

    u_A: float
    u_B: float
    moving: bool


@compiled
def begin(d: Decoupler, model: Model, q: float, S: float, omega_A: float, omega_B: float) -> State:
    """Return a model at ``q`` [rad] and ``S`` [N·m/rad] whose motors move at ``omega`` [rad/s], sent nowhere else.

    Its motors are where they hold its joint, moving or at rest. What the actuator's motors are off from there, because
    of a push or of springs that are not as identified, is left to the loops: so nothing has to move.
    """
    q_dot = d.r_m / d.r_j * 0.5 * (omega_A - omega_B)
    q_e = q + model.B_j * q_dot / S
    theta_A, theta_B = decoupler.motor_positions(d, q_e, S)
    difference = Axis(0.5 * (theta_A - theta_B), 0.5 * (omega_A - omega_B))
    common = Axis(0.5 * (theta_A + theta_B), 0.5 * (omega_A + omega_B))
    F_A, F_B = _tensions(d, q_e, S, q)
    K = min(model.K_A, model.K_B)
    return State(
        Goal(difference.theta, 0.0, math.nan, 0.0),
        Goal(common.theta, 0.0, math.nan, 0.0),
        difference,
        common,
        _filled(difference.omega / K),
        _filled(common.omega / K),
        Lagged(difference.theta, difference.omega, difference.omega / K),
        Lagged(common.theta, common.omega, common.omega / K),
        0.5,
        -1.0,
        (abs(difference.omega) + abs(common.omega)) / K,
        q,
        q_dot,
        F_A,
        F_B,
    )


@compiled
def now(d: Decoupler, state: State) -> Now:
    """Return where the model is."""
    A, B = _motors(state.smooth_d, state.smooth_c)
    q_e, S = decoupler.equilibrium(d, A.theta, B.theta), decoupler.stiffness(d, A.theta, B.theta)
    return Now(A.theta, B.theta, A.omega, B.omega, state.q, q_e, S)


@compiled
def stands(model: Model, state: State) -> bool:
    """Whether the model moves no more, or not yet."""
    K = min(model.K_A, model.K_B)
    speed = max(abs(state.smooth_d.omega), abs(state.smooth_c.omega))
    driven = max(abs(_mean(state.window_d)), abs(_mean(state.window_c)), abs(state.smooth_d.u), abs(state.smooth_c.u))
    return max(speed, K * driven) < STANDS


@compiled
def step(d: Decoupler, model: Model, budget: float, state: State, at: Now, r: References) -> tuple[Driven, State]:
    """One tick towards the references from ``at``, within ``budget`` [V] for both axes together; 0 V: to a stand."""
    K, T = min(model.K_A, model.K_B), max(model.T_A, model.T_B)
    if budget > 0.0:
        goal_d, goal_c = goals(d, state.goal_d, state.goal_c, r, K * budget)
    else:
        goal_d, goal_c = state.goal_d, state.goal_c
    share, allowed = state.share, state.allowed
    distance = abs(goal_d.theta - state.smooth_d.theta) + abs(goal_c.theta - state.smooth_c.theta)
    if budget == 0.0:
        if state.asked != 0.0:
            goal_d, goal_c, share = soonest_stand(K, T, allowed, state.d, state.c, goal_d, goal_c)
    elif budget != state.asked or jumps(state.goal_d, goal_d) or jumps(state.goal_c, goal_c):
        share, allowed = shared(K, T, _usable(budget, state, goal_d, goal_c), budget, state, goal_d, goal_c)
    elif distance < STANDING:
        allowed = min(allowed, budget)
    held_d, held_c = abs(goal_d.rate) / K, abs(goal_c.rate) / K
    free = max(allowed - held_d - held_c, 0.0)
    most_d = held_d + share * free
    if abs(goal_c.theta - state.c.theta) < NEAR:  # what the common axis has no use for now
        most_d = max(most_d, allowed - abs(state.window_c[0]))
    most_d = min(most_d, allowed)
    u_d = toward(K, T, most_d, state.d, goal_d)
    u_c = toward(K, T, allowed - abs(u_d), state.c, goal_c)
    window_d, window_c = _pushed(state.window_d, u_d), _pushed(state.window_c, u_c)
    mean_d, mean_c = _mean(window_d), _mean(window_c)
    tau_e = max(model.tau_e_A, model.tau_e_B)
    smooth_d = turned_lagged(K, T, tau_e, state.smooth_d, mean_d)
    smooth_c = turned_lagged(K, T, tau_e, state.smooth_c, mean_c)

    A, B = _motors(smooth_d, smooth_c)
    q_e, S = decoupler.equilibrium(d, A.theta, B.theta), decoupler.stiffness(d, A.theta, B.theta)
    q, q_dot = _swung(model, state.q, state.q_dot, at.q_e, at.S, q_e, S)

    forward = State(
        goal_d, goal_c, state.d, state.c, window_d, window_c, state.smooth_d, state.smooth_c, share, budget, allowed,
        state.q, state.q_dot, state.F_held_A, state.F_held_B,
    )  # fmt: skip
    u_A, u_B = voltages(d, model, forward, at)
    moving = distance > STANDING or goal_d.rate != 0.0 or goal_c.rate != 0.0
    driven = Driven(u_A, u_B, moving)
    return driven, State(
        goal_d,
        goal_c,
        turned(K, T, state.d, u_d),
        turned(K, T, state.c, u_c),
        window_d,
        window_c,
        smooth_d,
        smooth_c,
        share,
        budget,
        allowed,
        q,
        q_dot,
        state.F_held_A,
        state.F_held_B,
    )


@compiled
def voltages(d: Decoupler, model: Model, state: State, at: Now) -> tuple[float, float]:
    """Voltages [V] of the two motors for what the axes' windows say, and for the tension that has come since ``begin``.

    The axes are driven as by one motor; each of the two needs what its own constants ask for at the same motion:
    u − F r_m/K_t = (ω + (T + τ_e) dω/dt + T τ_e d²ω/dt²)/K, and a change of tension is answered ahead of the lag τ_e.
    """
    K, T, tau_e = min(model.K_A, model.K_B), max(model.T_A, model.T_B), max(model.tau_e_A, model.tau_e_B)
    turning_d = (K * state.smooth_d.u - state.smooth_d.omega) / T
    turning_c = (K * state.smooth_c.u - state.smooth_c.omega) / T
    jerk_d = (K * (_mean(state.window_d) - state.smooth_d.u) / tau_e - turning_d) / T
    jerk_c = (K * (_mean(state.window_c) - state.smooth_c.u) / tau_e - turning_c) / T
    F_A, F_B = _tensions(d, at.q_e, at.S, at.q)
    tendon = 0.5 * at.S / (d.r_j * d.r_j)
    F_A += model.tau_e_A * tendon * (d.r_m * at.omega_A - d.r_j * state.q_dot)
    F_B += model.tau_e_B * tendon * (d.r_m * at.omega_B + d.r_j * state.q_dot)
    A, B = model.T_A * model.tau_e_A, model.T_B * model.tau_e_B
    u_A = at.omega_A + (model.T_A + model.tau_e_A) * (turning_c + turning_d) + A * (jerk_c + jerk_d)
    u_B = at.omega_B + (model.T_B + model.tau_e_B) * (turning_c - turning_d) + B * (jerk_c - jerk_d)
    return (
        u_A / model.K_A + d.r_m * (F_A - state.F_held_A) / model.K_t_A,
        u_B / model.K_B + d.r_m * (F_B - state.F_held_B) / model.K_t_B,
    )


@compiled
def _usable(budget: float, state: State, goal_d: Goal, goal_c: Goal) -> float:
    """Voltage [V] of the budget that a move of this length is made with; all of it for goals that move."""
    if goal_d.rate != 0.0 or goal_c.rate != 0.0:
        return budget
    share = (abs(goal_d.theta - state.d.theta) + abs(goal_c.theta - state.c.theta)) / GENTLE
    return min(max(budget * share * share, GENTLE_LEAST_V), budget)


@compiled
def shared(
    K: float, T: float, usable: float, budget: float, state: State, goal_d: Goal, goal_c: Goal
) -> tuple[float, float]:
    """Share of the budget for the difference axis with which both axes arrive together, and what is allowed [V].

    Each keeps what it takes to stop where it was or is sent, whichever is farther, the common axis first: beyond lie
    solid springs. So more than is ``usable`` of the ``budget`` [V], or than a budget that has just become less, may be
    allowed for a while.
    """
    most = max(budget, state.allowed)
    needs_c = _needed(K, T, state.c, state.goal_c, goal_c, most)
    needs_d = _needed(K, T, state.d, state.goal_d, goal_d, most - needs_c)
    allowed = max(usable, needs_c + needs_d)
    low, high = needs_d / allowed, 1.0 - needs_c / allowed
    far_d, far_c = goal_d.theta - state.d.theta, goal_c.theta - state.c.theta
    w_d, w_c = state.d.omega - goal_d.rate, state.c.omega - goal_c.rate
    free = max(K * allowed - abs(goal_d.rate) - abs(goal_c.rate), 0.0)
    for _ in range(HALVINGS):
        share = 0.5 * (low + high)
        if duration(share * free, T, far_d, w_d) > duration((1.0 - share) * free, T, far_c, w_c):
            low = share
        else:
            high = share
    return 0.5 * (low + high), allowed


@compiled
def _needed(K: float, T: float, axis: Axis, before: Goal, goal: Goal, most: float) -> float:
    """Least voltage [V] that still stops an axis where it was or is sent, whichever is farther on its way."""
    w = axis.omega - goal.rate
    s = 1.0 if w >= 0.0 else -1.0
    ahead = max(s * (before.theta - axis.theta), s * (goal.theta - axis.theta))
    return least_voltage(K, T, s * w, ahead, most)


@compiled
def _motors(d: Lagged, c: Lagged) -> tuple[Axis, Axis]:
    """Motors A and B of the two axes."""
    return Axis(c.theta + d.theta, c.omega + d.omega), Axis(c.theta - d.theta, c.omega - d.omega)


@compiled
def _swung(
    model: Model, q: float, q_dot: float, q_e: float, S: float, q_e_next: float, S_next: float
) -> tuple[float, float]:
    """Joint one tick later: J_j q'' = S (q_e − q) − B_j q', a Runge-Kutta step with q_e and S in between."""
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
def _tensions(d: Decoupler, q_e: float, S: float, q: float) -> tuple[float, float]:
    """Tensions [N] with the joint q_e − q [rad] off rest: half of S (q_e − q)/r_j on top of one, off the other."""
    F, pull = decoupler.tension_under(d, S), 0.5 * S * (q_e - q) / d.r_j
    return F + pull, F - pull


@compiled
def _filled(u: float) -> Window:
    return (u, u, u, u, u, u, u, u, u, u)


@compiled
def _pushed(window: Window, u: float) -> Window:
    return (u, *window[:-1])


@compiled
def _mean(window: Window) -> float:
    total = 0.0
    for u in window:
        total += u
    return total / SMOOTHED
