"""What a model must show before it is used for tuning: tests on residuals, fit on unseen data, a verdict."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from backend.identification.record import MAX_SATURATED_PERCENT, RestAtLimit, Signal
from backend.identification.result import DryFriction, FirstOrder, Grade, Model, Residuals, Verdict, worst
from backend.units import percent

MIN_COUNTS = 20.0
MAX_MISFIT_PERCENT = 20.0
CAUTION_MISFIT_PERCENT = 1.5
MAX_GAIN_ERROR_PERCENT = 10.0
CAUTION_GAIN_ERROR_PERCENT = 5.0
MAX_STD_PERCENT = 10.0
CAUTION_STD_PERCENT = 3.0
MAX_OTHER_STD_PERCENT = 39.0
"""Of parameters other than K and T: beyond it they do not differ from zero at the 1 % level."""
MIN_FIT_PERCENT = 50.0
GOOD_FIT_PERCENT = 80.0
"""Fits by which a model explains three quarters of the output's variance, and 96 %."""
MAX_FRICTION_ERROR_PERCENT = 10.0
NEGLIGIBLE_PERCENT = 0.01
"""Residuals below this share of the motion are rounding of numbers, where they cannot move K and T either."""


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


@dataclass(frozen=True)
class Evidence:
    """What a verdict is made from.

    ``fit`` [%] on unseen data, NaN where there is none. ``motion_counts`` is the output's peak-to-peak in sensor
    counts; ``resolution_percent`` the standard deviation of rounding to counts in per cent of the output's, 0 where
    the sensor is not known. ``friction`` is there where dry friction would be seen.

    ``fit_all`` [%] is the fit on the record itself; it counts where ``unseen_rests``, the output rests in the first two
    thirds of the record or in its last one. ``one_step`` where the input changes once only. ``rounding`` where the
    residuals are no larger than rounding to the steps of the output's values makes them; ``largest_bias_percent`` is
    what residuals of this size could move K and T by at most, whatever they are. ``at_limit`` is how y rests at its
    extreme while u moves, ``input_at_limit_percent`` the time that u does so behind a known controller. ``lead``
    is the gain of an output that shows the input of its own instant. ``fed_back`` where the input reacts to coloured
    noise of the output, through a loop that was not named. ``wrap`` is the size of a turn of an angle that wraps.
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
        """What neither model nor sensor explains, in per cent of the motion; NaN where there is no fit."""
        return misfit_percent(self.fit_all if self.unseen_rests else self.fit, self.resolution_percent)

    @property
    def unexplained(self) -> bool:
        """Whether the residuals tell of something that the model leaves out."""
        return not (self.residuals.input_correlation.passed and self.residuals.whiteness.passed)

    @property
    def biased_by_loop(self) -> bool:
        """Whether a loop that was not named feeds coloured noise back into the input."""
        return self.fed_back and not self.negligible and bool(np.isfinite(self.misfit))

    @property
    def negligible(self) -> bool:
        """Whether the residuals are rounding, and too small to move K and T whatever they come from."""
        small = self.rounding or self.misfit <= NEGLIGIBLE_PERCENT
        return small and self.largest_bias_percent <= CAUTION_STD_PERCENT

    @property
    def spread(self) -> float:
        """How well K and T are known [%]; NaN where that could not be had.

        Standard errors do not cover what the structure leaves out: where the residuals tell of that, it counts as well.
        """
        known = _errors_of(self.first_order)
        if not self.unexplained:
            return float(np.max(known))
        return float(np.max([*known, self.largest_bias_percent if self.negligible else self.misfit]))

    @property
    def spread_with_friction(self) -> float:
        """The same, where dry friction that the record can neither show nor exclude is left open [%]."""
        if self.friction is None:
            return self.spread
        off = self.friction.off_percent(self.first_order.K, self.first_order.T)
        return float(np.max([self.spread, *np.add(np.abs(off), _errors_of(self.friction))]))


def _errors_of(found: FirstOrder | DryFriction) -> list[float]:
    return [100.0 * found.K_std / abs(found.K), 100.0 * found.T_std / abs(found.T)]


Finding = tuple[Grade, str]


def judge(evidence: Evidence) -> Verdict:
    """Grade a model and give the reasons. A figure that could not be had never counts in favour."""
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
    known = f"K and T known to ±{evidence.spread:.2g} %"
    if evidence.spread_with_friction > evidence.spread:
        known += f", ±{evidence.spread_with_friction:.2g} % if there is dry friction too little to be seen here"
    praise = [f"fit of {percent(evidence.fit)} % on unseen data", known]
    if evidence.gain_error_percent is not None:
        praise.append(f"gain {evidence.gain_error_percent:+.1f} % from the geometric one")
    return Verdict(Grade.USABLE, tuple(praise))


def graded(value: float, caution: float, most: float) -> Grade:
    """Grade a figure that is better the smaller it is; NaN, not measured, is never usable."""
    if value <= caution:
        return Grade.USABLE
    return Grade.CAUTION if value <= most else Grade.UNUSABLE


def _unsuitable(evidence: Evidence) -> Iterator[Finding]:
    """Signals that no model of this kind can connect; what else there is to say about the model follows from it."""
    if evidence.wrap is not None:
        yield (
            Grade.UNUSABLE,
            f"the output jumps by {evidence.wrap:.4g} and back as an angle does that wraps: unwrap it (numpy.unwrap)",
        )
    if evidence.lead is not None:
        yield (
            Grade.UNUSABLE,
            f"the output follows the input of the same sample (y = {evidence.lead:.4g} u + offset), without a lag that"
            f" the sample time of {evidence.period_s:.3g} s could show: check that the columns are two signals, sample"
            " faster",
        )


def _signals(evidence: Evidence) -> Iterator[Finding]:
    """Grade what is doubtful about the signals themselves, whatever the model."""
    if evidence.one_step:
        yield (
            Grade.CAUTION,
            "the input takes one step only, so nothing shows whether the model holds both ways and at other amplitudes",
        )
    if evidence.input_at_limit_percent > MAX_SATURATED_PERCENT:
        yield (
            Grade.CAUTION,
            f"the input is at its limit for {evidence.input_at_limit_percent:.1f} % of the time, where the controller"
            " does not say what it is: give --setpoint in place of --controller",
        )
    if evidence.biased_by_loop:
        yield (
            graded(evidence.misfit, 0.0, MAX_STD_PERCENT),
            "the record is of a closed loop: the input reacts to the noise of the output, which is not white, so K and"
            f" T may be off by as much as it is of the motion, {evidence.misfit:.2g} %, whatever their standard errors"
            " say: give --setpoint or --controller",
        )
    rest = evidence.at_limit
    if rest is not None and evidence.unexplained and not evidence.negligible:
        yield (
            (
                Grade.UNUSABLE,
                f"the output stops abruptly at its extreme value {rest.limit:.6g}, where it is for"
                f" {rest.share_percent:.1f} % of the time: it is saturated (excite with a smaller amplitude)",
            )
            if rest.abrupt
            else (
                Grade.CAUTION,
                f"the output rests at its extreme value {rest.limit:.6g} for {rest.moving_percent:.1f} % of the time"
                " while the input moves: it is saturated or stuck, or there is a dead time",
            )
        )


def _motion(evidence: Evidence) -> Iterator[Finding]:
    counts = evidence.motion_counts
    if counts is not None and not counts >= MIN_COUNTS:
        yield (
            Grade.UNUSABLE,
            f"not enough motion, the output moved by {counts:.1f} counts where {MIN_COUNTS:.0f} are needed"
            " (use longer chips or a larger amplitude)",
        )


def _friction(evidence: Evidence) -> Iterator[Finding]:
    friction = evidence.friction
    if friction is None or not friction.found:
        return
    K_off, T_off = friction.off_percent(evidence.first_order.K, evidence.first_order.T)
    grade = graded(max(abs(K_off), abs(T_off)), 0.0, MAX_FRICTION_ERROR_PERCENT)
    yield (
        grade,
        f"dry (Coulomb) friction takes {friction.u_c:.3g} of the input: with it the record says"
        f" K = {friction.K:.4g} ± {friction.K_std:.2g} and T = {friction.T:.4g} ± {friction.T_std:.2g} s"
        f"{f' behind a dead time of {friction.t_d:.3g} s' if friction.t_d else ''}, from which"
        f" this linear model is {K_off:+.1f} % and {T_off:+.1f} % off",
    )


def _fit(evidence: Evidence) -> Iterator[Finding]:
    if evidence.unseen_rests:
        yield (
            worst(Grade.CAUTION, graded(evidence.misfit, 100.0 - GOOD_FIT_PERCENT, 100.0 - MIN_FIT_PERCENT)),
            "fit on unseen data not measured, as the output rests in the first two thirds of the record or in its last"
            f" third; the fit on the record itself is {percent(evidence.fit_all)} %",
        )
        return
    if not np.isfinite(evidence.fit):
        yield (
            Grade.UNUSABLE,
            "fit on unseen data not measured, as the first two thirds or the last third of the record hold too little"
            " motion for a model of their own",
        )
        return
    grade = graded(evidence.misfit, 100.0 - GOOD_FIT_PERCENT, 100.0 - MIN_FIT_PERCENT)
    if grade is not Grade.USABLE:
        bound = MIN_FIT_PERCENT if grade is Grade.UNUSABLE else GOOD_FIT_PERCENT
        yield grade, f"fit of {percent(evidence.fit)} % on unseen data, where {bound:.0f} % are needed"


def _gain(evidence: Evidence) -> Iterator[Finding]:
    error = evidence.gain_error_percent
    if error is None:
        return
    grade = graded(abs(error), CAUTION_GAIN_ERROR_PERCENT, MAX_GAIN_ERROR_PERCENT)
    if grade is not Grade.USABLE:
        yield grade, f"gain {error:+.1f} % off the geometric one"


def _errors(evidence: Evidence) -> Iterator[Finding]:
    found = evidence.first_order
    # Beside what the loop may do to them, the standard errors of K and T say nothing.
    reduced = () if evidence.biased_by_loop else (("K", found.K, found.K_std), ("T", found.T, found.T_std))
    for name, value, std in reduced:
        spread = 100.0 * std / abs(value)
        grade = graded(spread, CAUTION_STD_PERCENT, MAX_STD_PERCENT)
        if grade is not Grade.USABLE:
            yield grade, _known(name, spread)
    for name, value in list(evidence.model.parameters.items())[1:]:
        spread = 100.0 * evidence.std_errors[name] / abs(value)
        grade = graded(spread, MAX_STD_PERCENT, MAX_OTHER_STD_PERCENT)
        if grade is not Grade.USABLE and name != "T":
            yield grade, f"{_known(name, spread)} (take a simpler structure)"


def _known(name: str, spread: float) -> str:
    if not np.isfinite(spread):
        return f"standard error of {name} not measured, the record does not determine it"
    return f"{name} known to ±{spread:.3g} % only"


def _residuals(evidence: Evidence) -> Iterator[Finding]:
    misfit, known_sensor = evidence.misfit, evidence.resolution_percent > 0.0
    follows = not evidence.residuals.input_correlation.passed
    named = evidence.friction is not None and evidence.friction.found
    if not evidence.unexplained or named or evidence.negligible or not np.isfinite(misfit):
        return
    if follows or known_sensor:
        # Where the resolution is known, so is the sensor: what is larger and coloured is friction, not noise.
        grade = graded(misfit, CAUTION_MISFIT_PERCENT, MAX_MISFIT_PERCENT)
        if grade is not Grade.USABLE:
            yield (
                grade,
                f"{misfit:.1f} % of the motion is neither the model's nor the sensor's (friction or missing dynamics),"
                " so the model is local: it holds near this amplitude and point only",
            )
            return
    if not known_sensor:
        told = "follow the input" if follows else "are not white"
        yield (
            Grade.CAUTION,
            f"the residuals ({misfit:.2g} % of the motion) {told}: the model leaves something out that standard errors"
            " do not cover",
        )
