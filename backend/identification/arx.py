"""ARX, the paper's method: least squares on the equation error of a sampled model, after a low-pass on both signals.

Kept for comparison. At 1 ms the equation error weighs what happens from one sample to the next, a hundred times
faster than the dynamics, so without the low-pass it returns the sensor's noise; with it some bias remains
(method section 4).
"""

import numpy as np

from backend.identification.errors import NotContinuousError
from backend.identification.linearisation import Problem, least_squares, triangle
from backend.identification.record import Signal
from backend.identification.response import Poles
from backend.identification.start import dominant_lag
from backend.identification.uncertainty import sandwich

_SHARE = 1e-2
_FASTER = 3.0
_SETTLED_LAGS = 12.0


def fit_arx(problem: Problem, low_pass: bool = True) -> tuple[Signal, Signal]:
    """Parameters, shape (p,), and their covariance, shape (p, p). Raises NotContinuousError.

    A(z) y = B(z) u + offset with both of the structure's order, by QR, on signals that passed two lags of the
    record's dominant time constant divided by three. The zeros of B, which the structures do not have, are dropped.
    Without ``low_pass`` it is the plain method, for comparison.
    """
    record, order = problem.record, problem.structure.order
    u, y = record.u, record.y
    if low_pass:
        filter_samples = dominant_lag(problem) / (_FASTER * record.period_s)
        settled = min(u.size // 4, int(_SETTLED_LAGS * filter_samples))
        decay = float(np.exp(-1.0 / filter_samples))
        u, y = (_low_pass(decay, _low_pass(decay, signal))[settled:] for signal in (u, y))
    count = u.size - order
    past = [signal[order - lag : order - lag + count] for signal in (-y, u) for lag in range(1, order + 1)]
    columns = np.column_stack((*past, np.ones(count), y[order:]))
    factor = triangle(columns)
    coefficients = least_squares(factor[:-1, :-1], factor[:-1, -1])
    parameters = _continuous(problem, coefficients)
    regressors = columns[:, :-1]
    residuals = columns[:, -1] - regressors @ coefficients
    spread = _root(sandwich(regressors, regressors, residuals))
    moves = [(_continuous(problem, coefficients + _SHARE * move) - parameters) / _SHARE for move in spread.T]
    return parameters, np.asarray(np.transpose(moves) @ np.array(moves))


def continuous_poles(sampled: Poles, period_s: float) -> Poles:
    """Poles [rad/s] of the continuous system with these poles in z. Raises NotContinuousError.

    A real pole at or below zero has no continuous counterpart of the same order, one outside the unit circle no
    stable one.
    """
    real = np.abs(sampled.imag) <= 1e-9 * np.abs(sampled)
    if np.any(real & (sampled.real <= 0.0)) or np.any(np.abs(sampled) >= 1.0):
        shown = np.array2string(sampled, precision=4)
        raise NotContinuousError(
            f"the ARX poles z = {shown} belong to no stable continuous system: filter more, or choose another estimator"
        )
    return np.asarray(np.log(sampled) / period_s)


def _low_pass(decay: float, signal: Signal) -> Signal:
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0 - decay], [1.0, -decay], signal))


def _continuous(problem: Problem, coefficients: Signal) -> Signal:
    order = problem.structure.order
    a, b = np.concatenate(([1.0], coefficients[:order])), coefficients[order : 2 * order]
    poles = continuous_poles(np.roots(a).astype(np.complex128), problem.record.period_s)
    descending = np.real(np.poly(poles))
    gain = float(np.sum(b) / np.sum(a))
    return problem.structure.from_denominator(gain, np.asarray(descending[::-1] / descending[-1]))


def _root(covariance: Signal) -> Signal:
    """Columns that each move the coefficients by a standard deviation, in independent directions."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))
