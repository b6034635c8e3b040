"""Reduction to K/(T s + 1), for the λ formulas: same gain, same phase at low frequency."""

import numpy as np

from backend.identification.record import Signal
from backend.identification.result import FirstOrder, Model
from backend.identification.structures import structure


def reduce_to_first_order(model: Model, covariance: Signal) -> FirstOrder:
    """K is the static gain and T the sum of lags and dead time, with standard errors from ``covariance`` (p, p)."""
    shape, parameters = structure(model.structure), model.vector
    gradient = np.zeros(parameters.size)
    for i in range(1, parameters.size):
        step = 1e-6 * parameters[i]
        up, down = parameters.copy(), parameters.copy()
        up[i], down[i] = up[i] + step, down[i] - step
        gradient[i] = (shape.sum_of_lags(up) - shape.sum_of_lags(down)) / (2.0 * step)
    return FirstOrder(
        K=model.gain,
        T=model.sum_of_lags,
        K_std=_root(float(covariance[0, 0])),
        T_std=_root(float(gradient @ covariance @ gradient)),
    )


def _root(variance: float) -> float:
    """Return the square root; NaN, not measured, for a variance that rounding has made negative."""
    return float(np.sqrt(variance)) if variance >= 0.0 else float("nan")
