"""Dry friction in a record from force, current or voltage to speed or position.

    T w' + w = K (u - u_0 - u_c sign w),   at rest while |u - u_0| <= u_c;      y = w, or y = the integral of w

A linear model of such a record takes the friction for damping: gain and lag come out too small, by half where the
friction takes a third of the input, with standard errors that know nothing of it and, in a little noise, with residuals
that show nothing of it. So this model is tried on every record of something that moves both ways. Between samples u is
held, and the speed is exact, zero crossings included.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numba
import numpy as np
from scipy.optimize import least_squares

from backend.identification.errors import NotConvergedError
from backend.identification.record import Record, Signal
from backend.identification.residuals import whiteness
from backend.identification.result import DryFriction
from backend.identification.uncertainty import sandwich

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
    """Parameters K, T, u_c, their covariance, shape (3, 3), and what the model leaves over, shape (n,)."""

    parameters: Signal
    covariance: Signal
    residuals: Signal


def both_ways(speed: Signal) -> bool:
    """Whether a speed, shape (n,), goes both ways for long enough to tell friction from an offset of the input."""
    size = _RESTING_PART * float(np.max(np.abs(speed)))
    return min(float(np.mean(speed > size)), float(np.mean(speed < -size))) > _MOVING_SHARE


def dry_friction(record: Record, linear_error: Signal) -> DryFriction | None:
    """Dry friction in a record of a speed; None where the record could not show any.

    ``linear_error``, shape (n,), is what the linear model's simulation leaves over.
    """
    if not both_ways(record.y):
        return None
    try:
        fitted = fit_friction(record)
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
    K, T, _ = (float(value) for value in fitted.parameters)
    return DryFriction(bool(told), K, T, u_c, float(std[0]), float(std[1]), float(std[2]), float(fit))


def fit_friction(record: Record) -> FrictionFit:
    """Least squares on the simulation of a speed. Raises NotConvergedError."""
    scale_u, scale_y = float(np.sqrt(np.mean(record.u**2))), float(np.sqrt(np.mean(record.y**2)))
    u, y, period_s = record.u / scale_u, record.y / scale_y, record.period_s

    def residuals(z: Signal) -> Signal:
        return np.asarray(y - moving(u, period_s, z[0], float(np.exp(z[1])), z[2], z[3], z[4])[0])

    found = least_squares(
        residuals, _start(u, y, period_s), jac=differences(residuals), x_scale=0.1, max_nfev=_MAX_STEPS
    )
    if not np.all(np.isfinite(found.x)):
        raise NotConvergedError("no motor with dry friction describes the record")
    sensitivities = -np.asarray(found.jac, dtype=np.float64)
    moves = np.linalg.norm(sensitivities, axis=0) > 0.0  # rest, or an offset, may be without effect
    if not np.all(moves[:3]):
        raise NotConvergedError("the record does not tell gain, lag and dry friction apart")
    covariance = sandwich(sensitivities[:, moves], sensitivities[:, moves], found.fun)[:3, :3]
    T = float(np.exp(found.x[1]))
    unit = np.array([scale_y / scale_u, T, scale_u])
    parameters = np.array([found.x[0] * unit[0], T, found.x[2] * unit[2]])
    return FrictionFit(parameters, covariance * np.outer(unit, unit), np.asarray(found.fun * scale_y))


def differences(residuals: Callable[[Signal], Signal]) -> Callable[[Signal], Signal]:
    """Differentiate residuals by central differences of one absolute step: parameters of size 1 may well be zero."""

    def jacobian(z: Signal) -> Signal:
        moves = _STEP * np.eye(z.size)
        return np.column_stack([(residuals(z + move) - residuals(z - move)) / (2.0 * _STEP) for move in moves])

    return jacobian


def _start(u: Signal, y: Signal, period_s: float) -> Signal:
    """K, ln T, u_c, u_0 and first speed over a grid of lags and frictions; w grows with K, which is fitted."""
    best, lowest = np.zeros(5), np.inf
    for T in np.geomspace(3.0 * period_s, u.size * period_s / 5.0, _LAGS):
        for u_c in _FRICTIONS:
            speed = moving(u, period_s, 1.0, float(T), u_c, 0.0, 0.0)[0]
            size = float(speed @ speed)
            K = float(speed @ y) / size if size > 0.0 else 0.0
            error = float(np.linalg.norm(y - K * speed))
            if error < lowest:
                best, lowest = np.array([K, np.log(T), u_c, 0.0, y[0]]), error
    return best


@numba.njit(cache=True)
def moving(u: Signal, period_s: float, K: float, T: float, u_c: float, u_0: float, initial: float) -> Signal:
    """Speed and turn since the first sample, shape (2, n); exact for an input that is held between samples."""
    w, turned = initial, 0.0
    motion = np.empty((2, u.size))
    for k in range(u.size):
        motion[0, k], motion[1, k] = w, turned
        left = period_s
        drive = u[k] - u_0
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
