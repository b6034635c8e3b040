"""One axis of a plan: a motor T θ'' + θ' = K u within a budget of voltage, on its way to a goal in the least time."""

import math
from typing import NamedTuple

from plant.compiled import compiled
from plant.interface import T_s

LANDING_S = 0.010
"""Time constant with which an axis comes to rest at its target, where the braking curve has no finite slope."""

BRAKING = 0.98
"""Share of the budget that braking counts on: what is left keeps an axis on its curve."""

HALVINGS = 24
"""Steps of a bisection."""

LEAST_V = 1e-3
"""An axis that has nothing left of the budget [V] is planned with this."""


class Axis(NamedTuple):
    """Angle [rad] and speed [rad/s] of one axis of the model."""

    theta: float
    omega: float


class Lagged(NamedTuple):
    """Angle [rad] and speed [rad/s] of an axis, and the voltage [V] behind the motors' electrical lag."""

    theta: float
    omega: float
    u: float


class Goal(NamedTuple):
    """Where an axis is sent [rad], how fast that moves [rad/s], 0 where it has jumped, and where it will stand [rad].

    ``end`` nan: nobody has announced one. ``moved`` [rad]: since the tick before.
    """

    theta: float
    rate: float
    end: float = math.nan
    moved: float = 0.0


@compiled
def braking_distance(V: float, T: float, omega: float) -> float:
    """How far [rad] an axis goes while −V/K volts stop it from ``omega`` ≥ 0 [rad/s]: T ω − V T ln(1 + ω/V)."""
    return T * omega - V * T * math.log1p(omega / V)


@compiled
def braking_speed(V: float, T: float, distance: float) -> float:
    """Speed [rad/s] from which −V/K volts stop an axis within ``distance`` ≥ 0 [rad]: ``braking_distance`` inverted."""
    E = max(distance, 0.0) / (V * T)
    y = math.sqrt(2.0 * E) + E / 1.5
    for _ in range(3):  # of y − ln(1 + y) = E; the start is right for small E, Newton's steps for any
        y -= (y - math.log1p(y) - E) * (1.0 + y) / max(y, 1e-12)
    return V * y


@compiled
def least_voltage(K: float, T: float, omega: float, distance: float, most: float) -> float:
    """Least voltage [V], ``most`` where that is not enough, that stops an axis within ``distance`` [rad] ahead of it.

    ``omega`` [rad/s] is the speed in that direction: nothing is needed by an axis that stands or goes the other way.
    """
    if omega <= 0.0:
        return 0.0
    low, high = 0.0, most
    for _ in range(HALVINGS):
        U = 0.5 * (low + high)
        if braking_distance(BRAKING * K * U, T, omega) > distance:
            low = U
        else:
            high = U
    return high


@compiled
def duration(V: float, T: float, distance: float, omega: float) -> float:
    """Least time [s] from speed ``omega`` [rad/s] to rest ``distance`` [rad] away, with at most V/K volts.

    Full voltage one way, then the other (T θ'' + θ' = K u, |K u| ≤ V).
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
def toward(K: float, T: float, U: float, axis: Axis, goal: Goal) -> float:
    """Voltage [V] of this tick, within ±U: up to the speed from which the axis still stops at its goal.

    With a goal that moves that is as fast as the goal, and no faster than what still stops at the goal's end.
    """
    U = max(U, LEAST_V)
    u = _toward(K, T, U, axis, goal)
    if goal.rate == 0.0 or math.isnan(goal.end):
        return u
    to_end = _toward(K, T, U, axis, Goal(goal.end, 0.0, math.nan, 0.0))
    return min(u, to_end) if goal.rate > 0.0 else max(u, to_end)


@compiled
def _toward(K: float, T: float, U: float, axis: Axis, goal: Goal) -> float:
    """Voltage [V] of this tick, within ±U, with which the axis comes to its goal no faster than that moves."""
    e, w = goal.theta - axis.theta, axis.omega - goal.rate
    e -= T_s * w  # as it will be when this voltage has acted
    s = 1.0 if e >= 0.0 else -1.0
    V = max(K * BRAKING * U + s * goal.rate, 0.05 * K * U)
    a = V / T
    landing = a * LANDING_S**2
    wanted = abs(e) / LANDING_S if abs(e) <= landing else braking_speed(V, T, abs(e) - 0.5 * landing)
    g = math.exp(-T_s / T)
    u = (goal.rate + s * wanted - g * axis.omega) / (K * (1.0 - g))
    return min(max(u, -U), U)


@compiled
def turned(K: float, T: float, axis: Axis, u: float) -> Axis:
    """Axis one tick later under u [V], exactly: T θ'' + θ' = K u."""
    g = math.exp(-T_s / T)
    over = axis.omega - K * u
    return Axis(axis.theta + K * u * T_s + over * T * (1.0 - g), K * u + over * g)


@compiled
def turned_lagged(K: float, T: float, tau_e: float, axis: Lagged, u: float) -> Lagged:
    """Axis one tick later under u [V], exactly: T θ'' + θ' = K v, τ_e v' + v = u."""
    if abs(T - tau_e) < 1e-7 * T:
        tau_e *= 1.0 + 1e-7  # the solution below is for two different lags
    g, h = math.exp(-T_s / T), math.exp(-T_s / tau_e)
    left = K * (axis.u - u) * tau_e / (tau_e - T)
    over = axis.omega - K * u - left
    return Lagged(
        axis.theta + K * u * T_s + left * tau_e * (1.0 - h) + over * T * (1.0 - g),
        K * u + left * h + over * g,
        u + (axis.u - u) * h,
    )
