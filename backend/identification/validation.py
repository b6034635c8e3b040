"""What a model must show before it is used for tuning: tests on residuals, fit on unseen data, a verdict."""

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft
from scipy.stats import norm

from backend.identification.record import Signal
from backend.identification.result import CorrelationTest, FirstOrder, Grade, Residuals, Verdict

Reals = NDArray[np.floating]

LEVEL = 0.01
_WHITENESS_LAGS = 25
_INPUT_LAGS = 50

MIN_COUNTS = 20.0
MIN_FIT_PERCENT = 80.0
CAUTION_FIT_PERCENT = 90.0
MAX_GAIN_ERROR_PERCENT = 10.0
CAUTION_GAIN_ERROR_PERCENT = 5.0
MAX_STD_PERCENT = 10.0
CAUTION_STD_PERCENT = 3.0


def fit_percent(y: Signal, simulated: Signal) -> float:
    """100 (1 - |y - simulated| / |y - mean y|)."""
    return float(100.0 * (1.0 - np.linalg.norm(y - simulated) / np.linalg.norm(y - np.mean(y))))


def residual_tests(residuals: Signal, u: Signal, period_s: float, slowest_s: float, parameter_count: int) -> Residuals:
    """Whiteness, correlation with the past input over five times ``slowest_s`` [s], AIC, BIC and FPE."""
    count = residuals.size
    variance = float(np.mean(residuals**2))
    log_likelihood = count * np.log(max(variance, np.finfo(float).tiny))
    return Residuals(
        whiteness=_whiteness(residuals, period_s),
        input_correlation=_input_correlation(residuals, u, period_s, slowest_s),
        std=float(np.sqrt(variance)),
        AIC=float(log_likelihood + 2.0 * parameter_count),
        BIC=float(log_likelihood + parameter_count * np.log(count)),
        FPE=variance * (count + parameter_count) / (count - parameter_count),
    )


def _correlation(first: Signal, second: Signal) -> Signal:
    """Sum of first[k + lag] second[k] over k for lag = 0 .. n-1, through the FFT."""
    size = next_fast_len(2 * first.size)
    return np.asarray(irfft(rfft(first, size) * np.conj(rfft(second, size)), size)[: first.size])


def _whiteness(residuals: Signal, period_s: float) -> CorrelationTest:
    products = _correlation(residuals, residuals)
    lags = np.arange(1, _WHITENESS_LAGS + 1)
    deviation = np.full(lags.size, 1.0 / np.sqrt(residuals.size))
    return _test(lags * period_s, products[lags] / max(products[0], np.finfo(float).tiny), deviation)


def _input_correlation(residuals: Signal, u: Signal, period_s: float, slowest_s: float) -> CorrelationTest:
    """Correlation of the residual with earlier inputs; its variance allows for the colour of both."""
    u = u - np.mean(u)
    own, drive = _correlation(residuals, residuals), _correlation(u, u)
    reach = int(np.clip(5.0 * slowest_s / period_s, _INPUT_LAGS, residuals.size // 4))
    lags = np.unique(np.linspace(1, reach, _INPUT_LAGS).astype(int))
    cross = _correlation(residuals, u)[lags]
    taper = 1.0 - np.arange(reach) / reach
    both = own[:reach] * drive[:reach] * taper / residuals.size
    variance = max(float(both[0] + 2.0 * np.sum(both[1:])), np.finfo(float).tiny)
    size = np.sqrt(max(own[0] * drive[0], np.finfo(float).tiny))
    return _test(lags * period_s, cross / size, np.full(lags.size, np.sqrt(variance) / size))


def _test(lags_s: Reals, correlation: Reals, deviation: Reals) -> CorrelationTest:
    alone = norm.ppf(1.0 - LEVEL / 2.0)
    together = norm.ppf(1.0 - LEVEL / (2.0 * lags_s.size))
    return CorrelationTest(
        lags_s=tuple(lags_s.tolist()),
        correlation=tuple(correlation.tolist()),
        band=tuple((alone * deviation).tolist()),
        passed=bool(np.all(np.abs(correlation) <= together * deviation)),
    )


def judge(
    first_order: FirstOrder,
    fit: float,
    residuals: Residuals,
    gain_error_percent: float | None,
    motion_counts: float | None,
) -> Verdict:
    """Grade a model and give the reasons; ``motion_counts`` is the output's peak-to-peak in sensor counts."""
    against: list[str] = []
    doubts: list[str] = []
    if motion_counts is not None and motion_counts < MIN_COUNTS:
        against.append(
            f"not enough motion, the output moved by {motion_counts:.1f} counts where {MIN_COUNTS:.0f} are needed"
            " (use longer chips or a larger amplitude)"
        )
    if gain_error_percent is not None and abs(gain_error_percent) > CAUTION_GAIN_ERROR_PERCENT:
        reason = f"gain {gain_error_percent:+.1f} % off the geometric one"
        (against if abs(gain_error_percent) > MAX_GAIN_ERROR_PERCENT else doubts).append(reason)
    spread = 100.0 * max(first_order.K_std / abs(first_order.K), first_order.T_std / first_order.T)
    if spread > CAUTION_STD_PERCENT:
        reason = f"gain or lag known to ±{spread:.1f} % only"
        (against if spread > MAX_STD_PERCENT else doubts).append(reason)
    if fit < CAUTION_FIT_PERCENT:
        reason = f"fit of {fit:.1f} % on unseen data"
        (against if fit < MIN_FIT_PERCENT else doubts).append(reason)
    if not residuals.input_correlation.passed:
        doubts.append("residuals still depend on the input, so the model is local (friction or missing dynamics)")
    if against:
        return Verdict(Grade.UNUSABLE, tuple(against + doubts))
    if doubts:
        return Verdict(Grade.CAUTION, tuple(doubts))
    praise = [f"fit of {fit:.1f} % on unseen data", f"K and T known to ±{spread:.2g} %"]
    if gain_error_percent is not None:
        praise.append(f"gain {gain_error_percent:+.1f} % from the geometric one")
    return Verdict(Grade.USABLE, tuple(praise))
