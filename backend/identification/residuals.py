"""Tests of residuals: white? independent of the input? and information criteria."""

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from backend.identification.record import Signal
from backend.identification.result import CorrelationTest
from backend.identification.spectra import correlation

LEVEL = 0.01
_WHITENESS_LAGS = 25
_INPUT_LAGS = 50

Reals = NDArray[np.floating]


def whiteness(residuals: Signal, period_s: float) -> CorrelationTest:
    """Autocorrelation of the residuals, shape (n,), at 1 .. 25 samples."""
    lags = np.arange(1, _WHITENESS_LAGS + 1)
    products = correlation(residuals, residuals)
    deviation = np.full(lags.size, 1.0 / np.sqrt(residuals.size))
    return _tested(lags * period_s, products[lags] / max(products[0], np.finfo(float).tiny), deviation)


def input_correlation(residuals: Signal, u: Signal, period_s: float, slowest_s: float) -> CorrelationTest:
    """Correlation of the residuals with earlier inputs, up to five times ``slowest_s`` [s]; both shape (n,).

    The variance of each correlation is the sum over lags of r_e r_u, tapered: it allows for the colour of both.
    """
    u = u - np.mean(u)
    own, drive = correlation(residuals, residuals), correlation(u, u)
    reach = int(np.clip(5.0 * slowest_s / period_s, _INPUT_LAGS, residuals.size // 4))
    # Geometric: a fast pole left out shows at the first samples, a wrong lag after seconds.
    lags = np.unique(np.geomspace(1, reach, _INPUT_LAGS).astype(int))
    cross = correlation(residuals, u)[lags]
    both = own[:reach] * drive[:reach] * (1.0 - np.arange(reach) / reach) / residuals.size
    variance = max(float(both[0] + 2.0 * np.sum(both[1:])), np.finfo(float).tiny)
    size = np.sqrt(max(own[0] * drive[0], np.finfo(float).tiny))
    deviation = np.full(lags.size, np.sqrt(variance) / size)
    return _tested(lags * period_s, cross / size, deviation)


def _tested(lags_s: Reals, correlations: Reals, deviation: Reals) -> CorrelationTest:
    alone = norm.ppf(1.0 - LEVEL / 2.0)
    together = norm.ppf(1.0 - LEVEL / (2.0 * lags_s.size))
    return CorrelationTest(
        lags_s=tuple(lags_s.tolist()),
        correlation=tuple(correlations.tolist()),
        band=tuple((alone * deviation).tolist()),
        passed=bool(np.all(np.abs(correlations) <= together * deviation)),
    )
