"""Identification of motors from voltage steps, or from voltage and angle.

Equation 17.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from backend.identification import messages
from backend.identification.estimation import ModelComparison
from backend.identification.friction import (
    SIGNIFICANT_STD,
    differences,
    has_both_directions,
    positive_lag,
    simulate_motion,
)
from backend.identification.initialization import dead_times
from backend.identification.models import CorrelationTest, Grade, Verdict, worst_grade
from backend.identification.records import (
    IdentificationError,
    NotConvergedError,
    Record,
    RecordError,
    Signal,
    coarse_resolution,
    find_wrap,
    quantum,
)
from backend.identification.validation import (
    CAUTION_MISFIT_PERCENT,
    CAUTION_STD_PERCENT,
    GOOD_FIT_PERCENT,
    MAX_STD_PERCENT,
    MIN_COUNTS,
    MIN_FIT_PERCENT,
    NEGLIGIBLE_PERCENT,
    grade_value,
    input_correlation,
    sandwich,
    whiteness,
)
from plant import Message

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult


# Motor ---------------------------------------------------------------------------------------------
# Motor from unloaded voltage steps (equation 17): the paper's 63.21 % rule, and least squares on position.
#
# Position obeys T_m w' + w = K_m (u - u_c sign w), w = theta': K_m / (s (T_m s + 1)) with a Coulomb voltage u_c, the
# part of the voltage that only overcomes Coulomb friction. After a step from rest, with v = K_m (u - u_c sign u),
#
#     theta(t) = theta_0 + v (t - T_m (1 - e^(-t/T_m))).


LEVEL = 0.01
MIN_RUNS = 2
MIN_STEP_SAMPLES = 50
MIN_MOTION_COUNTS = 200.0
MAX_LOAD_N = 0.5
MAX_MISFIT_COUNTS = 10.0
MAX_MOTOR_MISFIT_PERCENT = 10.0
_STEADY_PART = 0.2
_MIN_LENGTH_LAGS = 3.0
_SMOOTHING_PART = 0.02


@dataclass(frozen=True)
class VoltageStepRecord:
    """One run: ``u`` [V] steps once from zero; ``theta`` [rad] at the outlet.

    Both have shape (n,). ``tension_N`` is the tendon's force, shape (n,), if measured; ``u_max`` [V] the output's limit
    and ``count_rad`` the encoder's resolution. Raises RecordError for a run that saturates, is loaded, hardly moves, or
    is no step.
    """

    period_s: float
    u: Signal
    theta: Signal
    u_max: float
    count_rad: float
    tension_N: Signal | None = None

    def __post_init__(self) -> None:
        if self.u.shape != self.theta.shape or self.u.ndim != 1 or self.u.size < MIN_STEP_SAMPLES:
            raise RecordError(messages.step_too_short(length=self.u.size, minimum=MIN_STEP_SAMPLES))
        for name, values in (("u", self.u), ("theta", self.theta)):
            bad = int(np.count_nonzero(~np.isfinite(values)))
            if bad:
                raise RecordError(messages.step_not_finite(name=name, count=bad))
        largest_V = float(np.max(np.abs(self.u)))
        if largest_V >= self.u_max:
            raise RecordError(messages.step_saturates(voltage_V=largest_V, maximum_V=self.u_max))
        after = self.u[self.first :]
        if self.voltage == 0.0 or float(np.ptp(after)) > 1e-3 * abs(self.voltage):
            raise RecordError(
                messages.voltage_changes_after_step(change_V=float(np.ptp(after)), maximum_V=1e-3 * abs(self.voltage))
            )
        if self.tension_N is not None and float(np.max(np.abs(self.tension_N))) > MAX_LOAD_N:
            raise RecordError(
                messages.motor_is_loaded(force_N=float(np.max(np.abs(self.tension_N))), maximum_N=MAX_LOAD_N)
            )
        counts = float(np.ptp(self.theta)) / self.count_rad
        if counts < MIN_MOTION_COUNTS:
            raise RecordError(messages.motor_hardly_moves(counts=counts, minimum=MIN_MOTION_COUNTS))

    @property
    def first(self) -> int:
        """Index of the first sample with voltage."""
        return int(np.argmax(self.u != 0.0))

    @property
    def voltage(self) -> float:
        """Height of the step [V]."""
        return float(self.u[-1])


@dataclass(frozen=True)
class RuleResult:
    """Result of the 63.21 % rule on one run."""

    voltage: float
    K_m: float
    T_m: float


@dataclass(frozen=True)
class MotorIdentification:
    """Results of the 63.21 % rule and of least squares.

    ``rule`` has one entry per run, ``rule_mean`` and ``rule_spread`` are (K_m, T_m) over the runs. K_m [rad/(V·s)], T_m
    [s] and u_c [V] come from least squares on position over all runs; ``std_errors`` are theirs. ``rms_counts`` is the
    residual of the position in encoder counts. ``coulomb``: u_c differs from zero at the 1 % level; otherwise it is not
    fitted.
    """

    K_m: float
    T_m: float
    u_c: float
    std_errors: tuple[float, float, float]
    coulomb: bool
    rule: tuple[RuleResult, ...]
    rule_mean: tuple[float, float]
    rule_spread: tuple[float, float]
    rms_counts: float
    verdict: Verdict


def identify_motor(runs: Sequence[VoltageStepRecord]) -> MotorIdentification:
    """Identify the motor from steps of different voltages.

    Raises RecordError, NotConvergedError.
    """
    from scipy.stats import norm

    voltages = {abs(run.voltage) for run in runs}
    if len(voltages) < MIN_RUNS:
        raise RecordError(messages.too_few_voltages(count=len(voltages), minimum=MIN_RUNS))
    rule = tuple(rule_of_63_percent(run) for run in runs)
    gains, lags = np.array([[result.K_m, result.T_m] for result in rule]).T
    start = np.array([np.mean(gains), np.mean(lags), 0.0])
    solution, covariance, rms = _least_squares(runs, start, coulomb=True)
    significant = abs(solution[2]) > norm.ppf(1.0 - LEVEL / 2.0) * np.sqrt(covariance[2, 2])
    if not significant:
        solution, covariance, rms = _least_squares(runs, start, coulomb=False)
    _check_length(runs, float(solution[1]))
    std = np.sqrt(np.diag(covariance))
    counts = rms / runs[0].count_rad
    return MotorIdentification(
        K_m=float(solution[0]),
        T_m=float(solution[1]),
        u_c=float(solution[2]),
        std_errors=(float(std[0]), float(std[1]), float(std[2])),
        coulomb=bool(significant),
        rule=rule,
        rule_mean=(float(np.mean(gains)), float(np.mean(lags))),
        rule_spread=(float(np.std(gains, ddof=1)), float(np.std(lags, ddof=1))),
        rms_counts=float(counts),
        verdict=_verdict(solution, std, bool(significant), float(counts), 100.0 * rms / _motion(runs)),
    )


def rule_of_63_percent(run: VoltageStepRecord) -> RuleResult:
    """Take K_m from the steady speed and T_m from 63.21 % of it, as the paper does."""
    t = np.arange(run.u.size - run.first) * run.period_s
    theta = run.theta[run.first :]
    width = max(1, int(_SMOOTHING_PART * t.size))
    speed = (theta[2 * width :] - theta[: -2 * width]) / (2.0 * width * run.period_s)
    middle = t[width:-width]
    steady = float(
        np.polyfit(t[int((1.0 - _STEADY_PART) * t.size) :], theta[int((1.0 - _STEADY_PART) * t.size) :], 1)[0]
    )
    reached = int(np.argmax(speed / steady >= 1.0 - np.exp(-1.0)))
    return RuleResult(run.voltage, steady / run.voltage, float(middle[reached]))


def _least_squares(runs: Sequence[VoltageStepRecord], start: Signal, *, coulomb: bool) -> tuple[Signal, Signal, float]:
    """Return (K_m, T_m, u_c), their covariance, shape (3, 3), and the RMS error [rad]."""
    from scipy.optimize import least_squares

    free = 3 if coulomb else 2

    def residuals(parameters: Signal) -> Signal:
        full = np.concatenate((parameters, start[free:]))
        return np.concatenate([_without_mean(run.theta[run.first :] - _position(run, full)) for run in runs])

    found = least_squares(residuals, start[:free], x_scale=np.maximum(np.abs(start[:free]), 0.1), method="trf")
    if not found.success or found.x[1] <= 0.0:
        raise NotConvergedError(messages.no_motor_fits_steps())
    covariance = np.zeros((3, 3))
    sensitivities = -np.asarray(found.jac, dtype=np.float64)
    covariance[:free, :free] = sandwich(sensitivities, sensitivities, found.fun)
    return np.concatenate((found.x, start[free:])), covariance, float(np.sqrt(np.mean(found.fun**2)))


def turn_from_rest(t: ArrayLike, speed: float, T_m: float) -> Signal:
    """Return the rotation [rad] after times ``t`` [s] of a motor starting at rest.

    Its steady speed is ``speed`` [rad/s], its time constant ``T_m`` [s] (equation 17).
    """
    passed = np.asarray(t, np.float64)
    return np.asarray(speed * (passed + T_m * np.expm1(-passed / T_m)))


def steady_speed(voltage: float, K_m: float, u_c: float) -> float:
    """Return the speed [rad/s] at a ``voltage`` [V].

    The Coulomb voltage ``u_c`` [V] only overcomes Coulomb friction.
    """
    return K_m * (voltage - math.copysign(u_c, voltage))


def _position(run: VoltageStepRecord, parameters: Signal) -> Signal:
    K_m, T_m, u_c = parameters
    t = np.arange(run.u.size - run.first) * run.period_s
    return turn_from_rest(t, steady_speed(run.voltage, K_m, u_c), T_m)


def validate_motor_step(run: VoltageStepRecord, K_m: float, T_m: float, u_c: float) -> ModelComparison:
    """Compare a motor model with a step that it was not fitted to.

    The initial position is not part of the model.
    """
    measured, turn = run.theta[run.first :], _position(run, np.array([K_m, T_m, u_c]))
    return ModelComparison(run.first, measured, turn + np.mean(measured - turn))


def _motion(runs: Sequence[VoltageStepRecord]) -> float:
    """Return the RMS of the rotation about its mean [rad], over all runs."""
    turned = np.concatenate([_without_mean(run.theta[run.first :]) for run in runs])
    return float(np.sqrt(np.mean(turned**2)))


def _without_mean(error: Signal) -> Signal:
    return np.asarray(error - np.mean(error))


def _check_length(runs: Sequence[VoltageStepRecord], T_m: float) -> None:
    shortest = min((run.u.size - run.first) * run.period_s for run in runs)
    if shortest < _MIN_LENGTH_LAGS * T_m:
        raise RecordError(messages.step_ends_early(duration_s=shortest, minimum_s=_MIN_LENGTH_LAGS * T_m))


def judge_motor(K_m: float, T_m: float, spread_percent: float, counts: float, misfit_percent: float) -> Grade:
    """Grade a motor by the uncertainty of K_m and T_m [%] and the residuals.

    Residuals are in encoder counts and in percent of the rotation. A value that is not available counts as bad.
    """
    if not (K_m > 0.0 and T_m > 0.0):
        return Grade.UNUSABLE
    return worst_grade(
        grade_value(spread_percent, CAUTION_STD_PERCENT, MAX_STD_PERCENT),
        grade_value(counts, MAX_MISFIT_COUNTS, np.inf),
        grade_value(misfit_percent, CAUTION_MISFIT_PERCENT, MAX_MOTOR_MISFIT_PERCENT),
    )


def spread_percent(K_m: float, T_m: float, std_K_m: float, std_T_m: float) -> float:
    """Return the uncertainty of K_m and T_m [%]; NaN if not available."""
    return float(100.0 * np.max([std_K_m / abs(K_m), std_T_m / abs(T_m)]))


def _verdict(solution: Signal, std: Signal, coulomb: bool, counts: float, misfit_percent: float) -> Verdict:
    K_m, T_m, u_c = (float(value) for value in solution)
    spread = spread_percent(K_m, T_m, float(std[0]), float(std[1]))
    reasons = [
        messages.steps_give_std_errors(spread_percent=spread)
        if np.isfinite(spread)
        else messages.steps_give_no_std_errors(),
        messages.steps_give_friction(u_c=u_c) if coulomb else messages.no_friction_found(),
        messages.position_fitted(counts=counts, misfit_percent=misfit_percent),
    ]
    if K_m <= 0.0:
        reasons.insert(0, messages.motor_turns_backwards())
    return Verdict(judge_motor(K_m, T_m, spread, counts, misfit_percent), tuple(reasons))


# Motor record --------------------------------------------------------------------------------------
# Motor from any record of voltage and angle (equation 17): K_m e^(-t_d s) / (s (T_m s + 1)) with Coulomb friction.
#
# The record may contain any motion of the motor; the angle's zero is arbitrary. The model is the one of
# :mod:`backend.identification.friction`, integrated once. Dead time and friction that do not differ from zero are
# omitted from the model, but not from the verdict: the uncertainty of gain and lag is judged with both of them free.


NAMES = ("K_m", "T_m", "u_c", "t_d", "u_0")
_LAGS = 10
_FRICTIONS = (0.0, 0.1, 0.3, 0.6)
_MAX_STEPS = 60
_STARTS_TRIED = 3
_RESTS = 0.1
_MAX_CONDITION = 1e5
"""Condition number beyond which the record does not determine the parameters."""
_MIN_LIKELIHOOD_RATIO = 20.0
"""Least likelihood ratio, twice the logarithm; chance exceeds it once in a hundred thousand records."""
_TRAINING_PART = 2.0 / 3.0
_GAIN, _LAG, _SPEED, _FRICTION, _DELAY, _OFFSET = range(6)
_ALL, _OPTIONAL = range(6), (_FRICTION, _DELAY, _OFFSET)
_ORDER = [_GAIN, _LAG, _FRICTION, _DELAY, _OFFSET]
_WINDOWS = 200
"""Parts of a record whose mean speeds show whether the motor moves in both directions."""


@dataclass(frozen=True)
class MotorRecord:
    """Parameters of a motor with standard errors.

    K_m [rad/(V·s)], T_m [s], u_c [V], t_d [s] and u_0 [V], the voltage without effect. u_c and t_d are 0, without an
    error, if they do not differ from zero at 1 %, u_0 if it is less than four standard errors or the motor moves in one
    direction only, in which friction has the same effect. ``fit_percent`` is the simulated fit on the last third of the
    record of a model of the first two, NaN if there is none; ``rms`` [unit of y] the residual of the model.
    ``spread_percent`` is the uncertainty of K_m and T_m with friction, dead time and offset free.
    """

    K_m: float
    T_m: float
    u_c: float
    t_d: float
    u_0: float
    std_errors: tuple[float, float, float, float, float]
    fit_percent: float
    spread_percent: float
    rms: float
    whiteness: CorrelationTest
    input_correlation: CorrelationTest
    verdict: Verdict
    method: str = messages.least_squares_on_angle()

    @property
    def parameters(self) -> dict[str, float]:
        """Values by NAMES."""
        return {name: getattr(self, name) for name in NAMES}

    def summary(self) -> dict[str, Any]:
        """Return the summary that the command line prints."""
        return {
            "parameters": self.parameters,
            "std_errors": dict(zip(NAMES, self.std_errors, strict=True)),
            "method": self.method,
            "fit_percent": self.fit_percent,
            "spread_percent": self.spread_percent,
            "white": self.whiteness.passed,
            "independent_of_input": self.input_correlation.passed,
            "grade": self.verdict.grade,
            "verdict": self.verdict.sentence,
        }


@dataclass(frozen=True)
class _Fitted:
    """Solution of a fit, as :func:`_model` takes it.

    It includes the covariance of NAMES and the residuals from ``first`` on. Before sample ``first`` the voltage before
    the record may have an effect, for dead times up to twice the starting ones.
    """

    solution: Signal
    period_s: float
    covariance: Signal
    left: Signal
    first: int

    @property
    def parameters(self) -> Signal:
        """K_m, T_m, u_c, t_d, u_0."""
        K, log_T, _, u_c, late, u_0 = self.solution
        return np.array([K, np.exp(log_T), u_c, late * self.period_s, u_0])

    @property
    def std_errors(self) -> Signal:
        """Standard errors of the parameters; NaN for variances lost to rounding."""
        variances = np.diag(self.covariance)
        return np.asarray(np.sqrt(np.where(variances >= 0.0, variances, np.nan)))


def identify_motor_record(record: Record, y_resolution: float | None = None) -> MotorRecord:
    """Identify the motor from voltage u and angle y.

    Raises RecordError, NotConvergedError.
    """
    # Overflows are handled where they arise; NumPy's own warnings are of no use here.
    with np.errstate(all="ignore"):
        return _identify(record, y_resolution)


def _identify(record: Record, y_resolution: float | None) -> MotorRecord:
    wrap = find_wrap(record.y, least=1)
    if wrap is not None:
        jump = abs(float(record.y[wrap[0] + 1] - record.y[wrap[0]]))
        raise RecordError(messages.angle_wraps(sample=wrap[0], jump=jump, maximum=0.5 * wrap[1]))
    resolution = y_resolution or coarse_resolution(record.y)
    counts = float(np.ptp(record.y)) / resolution if resolution else None
    if counts is not None and counts < MIN_COUNTS:
        raise RecordError(messages.motor_hardly_moves(counts=counts, minimum=MIN_COUNTS))
    both = _has_both_directions(record)
    free = [which for which in _ALL if both or which != _OFFSET]
    starts = _starts(record, offset=False)[: 1 if both else _STARTS_TRIED]
    starts += _starts(record, offset=True)[: _STARTS_TRIED - 1] if both else []
    whole = found = _fit(record, free, starts)
    step = y_resolution or quantum(record.y)
    # In addition to the standard error, which is local: with one voltage gain and friction are indistinguishable.
    friction_std = float(whole.std_errors[2]) if _is_friction_significant(record, whole, free) else float("nan")
    while len(left := [which for which in free if which not in _OPTIONAL or _is_significant(found, which)]) < len(free):
        free, found = left, _fit(record, left, [np.where(np.isin(_ALL, left), found.solution, 0.0)])
    fit, fit_all = _held_out(record, found, free), _fit_of_all(record, found)
    rests = not fit >= GOOD_FIT_PERCENT and _has_rest(record, found)
    used = fit_all if rests else fit
    tests = whiteness(found.left, record.period_s), _input_correlation(record, found)
    rms = float(np.sqrt(np.mean(found.left**2)))
    # Residuals below a count are the sensor's; larger ones, coloured or correlated with the voltage, are the motor's.
    is_trusted = all(test.passed for test in tests) or (step is not None and rms < step)
    is_trusted = is_trusted or 100.0 - fit_all <= NEGLIGIBLE_PERCENT
    spread = _spread(whole, found) if np.isfinite(friction_std) else float("nan")
    K_m, T_m, u_c, t_d, u_0 = (float(value) for value in found.parameters)
    grades = [
        # White residuals are noise, with the floor of every structure; others are the motor's.
        grade_value(100.0 - used, 100.0 - GOOD_FIT_PERCENT, 100.0 - MIN_FIT_PERCENT),
        judge_motor(K_m, T_m, spread, rms / resolution if resolution else 0.0, 0.0 if is_trusted else 100.0 - used),
    ]
    findings = [
        *([(Grade.CAUTION, messages.angle_at_rest(fit_all_percent=fit_all))] if rests else []),
        *_findings(record, friction_std, float(whole.std_errors[3]), T_m, is_friction_significant=is_trusted),
    ]
    reasons = [
        *(reason for grade, reason in findings if grade is not Grade.USABLE),
        messages.motor_std_errors_within(spread_percent=spread)
        if np.isfinite(spread)
        else messages.motor_std_errors_not_measured(),
        messages.friction_found(u_c=u_c) if u_c > 0.0 else messages.no_friction_found(),
        messages.dead_time_found(t_d=t_d) if t_d > 0.0 else messages.no_dead_time_found(),
    ]
    if u_0:
        reasons.append(messages.input_offset_found(u_0=u_0, u_0_std=float(found.std_errors[4])))
    if not rests:
        has_fit = bool(np.isfinite(fit))
        reasons.append(messages.fit_on_validation_data(fit_percent=fit) if has_fit else messages.fit_not_measured())
    errors = dict.fromkeys(_ORDER, 0.0) | {
        which: float(std) for which, std in zip(_ORDER, found.std_errors, strict=True) if which in free
    }
    return MotorRecord(
        K_m,
        T_m,
        u_c,
        t_d,
        u_0,
        (errors[_GAIN], errors[_LAG], errors[_FRICTION], errors[_DELAY], errors[_OFFSET]),
        fit,
        spread,
        rms,
        *tests,
        Verdict(worst_grade(*grades, *(grade for grade, _ in findings)), tuple(reasons)),
    )


def _is_significant(found: _Fitted, which: int) -> bool:
    from scipy.stats import norm

    at = _ORDER.index(which)
    if which == _OFFSET:
        return bool(abs(found.parameters[at]) > SIGNIFICANT_STD * found.std_errors[at])
    return bool(found.parameters[at] > norm.ppf(1.0 - LEVEL / 2.0) * found.std_errors[at])


def _is_friction_significant(record: Record, whole: _Fitted, free: list[int]) -> bool:
    """Return whether friction larger by a tenth of the voltage increases the residual.

    All other parameters are adapted.
    """
    other = whole.solution.copy()
    other[_FRICTION] += 0.01 * MAX_STD_PERCENT * _size(record.u)
    worse = _fit(record, [which for which in free if which != _FRICTION], [other], whole.first)
    ratio = float(np.linalg.norm(worse.left) / np.linalg.norm(whole.left))
    return 2.0 * whole.left.size * float(np.log(ratio)) > _MIN_LIKELIHOOD_RATIO


def _size(u: Signal) -> float:
    return float(np.sqrt(np.mean(u**2)))


def _spread(whole: _Fitted, found: _Fitted) -> float:
    """Return the uncertainty of K_m and T_m [%], dead time and friction free.

    NaN if not available.
    """
    each = [
        spread_percent(*(float(value) for value in (*one.parameters[:2], *one.std_errors[:2])))
        for one in (whole, found)
    ]
    return float(np.max(each))


def _input_correlation(record: Record, found: _Fitted) -> CorrelationTest:
    _, T_m, _, t_d, _ = (float(value) for value in found.parameters)
    return input_correlation(found.left, record.u[found.first :], record.period_s, T_m + t_d)


def _findings(
    record: Record, friction_std: float, dead_time_std: float, T_m: float, *, is_friction_significant: bool
) -> Iterator[tuple[Grade, Message]]:
    """Grade the uncertainty of friction and dead time, relative to voltage and lag."""
    friction, dead_time = 100.0 * friction_std / _size(record.u), 100.0 * dead_time_std / T_m
    for name, share, reference in (("friction", friction, "voltage"), ("dead time", dead_time, "lag")):
        yield (
            grade_value(share, CAUTION_STD_PERCENT, MAX_STD_PERCENT),
            messages.weakly_determined(quantity=name, std_percent=share, reference=reference)
            if np.isfinite(share)
            else messages.not_separable(quantity=name),
        )
    if not is_friction_significant:
        yield Grade.CAUTION, messages.motor_residuals_not_white()


def _model(record: Record, z: Signal) -> Signal:
    """Return the rotation (n,) for K, ln T, first speed, u_c, dead time and u_0."""
    late = record.period_s * float(z[_DELAY])
    lag = positive_lag(float(z[_LAG]), record.period_s)
    return np.asarray(
        simulate_motion(
            u=record.u,
            period_s=record.period_s,
            K=z[_GAIN],
            T=lag,
            u_c=z[_FRICTION],
            u_0=z[_OFFSET],
            initial=z[_SPEED],
            dead_time_s=late,
        )[1]
    )


def _fit(record: Record, free: list[int], starts: list[Signal], first: int | None = None) -> _Fitted:
    """Return the least-squares fit of the angle, the best from all starts.

    Parameters that are not ``free`` stay constant. Raises NotConvergedError.
    """
    from scipy.optimize import least_squares

    longest = max(float(start[_DELAY]) for start in starts)
    if first is None:
        first = min(record.u.size // 4, int(2.0 * longest) + 1) if longest > 0.0 else 0

    def full(z: Signal) -> Signal:
        values = starts[0].copy()
        values[free] = z
        return values

    def residuals(z: Signal) -> Signal:
        error = (record.y - _model(record, full(z)))[first:]
        return np.asarray(error - np.mean(error))

    def descend(start: Signal) -> "OptimizeResult":
        scale = np.maximum(np.abs(start), 0.1 * np.max(np.abs(start[:_DELAY])))[free]
        try:
            return least_squares(residuals, start[free], jac=differences(residuals), x_scale=scale, max_nfev=_MAX_STEPS)
        except ValueError:  # a simulation that overflows
            raise NotConvergedError(messages.no_motor_fits_record()) from None

    best = min((descend(start) for start in starts), key=lambda one: float(one.cost))
    sensitivities = -np.asarray(best.jac, dtype=np.float64)
    moves = np.linalg.norm(sensitivities, axis=0) > 0.0
    if not (np.all(np.isfinite(best.x)) and moves[_GAIN] and moves[_LAG]):
        raise NotConvergedError(messages.no_motor_fits_record())
    solution = full(best.x)
    covariance = np.full((len(_ALL), len(_ALL)), np.nan)
    known, moving_ones = np.array(free)[moves], sensitivities[:, moves]
    if not np.all(np.isfinite(moving_ones)):
        raise NotConvergedError(messages.no_motor_fits_record())
    if float(np.linalg.cond(moving_ones / np.linalg.norm(moving_ones, axis=0))) < _MAX_CONDITION:
        covariance[np.ix_(known, known)] = sandwich(moving_ones, moving_ones, best.fun)
    unit = np.array([1.0, np.exp(solution[_LAG]), 1.0, record.period_s, 1.0])
    errors = covariance[np.ix_(_ORDER, _ORDER)] * np.outer(unit, unit)
    return _Fitted(solution, record.period_s, errors, np.asarray(best.fun), first)


def _has_both_directions(record: Record) -> bool:
    """Return whether the angle rises and falls for long enough.

    Only then can an offset of the voltage be distinguished from friction.
    """
    return has_both_directions(np.diff(record.y[:: max(1, record.y.size // _WINDOWS)]))


def _has_rest(record: Record, found: _Fitted) -> bool:
    """Return whether the model hardly turns in one part of the record.

    The parts are the first two thirds and the last third.
    """
    turn, split = _model(record, found.solution), int(_TRAINING_PART * record.u.size)
    return min(float(np.ptp(turn[:split])), float(np.ptp(turn[split:]))) < _RESTS * float(np.ptp(turn))


def _fit_of_all(record: Record, found: _Fitted) -> float:
    """Return the fit on the samples that the model was fitted to [%]."""
    y = record.y[found.first :]
    return 100.0 * (1.0 - float(np.linalg.norm(found.left)) / float(np.linalg.norm(y - np.mean(y))))


def _starts(record: Record, *, offset: bool) -> list[Signal]:
    """Return parameters of :func:`_model` over a grid, best first; K is fitted.

    The grid covers lags, frictions and dead times. With an ``offset`` a ramp of the angle is fitted as well, which is
    the effect of an offset of the voltage.
    """
    size, y = _size(record.u), record.y - np.mean(record.y)
    ramp = np.linspace(-1.0, 1.0, y.size)
    steady = float(y @ ramp) / float(ramp @ ramp) if offset else 0.0
    y = y - steady * ramp
    found = []
    lags = np.geomspace(3.0 * record.period_s, record.duration_s / 5.0, _LAGS).tolist()
    for T, share, late in itertools.product(lags, _FRICTIONS, [0.0, *dead_times(record)]):
        z = np.array([1.0, np.log(T), 0.0, share * size, late, 0.0])
        turn = _model(record, z)
        turn = turn - np.mean(turn)
        slope = float(turn @ ramp) / float(ramp @ ramp) if offset else 0.0
        turn = turn - slope * ramp
        z[_GAIN] = float(turn @ y) / max(float(turn @ turn), np.finfo(float).tiny)
        if offset and z[_GAIN]:
            z[_OFFSET] = (slope - steady / z[_GAIN]) * 2.0 / record.duration_s
        found.append((float(np.linalg.norm(y - z[_GAIN] * turn)), z))
    return [z for _, z in sorted(found, key=lambda pair: pair[0])]


def _held_out(record: Record, found: _Fitted, free: list[int]) -> float:
    """Return the fit on the last third, starting at the speed of the whole model."""
    split = int(_TRAINING_PART * record.u.size)
    try:
        trained = _fit(record.part(0, split), free, [found.solution]).solution
    except IdentificationError:
        return float("nan")
    y = record.y[split:] - np.mean(record.y[split:])
    turn = _model(record, trained)[split:]
    spread = float(np.linalg.norm(y))
    return 100.0 * (1.0 - float(np.linalg.norm(y - turn + np.mean(turn))) / spread) if spread > 0.0 else float("nan")
