"""What a model must show before it is used for tuning: tests on residuals, fit on unseen data, a verdict."""

import numpy as np

from backend.identification.record import Signal
from backend.identification.result import FirstOrder, Grade, Residuals, Verdict

MIN_COUNTS = 20.0
MAX_MISFIT_PERCENT = 20.0
CAUTION_MISFIT_PERCENT = 1.5
MAX_GAIN_ERROR_PERCENT = 10.0
CAUTION_GAIN_ERROR_PERCENT = 5.0
MAX_STD_PERCENT = 10.0
CAUTION_STD_PERCENT = 3.0


def information_criteria(residuals: Signal, parameter_count: int) -> tuple[float, float, float]:
    """AIC, BIC and FPE of Gaussian residuals, shape (n,); smaller is better."""
    count, variance = residuals.size, max(float(np.mean(residuals**2)), np.finfo(float).tiny)
    log_likelihood = count * float(np.log(variance))
    return (
        log_likelihood + 2.0 * parameter_count,
        log_likelihood + parameter_count * float(np.log(count)),
        variance * (count + parameter_count) / (count - parameter_count),
    )


def misfit_percent(fit: float, resolution_percent: float) -> float:
    """Return what neither the model nor the sensor's resolution explains, in per cent of the motion, like ``fit``."""
    return float(np.sqrt(max((100.0 - fit) ** 2 - resolution_percent**2, 0.0)))


def judge(
    first_order: FirstOrder,
    fit: float,
    residuals: Residuals,
    gain_error_percent: float | None,
    motion_counts: float | None,
    resolution_percent: float,
) -> Verdict:
    """Grade a model and give the reasons.

    ``motion_counts`` is the output's peak-to-peak in sensor counts; ``resolution_percent`` the standard deviation of
    rounding to counts in per cent of the output's, 0 where it is not known.
    """
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
    misfit = misfit_percent(fit, resolution_percent)
    # Where the resolution is known, so is the sensor: what is larger and coloured is friction, not noise.
    known_sensor = resolution_percent > 0.0
    unexplained = not residuals.input_correlation.passed or (known_sensor and not residuals.whiteness.passed)
    if unexplained and misfit > CAUTION_MISFIT_PERCENT:
        reason = (
            f"{misfit:.1f} % of the motion is neither the model's nor the sensor's (friction or missing dynamics),"
            " so the model is local: it holds near this amplitude and point only"
        )
        (against if misfit > MAX_MISFIT_PERCENT else doubts).append(reason)
    if against:
        return Verdict(Grade.UNUSABLE, tuple(against + doubts))
    if doubts:
        return Verdict(Grade.CAUTION, tuple(doubts))
    praise = [f"fit of {fit:.1f} % on unseen data", f"K and T known to ±{spread:.2g} %"]
    if gain_error_percent is not None:
        praise.append(f"gain {gain_error_percent:+.1f} % from the geometric one")
    return Verdict(Grade.USABLE, tuple(praise))
