"""Autoregressive noise model: the polynomial D that whitens residuals, y = G u + e / D."""

import numpy as np

from backend.identification.record import Signal
from backend.identification.spectra import correlation

MAX_NOISE_ORDER = 12


def fit_autoregression(residuals: Signal, max_order: int = MAX_NOISE_ORDER) -> Signal:
    """Coefficients 1, d_1 .. d_p of D(z^-1), by the Yule-Walker equations; p <= max_order minimises BIC."""
    from scipy.linalg import solve_toeplitz

    count = residuals.size
    products = correlation(residuals, residuals)[: max_order + 1]
    best, lowest = np.array([1.0]), count * np.log(products[0])
    for order in range(1, max_order + 1):
        coefficients = solve_toeplitz(products[:order], -products[1 : order + 1])
        variance = products[0] + coefficients @ products[1 : order + 1]
        criterion = count * np.log(max(variance, np.finfo(float).tiny)) + order * np.log(count)
        if criterion < lowest:
            best, lowest = np.concatenate(([1.0], coefficients)), criterion
    return best
