"""Validation of a model: residual tests, standard errors, noise model, verdict."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from backend.identification import messages
from backend.identification.excitation import correlation
from backend.identification.initialization import least_squares
from backend.identification.models import (
    CorrelationTest,
    DryFriction,
    FirstOrder,
    Grade,
    Model,
    Residuals,
    Verdict,
    worst_grade,
)
from backend.identification.records import MAX_SATURATED_PERCENT, RestAtLimit, Signal, UnstableModelError
from plant import Message

# Noise ---------------------------------------------------------------------------------------------
# Autoregressive noise model: the polynomial D that whitens residuals, y = G u + e / D.


MAX_NOISE_ORDER = 12


def fit_autoregression(residuals: Signal, max_order: int = MAX_NOISE_ORDER) -> Signal:
    """Return the coefficients 1, d_1 .. d_p of D(z^-1), by the Yule-Walker equations.

    The order p <= max_order minimizes BIC.
    """
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


# Residuals -----------------------------------------------------------------------------------------
# Tests of residuals for whiteness and for independence of the input.
#
# Both use the largest of many correlations, each in units of its own standard deviation, at the 1 % level for all of
# them together (Bonferroni).


RESIDUAL_LEVEL = 0.01
_WHITENESS_LAGS = 25
_INPUT_LAGS = 50

Reals = NDArray[np.floating]


@dataclass(frozen=True)
class Judged:
    """A residual test with its values.

    ``statistic`` is the largest correlation of ``lags`` lags in standard deviations, ``critical`` its limit at the
    level for all of them together; ``bound`` the same for each correlation as drawn. ``passed``: all are within their
    bounds.
    """

    lags: int
    statistic: float
    critical: float
    bound: tuple[float, ...]
    passed: bool

    @property
    def sentence(self) -> str:
        """Name of the test, its statistic, its level."""
        return messages.largest_correlation(
            lags=self.lags,
            deviations=self.statistic,
            critical=self.critical,
            level_percent=100.0 * RESIDUAL_LEVEL,
        )


def whiteness(residuals: Signal, period_s: float) -> CorrelationTest:
    """Return the autocorrelation of the residuals, shape (n,), at 1 .. 25 samples."""
    lags = np.arange(1, _WHITENESS_LAGS + 1)
    products = correlation(residuals, residuals)
    deviation = np.full(lags.size, 1.0 / np.sqrt(residuals.size))
    return _make_correlation_test(lags * period_s, products[lags] / max(products[0], np.finfo(float).tiny), deviation)


def input_correlation(residuals: Signal, u: Signal, period_s: float, slowest_s: float) -> CorrelationTest:
    """Return the correlation of the residuals with earlier inputs; both shape (n,).

    The lags extend to five times ``slowest_s`` [s]. The variance of each correlation is the sum over lags of r_e r_u,
    tapered: it allows for the colour of both.
    """
    u = u - np.mean(u)
    own, drive = correlation(residuals, residuals), correlation(u, u)
    reach = int(np.clip(5.0 * slowest_s / period_s, _INPUT_LAGS, residuals.size // 4))
    # Geometric: a missing fast pole shows at the first samples, a wrong lag after seconds.
    lags = np.unique(np.geomspace(1, reach, _INPUT_LAGS).astype(int))
    cross = correlation(residuals, u)[lags]
    both = own[:reach] * drive[:reach] * (1.0 - np.arange(reach) / reach) / residuals.size
    variance = max(float(both[0] + 2.0 * np.sum(both[1:])), np.finfo(float).tiny)
    size = np.sqrt(max(own[0] * drive[0], np.finfo(float).tiny))
    deviation = np.full(lags.size, np.sqrt(variance) / size)
    return _make_correlation_test(lags * period_s, cross / size, deviation)


class StoredTest(Protocol):
    """A test as made, or as stored."""

    @property
    def correlation(self) -> Sequence[float | None]:
        """Correlations by lag."""

    @property
    def bound(self) -> Sequence[float | None]:
        """Their bounds."""

    @property
    def passed(self) -> bool:
        """Whether all are within their bounds."""


def read_whiteness_test(test: StoredTest) -> Judged:
    """Return the values of a stored test."""
    correlation, bound = np.array(test.correlation, dtype=float), np.array(test.bound, dtype=float)
    critical = critical_deviation(correlation.size)
    return Judged(
        lags=correlation.size,
        statistic=float(np.max(np.abs(correlation) / bound)) * critical,
        critical=critical,
        bound=tuple(bound.tolist()),
        passed=test.passed,
    )


def critical_deviation(lags: int) -> float:
    """Return the bound of the largest correlation in standard deviations.

    White residuals exceed it with a probability of RESIDUAL_LEVEL.
    """
    from scipy.stats import norm

    return float(norm.ppf(1.0 - RESIDUAL_LEVEL / (2.0 * lags)))


def _make_correlation_test(lags_s: Reals, correlations: Reals, deviation: Reals) -> CorrelationTest:
    bound = critical_deviation(lags_s.size) * deviation
    return CorrelationTest(
        lags_s=tuple(lags_s.tolist()),
        correlation=tuple(correlations.tolist()),
        bound=tuple(bound.tolist()),
        passed=bool(np.all(np.abs(correlations) <= bound)),
    )


# Uncertainty ---------------------------------------------------------------------------------------
# Standard errors that are valid for coloured residuals: the sandwich formula with a HAC estimate.


def sandwich(instruments: Signal, sensitivities: Signal, residuals: Signal) -> Signal:
    """Return the covariance of the solution of instruments' residuals = 0.

    Shape (p, p). ``instruments`` Z and ``sensitivities`` J, shape (n, p); ``residuals`` shape (n,). NaN for parameters
    without effect. (Z'J)^-1 M (Z'J)^-T, where M is the long-run covariance of Z_t e_t: sum over lags of their
    covariances with Bartlett weights (Newey and West 1987), over a bandwidth from the data (Andrews 1991).
    """
    scale = np.linalg.norm(instruments, axis=0), np.linalg.norm(sensitivities, axis=0)
    unknown = ~(np.all(np.isfinite(instruments), axis=0) & np.all(np.isfinite(sensitivities), axis=0))
    unknown |= ~((scale[0] > 0.0) & (scale[1] > 0.0))
    if np.any(unknown):
        # The record does not determine parameters without a representable effect.
        known = ~unknown
        covariance = np.full((known.size, known.size), np.nan)
        if np.any(known):
            covariance[np.ix_(known, known)] = sandwich(instruments[:, known], sensitivities[:, known], residuals)
        return covariance
    bread = np.linalg.inv((instruments / scale[0]).T @ (sensitivities / scale[1]))
    moments = instruments / scale[0] * residuals[:, np.newaxis]
    middle = long_run_covariance(moments)
    covariance = bread @ middle @ bread.T / np.outer(scale[1], scale[1])
    return np.asarray((covariance + covariance.T) / 2.0)


def joint_sandwich(fits: Sequence[tuple[Signal, Signal, Signal]]) -> Signal:
    """Return the covariance of several solutions whose residuals may be correlated.

    Each fit has instruments, sensitivities, both (n, p_i), and residuals (n,), as in :func:`sandwich`; the result has
    the shape (sum of p_i, sum of p_i). Raises LinAlgError for parameters without effect.
    """
    breads, moments = [], []
    for instruments, sensitivities, residuals in fits:
        scale = np.linalg.norm(instruments, axis=0), np.linalg.norm(sensitivities, axis=0)
        bread = np.linalg.inv((instruments / scale[0]).T @ (sensitivities / scale[1])) / scale[1][:, np.newaxis]
        breads.append(bread)
        moments.append(instruments / scale[0] * residuals[:, np.newaxis])
    middle = long_run_covariance(np.column_stack(moments))
    edges = np.cumsum([0, *(bread.shape[0] for bread in breads)])
    bread = np.zeros((edges[-1], edges[-1]))
    for block, start, stop in zip(breads, edges[:-1], edges[1:], strict=True):
        bread[start:stop, start:stop] = block
    covariance = bread @ middle @ bread.T
    return np.asarray((covariance + covariance.T) / 2.0)


def long_run_covariance(moments: Signal) -> Signal:
    """Return the sum over lags of Bartlett weight times covariance, shape (p, p).

    The sum is evaluated in the frequency domain.
    """
    from scipy.fft import next_fast_len, rfft

    bandwidth = _bandwidth(moments)
    size = next_fast_len(moments.shape[0] + bandwidth, real=True)
    weights = np.zeros(size)
    weights[: bandwidth + 1] = 1.0 - np.arange(bandwidth + 1) / (bandwidth + 1.0)
    weights[size - bandwidth :] = weights[bandwidth:0:-1]
    spectrum = rfft(moments, size, axis=0)
    window = rfft(weights).real
    window[1 : (size + 1) // 2] *= 2.0
    return np.asarray((spectrum.conj().T @ (window[:, np.newaxis] * spectrum)).real / size)


def _bandwidth(moments: Signal) -> int:
    """Return Andrews' bandwidth for Bartlett weights.

    It follows from a first-order autoregression of each column.
    """
    count = moments.shape[0]
    past, now = moments[:-1], moments[1:]
    power = np.maximum(np.sum(moments**2, axis=0), np.finfo(float).tiny)  # zero for a perfect fit
    rho = np.clip(np.sum(past * now, axis=0) / power, -0.97, 0.9999)
    spread = 4.0 * rho**2 / ((1.0 - rho) ** 2 * (1.0 + rho) ** 2)
    return int(min(np.ceil(1.1447 * (np.mean(spread) * count) ** (1.0 / 3.0)), count // 10))


# Validation ----------------------------------------------------------------------------------------
# Requirements of a model for tuning: residual tests, fit on validation data, verdict.


MIN_COUNTS = 20.0
MAX_MISFIT_PERCENT = 20.0
CAUTION_MISFIT_PERCENT = 1.5
MAX_GAIN_ERROR_PERCENT = 10.0
CAUTION_GAIN_ERROR_PERCENT = 5.0
MAX_STD_PERCENT = 10.0
CAUTION_STD_PERCENT = 3.0
MAX_OTHER_STD_PERCENT = 39.0
"""For parameters other than K and T: beyond it they do not differ from zero at the 1 % level."""
MIN_FIT_PERCENT = 50.0
GOOD_FIT_PERCENT = 80.0
"""Fits with which a model explains three quarters of the output's variance, and 96 %."""
MAX_FRICTION_ERROR_PERCENT = 10.0
NEGLIGIBLE_PERCENT = 0.01
"""Residuals below this share of the motion are rounding, if they cannot change K and T either."""


def information_criteria(residuals: Signal, parameter_count: int) -> tuple[float, float, float]:
    """Return AIC, BIC and FPE of Gaussian residuals, shape (n,); smaller is better."""
    count, variance = residuals.size, max(float(np.mean(residuals**2)), np.finfo(float).tiny)
    log_likelihood = count * float(np.log(variance))
    return (
        log_likelihood + 2.0 * parameter_count,
        log_likelihood + parameter_count * float(np.log(count)),
        variance * (count + parameter_count) / (count - parameter_count),
    )


def misfit_percent(fit: float, resolution_percent: float) -> float:
    """Return the part of the motion [%] that neither model nor resolution explain.

    ``fit`` is in percent, too.
    """
    return float(np.sqrt(max((100.0 - fit) ** 2 - resolution_percent**2, 0.0)))


@dataclass(frozen=True)
class ValidationData:
    """Data of a verdict.

    - ``fit`` [%]: on validation data, NaN if there are none; ``fit_all`` [%]: on the record itself, used if
      ``unseen_rests``, that is if the output rests in the first two thirds of the record or in its last one.
    - ``motion_counts``: peak-to-peak of the output in sensor counts; ``resolution_percent``: standard deviation of
      rounding to counts in percent of the output's, 0 if the sensor is unknown.
    - ``friction``: set if Coulomb friction would be visible.
    - ``one_step``: the input changes only once.
    - ``rounding``: the residuals are no larger than rounding to the steps of the output's values.
    - ``largest_bias_percent``: largest change of K and T by residuals of this size.
    - ``at_limit``: rest of y at its extreme while u moves; ``input_at_limit_percent``: time that u rests there, with a
      known controller.
    - ``lead``: gain of an output that follows the input of the same sample.
    - ``fed_back``: the input reacts to coloured noise of the output, through an unspecified loop.
    - ``wrap``: size of a turn of an angle that wraps.
    """

    first_order: FirstOrder
    model: Model
    std_errors: Mapping[str, float]
    fit: float
    residuals: Residuals
    gain_error_percent: float | None
    motion_counts: float | None
    resolution_percent: float
    friction: DryFriction | None
    fit_all: float = float("nan")
    unseen_rests: bool = False
    one_step: bool = False
    rounding: bool = False
    largest_bias_percent: float = float("inf")
    at_limit: RestAtLimit | None = None
    input_at_limit_percent: float = 0.0
    lead: float | None = None
    period_s: float = 0.0
    fed_back: bool = False
    wrap: float | None = None

    @property
    def misfit(self) -> float:
        """Part of the motion [%] that neither model nor sensor explain; NaN without fit."""
        return misfit_percent(self.fit_all if self.unseen_rests else self.fit, self.resolution_percent)

    @property
    def unexplained(self) -> bool:
        """Whether the residuals indicate unmodelled dynamics."""
        return not (self.residuals.input_correlation.passed and self.residuals.whiteness.passed)

    @property
    def biased_by_loop(self) -> bool:
        """Whether an unspecified loop feeds coloured noise back into the input."""
        return self.fed_back and not self.negligible and bool(np.isfinite(self.misfit))

    @property
    def negligible(self) -> bool:
        """Whether the residuals are rounding, and too small to change K and T."""
        small = self.rounding or self.misfit <= NEGLIGIBLE_PERCENT
        return small and self.largest_bias_percent <= CAUTION_STD_PERCENT

    @property
    def spread(self) -> float:
        """Uncertainty of K and T [%]; NaN if not available.

        Standard errors do not include unmodelled dynamics: if the residuals indicate any, they are added.
        """
        known = _compute_relative_errors(self.first_order)
        if not self.unexplained:
            return float(np.max(known))
        return float(np.max([*known, self.largest_bias_percent if self.negligible else self.misfit]))

    @property
    def spread_with_friction(self) -> float:
        """Uncertainty [%] including friction that the record cannot exclude."""
        if self.friction is None:
            return self.spread
        off = self.friction.off_percent(self.first_order.K, self.first_order.T)
        return float(np.max([self.spread, *np.add(np.abs(off), _compute_relative_errors(self.friction))]))


def _compute_relative_errors(found: FirstOrder | DryFriction) -> list[float]:
    K_std, T_std = found.deviations
    return [100.0 * K_std / abs(found.K), 100.0 * T_std / abs(found.T)]


Finding = tuple[Grade, Message]


def judge(evidence: ValidationData) -> Verdict:
    """Grade a model and give the reasons. A value that is not available counts as bad."""
    if evidence.wrap is not None or evidence.lead is not None:
        return Verdict(Grade.UNUSABLE, tuple(reason for _, reason in _unsuitable(evidence)))
    findings = [
        *_signals(evidence),
        *_motion(evidence),
        *_friction(evidence),
        *_fit(evidence),
        *_gain(evidence),
        *_errors(evidence),
        *_residuals(evidence),
    ]
    for grade in (Grade.UNUSABLE, Grade.CAUTION):
        if any(found is grade for found, _ in findings):
            ordered = sorted(findings, key=lambda finding: finding[0] is not Grade.UNUSABLE)
            return Verdict(grade, tuple(reason for _, reason in ordered))
    praise = [messages.fit_on_validation_data(fit_percent=evidence.fit)]
    if evidence.spread_with_friction > evidence.spread:
        praise.append(
            messages.std_errors_within_with_friction(
                spread_percent=evidence.spread, friction_percent=evidence.spread_with_friction
            )
        )
    else:
        praise.append(messages.std_errors_within(spread_percent=evidence.spread))
    if evidence.gain_error_percent is not None:
        praise.append(messages.gain_unlike_geometry(error_percent=evidence.gain_error_percent))
    return Verdict(Grade.USABLE, tuple(praise))


def grade_value(value: float, caution: float, most: float) -> Grade:
    """Grade a value that is better the smaller it is; NaN is never usable."""
    if value <= caution:
        return Grade.USABLE
    return Grade.CAUTION if value <= most else Grade.UNUSABLE


def _unsuitable(evidence: ValidationData) -> Iterator[Finding]:
    """Yield the defects of signals that no model can describe."""
    if evidence.wrap is not None:
        yield Grade.UNUSABLE, messages.output_wraps(jump=evidence.wrap)
    if evidence.lead is not None:
        yield Grade.UNUSABLE, messages.output_follows_at_once(gain=evidence.lead, period_s=evidence.period_s)


def _signals(evidence: ValidationData) -> Iterator[Finding]:
    """Grade doubtful properties of the signals, independent of the model."""
    if evidence.one_step:
        yield Grade.CAUTION, messages.input_of_one_step()
    if evidence.input_at_limit_percent > MAX_SATURATED_PERCENT:
        yield Grade.CAUTION, messages.input_at_limit(time_percent=evidence.input_at_limit_percent)
    if evidence.biased_by_loop:
        yield (
            grade_value(evidence.misfit, 0.0, MAX_STD_PERCENT),
            messages.noise_fed_back(misfit_percent=evidence.misfit),
        )
    rest = evidence.at_limit
    if rest is not None and evidence.unexplained and not evidence.negligible:
        yield (
            (
                Grade.UNUSABLE,
                messages.output_stops_at_limit(limit=rest.limit, time_percent=rest.share_percent),
            )
            if rest.abrupt
            else (
                Grade.CAUTION,
                messages.output_rests_at_limit(limit=rest.limit, moving_percent=rest.moving_percent),
            )
        )


def _motion(evidence: ValidationData) -> Iterator[Finding]:
    counts = evidence.motion_counts
    if counts is not None and not counts >= MIN_COUNTS:
        yield Grade.UNUSABLE, messages.too_little_motion(counts=counts, minimum=MIN_COUNTS)


def _friction(evidence: ValidationData) -> Iterator[Finding]:
    friction = evidence.friction
    if friction is None or not friction.found:
        return
    K_off, T_off = friction.off_percent(evidence.first_order.K, evidence.first_order.T)
    grade = grade_value(max(abs(K_off), abs(T_off)), 0.0, MAX_FRICTION_ERROR_PERCENT)
    yield (
        grade,
        messages.friction_in_record(
            u_c=friction.u_c,
            K=friction.K,
            K_std=friction.K_std,
            T=friction.T,
            T_std=friction.T_std,
            t_d=friction.t_d,
            K_error_percent=K_off,
            T_error_percent=T_off,
        ),
    )


def _fit(evidence: ValidationData) -> Iterator[Finding]:
    if evidence.unseen_rests:
        yield (
            worst_grade(Grade.CAUTION, grade_value(evidence.misfit, 100.0 - GOOD_FIT_PERCENT, 100.0 - MIN_FIT_PERCENT)),
            messages.output_at_rest(fit_all_percent=evidence.fit_all),
        )
        return
    yield from grade_fit(evidence.fit, evidence.misfit)


def grade_fit(fit: float, misfit: float) -> Iterator[Finding]:
    """Yield a finding unless the fit [%] is good; ``misfit`` [%] is graded.

    A fit that is not finite is unusable.
    """
    if not np.isfinite(fit):
        yield Grade.UNUSABLE, messages.too_little_motion_for_validation()
        return
    grade = grade_value(misfit, 100.0 - GOOD_FIT_PERCENT, 100.0 - MIN_FIT_PERCENT)
    if grade is not Grade.USABLE:
        bound = MIN_FIT_PERCENT if grade is Grade.UNUSABLE else GOOD_FIT_PERCENT
        yield grade, messages.fit_too_low(fit_percent=fit, minimum_percent=bound)


def _gain(evidence: ValidationData) -> Iterator[Finding]:
    error = evidence.gain_error_percent
    if error is None:
        return
    grade = grade_value(abs(error), CAUTION_GAIN_ERROR_PERCENT, MAX_GAIN_ERROR_PERCENT)
    if grade is not Grade.USABLE:
        yield grade, messages.gain_unlike_geometry(error_percent=error)


def _errors(evidence: ValidationData) -> Iterator[Finding]:
    found = evidence.first_order
    # With a possible bias by the loop, the standard errors of K and T are meaningless.
    reduced = () if evidence.biased_by_loop else zip("KT", (found.K, found.T), found.deviations, strict=True)
    for name, value, std in reduced:
        spread = 100.0 * std / abs(value)
        grade = grade_value(spread, CAUTION_STD_PERCENT, MAX_STD_PERCENT)
        if grade is not Grade.USABLE:
            if np.isfinite(spread):
                yield grade, messages.parameter_uncertain(parameter=name, std_percent=spread)
            else:
                yield grade, messages.parameter_undetermined(parameter=name)
    for name, value in list(evidence.model.parameters.items())[1:]:
        spread = 100.0 * evidence.std_errors[name] / abs(value)
        grade = grade_value(spread, MAX_STD_PERCENT, MAX_OTHER_STD_PERCENT)
        if grade is not Grade.USABLE and name != "T":
            if np.isfinite(spread):
                yield grade, messages.structure_parameter_uncertain(parameter=name, std_percent=spread)
            else:
                yield grade, messages.structure_parameter_undetermined(parameter=name)


def _residuals(evidence: ValidationData) -> Iterator[Finding]:
    misfit, known_sensor = evidence.misfit, evidence.resolution_percent > 0.0
    follows = not evidence.residuals.input_correlation.passed
    named = evidence.friction is not None and evidence.friction.found
    if not evidence.unexplained or named or evidence.negligible or not np.isfinite(misfit):
        return
    if follows or known_sensor:
        # With known resolution the sensor is known too: larger, coloured residuals are friction, not noise.
        grade = grade_value(misfit, CAUTION_MISFIT_PERCENT, MAX_MISFIT_PERCENT)
        if grade is not Grade.USABLE:
            yield grade, messages.motion_unexplained(misfit_percent=misfit)
            return
    if not known_sensor:
        if follows:
            yield Grade.CAUTION, messages.residuals_follow_input(misfit_percent=misfit)
        else:
            yield Grade.CAUTION, messages.residuals_not_white(misfit_percent=misfit)


# Feedback ------------------------------------------------------------------------------------------
# Detection of an input that reacts to noise of its output: a record of an unspecified closed loop.


FEEDBACK_LEVEL = 1e-6
MIN_EXPLAINED = 0.1
_OWN_LAGS = 25
_FEEDBACK_LAGS = 3
_USUAL = 4.0
_EXACT = 1e-9


def has_noise_feedback(u: Signal, residuals: Signal, gain: float) -> bool:
    """Return whether u (n,) reacts to a model's residuals more than its past explains.

    In open loop the noise of the output does not predict the input. Samples with unusual steps of the input, such as
    the edges of a sequence, are omitted: between them a controller is most visible. The regression on the residuals
    must be significant (F test) and explain a tenth of the part that the past does not explain. With the model's
    ``gain``, the reaction must be a negative feedback: an output that shows its input at once, which no model here
    does, has the opposite sign.
    """
    from scipy.stats import f as fisher

    if np.mean(np.diff(u) == 0.0) > 0.5:
        return False  # held, unlike with a controller at this rate
    past = np.column_stack([np.ones(u.size - _OWN_LAGS), *_make_lags(u, range(1, _OWN_LAGS + 1))])
    noise = np.column_stack(_make_lags(residuals, range(_FEEDBACK_LAGS)))
    now = u[_OWN_LAGS:]
    try:
        open_ = np.abs(now - past @ least_squares(past, now))
        usual = float(np.median(open_))
        if not usual > _EXACT * float(np.std(u)):
            return False  # its past predicts it exactly
        is_open = open_ <= _USUAL * usual
        past, both, now = past[is_open], np.column_stack((past, noise))[is_open], now[is_open]
        open_ = now - past @ least_squares(past, now)
        left = [float(np.sum(error**2)) for error in (open_, now - both @ least_squares(both, now))]
    except (UnstableModelError, np.linalg.LinAlgError):
        return False
    spare = now.size - both.shape[1]
    explained = 1.0 - left[1] / left[0]
    against = gain * float(open_ @ noise[is_open, 0]) < 0.0
    if not (against and spare > 0 and explained > MIN_EXPLAINED):
        return False
    return bool(
        fisher.sf(explained / (1.0 - explained) * spare / _FEEDBACK_LAGS, _FEEDBACK_LAGS, spare) < FEEDBACK_LEVEL
    )


def _make_lags(signal: Signal, lags: range) -> list[Signal]:
    return [signal[_OWN_LAGS - lag : signal.size - lag] for lag in lags]
