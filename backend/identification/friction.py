"""Dry friction in a record from force, current or voltage to speed or position.

    T w' + w = K (u - u_0 - u_c sign w),   at rest while |u - u_0| <= u_c;      y = w, or y = the integral of w

A linear model of such a record takes the friction for damping: gain and lag come out too small, by half where the
friction takes a third of the input, with standard errors that know nothing of it and, in a little noise, with residuals
that show nothing of it. So this model is tried on every record of something that moves both ways. Between samples u is
held, and the speed is exact, zero crossings included. Where the linear model has a dead time, so has this one.
"""

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np

from backend.identification.errors import NotConvergedError
from backend.identification.record import Record, Signal
from backend.identification.residuals import whiteness
from backend.identification.result import DryFriction
from backend.identification.uncertainty import sandwich
from plant.compiled import kept

SIGNIFICANT_STD = 4.0
MOST_EXPLAINED = 0.8
_MOVING_SHARE = 0.1
_RESTING_PART = 0.02
_LAGS = 12
_MAX_STEPS = 60
_STEP = 1e-6
_FRICTIONS = (0.05, 0.2, 0.4, 0.7, 1.0)
"""Frictions to start from, in root mean squares of the input."""


@dataclass(frozen=True)
class FrictionFit:
    """Parameters K, T, u_c, t_d, the covariance of the first three, and what the model leaves over, shape (n,)."""

    parameters: Signal
    covariance: Signal
    residuals: Signal


def both_ways(speed: Signal) -> bool:
    """Whether a speed, shape (n,), goes both ways for long enough to tell friction from an offset of the input."""
    size = _RESTING_PART * float(np.max(np.abs(speed)))
    return min(float(np.mean(speed > size)), float(np.mean(speed < -size))) > _MOVING_SHARE


def dry_friction(record: Record, linear_error: Signal, dead_time_s: float) -> DryFriction | None:
    """Dry friction in a record of a speed; None where the record could not show any.

    ``linear_error``, shape (n,), is what the linear model's simulation leaves over, ``dead_time_s`` what that model
    has, 0 where its structure has none.
    """
    if not both_ways(record.y):
        return None
    try:
        fitted = fit_friction(record, dead_time_s)
    except (NotConvergedError, np.linalg.LinAlgError):
        return None
    u_c, std = float(fitted.parameters[2]), np.sqrt(np.abs(np.diag(fitted.covariance)))
    left = float(np.linalg.norm(fitted.residuals) / np.linalg.norm(linear_error))
    # Other dynamics may look like friction: it is friction where nothing is left beside it, or most of the rest goes.
    explains = left < MOST_EXPLAINED or (left < 1.0 and whiteness(fitted.residuals, record.period_s).passed)
    told = u_c > SIGNIFICANT_STD * std[2]
    if told and not explains:
        return None
    fit = 100.0 * (1.0 - np.linalg.norm(fitted.residuals) / np.linalg.norm(record.y - np.mean(record.y)))
    K, T, _, t_d = (float(value) for value in fitted.parameters)
    return DryFriction(bool(told), K, T, u_c, float(std[0]), float(std[1]), float(std[2]), float(fit), t_d)


def fit_friction(record: Record, dead_time_s: float) -> FrictionFit:
    """Least squares on the simulation of a speed. Raises NotConvergedError.

    A dead time to start from is fitted as well, from shorter ones too: a linear model takes friction for dead time.
    """
    from scipy.optimize import least_squares

    scale_u, scale_y = float(np.sqrt(np.mean(record.u**2))), float(np.sqrt(np.mean(record.y**2)))
    u, y, period_s = record.u / scale_u, record.y / scale_y, record.period_s

    def residuals(z: Signal) -> Signal:
        late = period_s * z[5] if z.size > 5 else 0.0
        return np.asarray(y - moving(u, period_s, z[0], positive_lag(float(z[1]), period_s), z[2], z[3], z[4], late)[0])

    start = _start(u, y, period_s, dead_time_s)
    try:
        found = least_squares(residuals, start, jac=differences(residuals), x_scale=0.1, max_nfev=_MAX_STEPS)
    except ValueError:  # a simulation that leaves the range of numbers
        raise NotConvergedError("no motor with dry friction describes the record") from None
    if not np.all(np.isfinite(found.x)):
        raise NotConvergedError("no motor with dry friction describes the record")
    sensitivities = -np.asarray(found.jac, dtype=np.float64)
    moves = np.linalg.norm(sensitivities, axis=0) > 0.0  # rest, or an offset, may be without effect
    if not np.all(moves[:3]):
        raise NotConvergedError("the record does not tell gain, lag and dry friction apart")
    covariance = sandwich(sensitivities[:, moves], sensitivities[:, moves], found.fun)[:3, :3]
    T = float(np.exp(found.x[1]))
    unit = np.array([scale_y / scale_u, T, scale_u])
    t_d = period_s * float(found.x[5]) if found.x.size > 5 else 0.0
    parameters = np.array([found.x[0] * unit[0], T, found.x[2] * unit[2], t_d])
    return FrictionFit(parameters, covariance * np.outer(unit, unit), np.asarray(found.fun * scale_y))


def positive_lag(logarithm: float, period_s: float) -> float:
    """Lag [s] of this logarithm, within what can be simulated: a search may leave the range of numbers."""
    return float(period_s * np.exp(np.clip(logarithm - np.log(period_s), -20.0, 40.0)))


def differences(residuals: Callable[[Signal], Signal]) -> Callable[[Signal], Signal]:
    """Differentiate residuals by central differences of one absolute step: parameters of size 1 may well be zero."""

    def jacobian(z: Signal) -> Signal:
        moves = _STEP * np.eye(z.size)
        return np.column_stack([(residuals(z + move) - residuals(z - move)) / (2.0 * _STEP) for move in moves])

    return jacobian


def _start(u: Signal, y: Signal, period_s: float, dead_time_s: float) -> Signal:
    """K, ln T, u_c, u_0, first speed and dead time, where there is one, in samples, over a grid; K is fitted."""
    best, lowest = np.zeros(5), np.inf
    lags = np.geomspace(3.0 * period_s, u.size * period_s / 5.0, _LAGS)
    dead_times = (0.0, 0.5 * dead_time_s, dead_time_s) if dead_time_s else (0.0,)
    for T, u_c, t_d in itertools.product(lags.tolist(), _FRICTIONS, dead_times):
        speed = moving(u, period_s, 1.0, T, u_c, 0.0, 0.0, t_d)[0]
        size = float(speed @ speed)
        K = float(speed @ y) / size if size > 0.0 else 0.0
        error = float(np.linalg.norm(y - K * speed))
        if error < lowest:
            best, lowest = np.array([K, np.log(T), u_c, 0.0, y[0], t_d / period_s]), error
    return best if dead_time_s else best[:5]


@kept
@numba.njit()
def moving(
    u: Signal, period_s: float, K: float, T: float, u_c: float, u_0: float, initial: float, dead_time_s: float = 0.0
) -> Signal:
    """Speed and turn since the first sample, shape (2, n); exact for an input that is held between samples.

    A dead time need not be whole samples. The input before and after the record counts as its first and last value.
    """
    w, turned = initial, 0.0
    motion = np.empty((2, u.size))
    whole = int(np.floor(dead_time_s / period_s))
    part = dead_time_s - whole * period_s
    for k in range(u.size):
        motion[0, k], motion[1, k] = w, turned
        for late, left in ((1, part), (0, period_s - part)):
            drive = u[min(max(k - whole - late, 0), u.size - 1)] - u_0
            while left > 0.0:
                sign = np.sign(w) if w != 0.0 else np.sign(K * drive)
                if w == 0.0 and abs(drive) <= u_c:
                    break
                # Friction opposes the motion, whatever the sign of K.
                final = K * drive - abs(K) * u_c * sign
                reached = final + (w - final) * np.exp(-left / T)
                if w != 0.0 and reached * w < 0.0:
                    until = T * np.log((w - final) / -final)
                    turned += final * until + w * T  # the lag's part is T (w - 0)
                    left -= until
                    w = 0.0
                else:
                    turned += final * left + (w - reached) * T
                    w = reached
                    left = 0.0
    return motion
