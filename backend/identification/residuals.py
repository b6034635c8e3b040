"""Tests of residuals: whether they are white, and whether they are independent of the input.

Both look at the largest of many correlations, each in units of its own standard deviation, and ask at the 1 % level
for all of them together (Bonferroni) whether chance alone makes one that large.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from backend.identification.record import Signal
from backend.identification.result import CorrelationTest
from backend.identification.spectra import correlation

LEVEL = 0.01
_WHITENESS_LAGS = 25
_INPUT_LAGS = 50

Reals = NDArray[np.floating]


@dataclass(frozen=True)
class Judged:
    """A residual test in words and numbers.

    ``statistic`` is the largest of so many ``lags``' correlations in standard deviations, ``critical`` what it may be
    at the level for all of them together; ``bound`` the same for each correlation as it is drawn. ``passed`` where
    none leaves its bound.
    """

    lags: int
    statistic: float
    critical: float
    bound: tuple[float, ...]
    passed: bool

    @property
    def sentence(self) -> str:
        """Which test, its statistic, its level."""
        return (
            f"largest of {self.lags} correlations {self.statistic:.1f} standard deviations,"
            f" bound {self.critical:.1f} at the {100.0 * LEVEL:g} % level for all lags together"
        )


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


class KeptTest(Protocol):
    """A test as it was made, or as it is stored; older documents hold one lag's 99 % ``band`` instead of the bound."""

    @property
    def correlation(self) -> Sequence[float | None]:
        """Correlations, lag by lag."""

    @property
    def bound(self) -> Sequence[float | None] | None:
        """Their bounds."""

    @property
    def passed(self) -> bool:
        """Whether none leaves its bound."""


def judged(test: KeptTest) -> Judged:
    """Return what a stored test asked and found; older documents hold one lag's 99 % band instead."""
    correlation = np.array(test.correlation, dtype=float)
    critical = _critical(correlation.size)
    if test.bound is not None:
        bound = np.array(test.bound, dtype=float)
    else:
        bound = np.array(getattr(test, "band", None), dtype=float) * critical / _critical(1)
    return Judged(
        lags=correlation.size,
        statistic=float(np.max(np.abs(correlation) / bound)) * critical,
        critical=critical,
        bound=tuple(bound.tolist()),
        passed=test.passed,
    )


def _critical(lags: int) -> float:
    """Return standard deviations that the largest of so many correlations exceeds with the probability of the level."""
    from scipy.stats import norm

    return float(norm.ppf(1.0 - LEVEL / (2.0 * lags)))


def _tested(lags_s: Reals, correlations: Reals, deviation: Reals) -> CorrelationTest:
    bound = _critical(lags_s.size) * deviation
    return CorrelationTest(
        lags_s=tuple(lags_s.tolist()),
        correlation=tuple(correlations.tolist()),
        bound=tuple(bound.tolist()),
        passed=bool(np.all(np.abs(correlations) <= bound)),
    )
