"""Motor from any record of voltage and angle (equation 17): K_m e^(-t_d s) / (s (T_m s + 1)) with dry friction.

The record may hold steps, sequences or anything else that moves the motor; the angle's zero is free. The model is the
one of :mod:`backend.identification.friction`, integrated once. Dead time and friction that do not differ from zero are
left out of the model, but not out of the verdict: how well gain and lag are known is judged with both of them open.
"""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from backend.identification.errors import IdentificationError, NotConvergedError, RecordError
from backend.identification.friction import differences, moving
from backend.identification.motor import LEVEL, judge_motor, spread_percent
from backend.identification.record import Record, Signal, coarse_resolution
from backend.identification.residuals import input_correlation, whiteness
from backend.identification.result import CorrelationTest, Grade, Verdict, worst
from backend.identification.start import dead_times
from backend.identification.uncertainty import sandwich
from backend.identification.validation import (
    CAUTION_STD_PERCENT,
    GOOD_FIT_PERCENT,
    MAX_STD_PERCENT,
    MIN_COUNTS,
    MIN_FIT_PERCENT,
    graded,
)

if TYPE_CHECKING:
    from scipy.optimize import OptimizeResult

NAMES = ("K_m", "T_m", "u_c", "t_d")
_LAGS = 10
_FRICTIONS = (0.0, 0.1, 0.3, 0.6)
_MAX_STEPS = 60
_STARTS_TRIED = 3
_MAX_CONDITION = 1e5
"""Beyond it the record does not tell the parameters apart."""
_MIN_LIKELIHOOD_RATIO = 20.0
"""Twice the logarithm; chance alone exceeds it once in a hundred thousand records."""
_TRAINING_PART = 2.0 / 3.0
_GAIN, _LAG, _SPEED, _FRICTION, _DELAY = range(5)
_ALL, _OPTIONAL = range(5), (_FRICTION, _DELAY)
_ORDER = [_GAIN, _LAG, _FRICTION, _DELAY]


@dataclass(frozen=True)
class MotorRecord:
    """K_m [rad/(V·s)], T_m [s], u_c [V] and t_d [s] with standard errors.

    u_c and t_d are 0, without an error, where they do not differ from zero at 1 %. ``fit_percent`` is the simulated fit
    on the last third of the record by a model of the first two, NaN where there is none; ``rms`` [unit of y] what the
    model leaves over. ``spread_percent`` is how well K_m and T_m are known with friction and dead time both open.
    """

    K_m: float
    T_m: float
    u_c: float
    t_d: float
    std_errors: tuple[float, float, float, float]
    fit_percent: float
    spread_percent: float
    rms: float
    whiteness: CorrelationTest
    input_correlation: CorrelationTest
    verdict: Verdict
    method: str = "least squares on the angle"

    @property
    def parameters(self) -> dict[str, float]:
        """Values by NAMES."""
        return {name: getattr(self, name) for name in NAMES}

    def summary(self) -> dict[str, Any]:
        """Return what the command line prints."""
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
    """``solution``, as :func:`_model` takes it, the covariance of NAMES, and what is left over from ``first`` on.

    ``first`` is the sample before which the voltage of before the record may show, for dead times up to twice those to
    start from.
    """

    solution: Signal
    period_s: float
    covariance: Signal
    left: Signal
    first: int

    @property
    def parameters(self) -> Signal:
        """K_m, T_m, u_c, t_d."""
        K, log_T, _, u_c, late = self.solution
        return np.array([K, np.exp(log_T), u_c, late * self.period_s])

    @property
    def std_errors(self) -> Signal:
        """Of the same; NaN where rounding has eaten a variance."""
        variances = np.diag(self.covariance)
        return np.asarray(np.sqrt(np.where(variances >= 0.0, variances, np.nan)))


def identify_motor_record(record: Record, y_resolution: float | None = None) -> MotorRecord:
    """Identify the motor from voltage u and angle y. Raises RecordError, NotConvergedError."""
    resolution = y_resolution or coarse_resolution(record.y)
    counts = float(np.ptp(record.y)) / resolution if resolution else None
    if counts is not None and counts < MIN_COUNTS:
        raise RecordError("motion", counts, MIN_COUNTS, None, "counts", "step higher or record for longer")
    whole = found = _fitted(record, list(_ALL), _starts(record)[:_STARTS_TRIED])
    free = list(_ALL)
    # Beside a standard error, which looks at the next neighbourhood only: one voltage does not tell gain from friction.
    friction_std = float(whole.std_errors[2]) if _friction_told(record, whole) else float("nan")
    while len(left := [which for which in free if which not in _OPTIONAL or _significant(found, which)]) < len(free):
        free, found = left, _fitted(record, left, [np.where(np.isin(_ALL, left), found.solution, 0.0)])
    fit = _held_out(record, found, free)
    tests = whiteness(found.left, record.period_s), _input_correlation(record, found)
    rms = float(np.sqrt(np.mean(found.left**2)))
    # What is below a count is the sensor's; more that is not white, or follows the voltage, is the motor's.
    told = all(test.passed for test in tests) or (resolution is not None and rms < resolution)
    spread = _spread(whole, found) if np.isfinite(friction_std) else float("nan")
    K_m, T_m, u_c, t_d = (float(value) for value in found.parameters)
    findings = [
        # Where the rest is white it is noise, and the floor is that of every structure; else it is the motor's.
        (graded(100.0 - fit, 100.0 - GOOD_FIT_PERCENT, 100.0 - MIN_FIT_PERCENT), ""),
        (judge_motor(K_m, T_m, spread, rms / resolution if resolution else 0.0, 0.0 if told else 100.0 - fit), ""),
        *_findings(record, friction_std, float(whole.std_errors[3]), T_m, told=told),
    ]
    reasons = [
        *(words for grade, words in findings if words and grade is not Grade.USABLE),
        f"K_m and T_m known to ±{spread:.2g} %" if np.isfinite(spread) else "errors of K_m and T_m not measured",
        f"dry friction takes {u_c:.3g} V" if u_c > 0.0 else "no dry friction found",
        f"dead time of {1e3 * t_d:.3g} ms" if t_d > 0.0 else "no dead time found",
        f"fit of {fit:.1f} % on unseen data" if np.isfinite(fit) else "fit on unseen data not measured",
    ]
    errors = dict.fromkeys(_ORDER, 0.0) | {
        which: float(std) for which, std in zip(_ORDER, found.std_errors, strict=True) if which in free
    }
    return MotorRecord(
        K_m,
        T_m,
        u_c,
        t_d,
        (errors[_GAIN], errors[_LAG], errors[_FRICTION], errors[_DELAY]),
        fit,
        spread,
        rms,
        *tests,
        Verdict(worst(*(grade for grade, _ in findings)), tuple(reasons)),
    )


def _significant(found: _Fitted, which: int) -> bool:
    from scipy.stats import norm

    at = _ORDER.index(which)
    return bool(found.parameters[at] > norm.ppf(1.0 - LEVEL / 2.0) * found.std_errors[at])


def _friction_told(record: Record, whole: _Fitted) -> bool:
    """Whether a friction that is more by a tenth of the voltage would leave more over, everything else adapted."""
    other = whole.solution.copy()
    other[_FRICTION] += 0.01 * MAX_STD_PERCENT * _size(record.u)
    worse = _fitted(record, [which for which in _ALL if which != _FRICTION], [other], whole.first)
    ratio = float(np.linalg.norm(worse.left) / np.linalg.norm(whole.left))
    return 2.0 * whole.left.size * float(np.log(ratio)) > _MIN_LIKELIHOOD_RATIO


def _size(u: Signal) -> float:
    return float(np.sqrt(np.mean(u**2)))


def _spread(whole: _Fitted, found: _Fitted) -> float:
    """How well K_m and T_m are known [%], with dead time and friction open; NaN if not measured."""
    each = [
        spread_percent(*(float(value) for value in (*one.parameters[:2], *one.std_errors[:2])))
        for one in (whole, found)
    ]
    return float(np.max(each))


def _input_correlation(record: Record, found: _Fitted) -> CorrelationTest:
    _, T_m, _, t_d = (float(value) for value in found.parameters)
    return input_correlation(found.left, record.u[found.first :], record.period_s, T_m + t_d)


def _findings(
    record: Record, friction_std: float, dead_time_std: float, T_m: float, *, told: bool
) -> Iterator[tuple[Grade, str]]:
    """Grade what friction and dead time may be: in shares of what they stand beside, voltage and lag."""
    friction, dead_time = 100.0 * friction_std / _size(record.u), 100.0 * dead_time_std / T_m
    for name, share, beside in (("friction", friction, "voltage"), ("dead time", dead_time, "lag")):
        yield (
            graded(share, CAUTION_STD_PERCENT, MAX_STD_PERCENT),
            f"the record tells the {name} only to ±{share:.2g} % of the {beside}"
            if np.isfinite(share)
            else f"the record does not tell the {name} from gain and lag: drive the motor with several voltages",
        )
    if not told:
        yield Grade.CAUTION, "the residuals are not white: the motor does something that this model leaves out"


def _model(record: Record, z: Signal) -> Signal:
    """Turn by K, ln T, first speed, u_c and dead time in samples, shape (n,)."""
    late = record.period_s * float(z[_DELAY])
    lag = float(np.exp(z[_LAG]))
    return np.asarray(moving(record.u, record.period_s, z[_GAIN], lag, z[_FRICTION], 0.0, z[_SPEED], late)[1])


def _fitted(record: Record, free: list[int], starts: list[Signal], first: int | None = None) -> _Fitted:
    """Least squares on the angle, the best from all starts; what is not ``free`` stays. Raises NotConvergedError."""
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

    def descended(start: Signal) -> "OptimizeResult":
        scale = np.maximum(np.abs(start), 0.1 * np.max(np.abs(start[:_DELAY])))[free]
        return least_squares(residuals, start[free], jac=differences(residuals), x_scale=scale, max_nfev=_MAX_STEPS)

    best = min((descended(start) for start in starts), key=lambda one: float(one.cost))
    sensitivities = -np.asarray(best.jac, dtype=np.float64)
    moves = np.linalg.norm(sensitivities, axis=0) > 0.0
    if not (np.all(np.isfinite(best.x)) and moves[_GAIN] and moves[_LAG]):
        raise NotConvergedError("no motor K_m/(s (T_m s + 1)) describes this record: is it voltage and angle?")
    solution = full(best.x)
    covariance = np.full((len(_ALL), len(_ALL)), np.nan)
    known, moving_ones = np.array(free)[moves], sensitivities[:, moves]
    if float(np.linalg.cond(moving_ones / np.linalg.norm(moving_ones, axis=0))) < _MAX_CONDITION:
        covariance[np.ix_(known, known)] = sandwich(moving_ones, moving_ones, best.fun)
    unit = np.array([1.0, np.exp(solution[_LAG]), 1.0, record.period_s])
    errors = covariance[np.ix_(_ORDER, _ORDER)] * np.outer(unit, unit)
    return _Fitted(solution, record.period_s, errors, np.asarray(best.fun), first)


def _starts(record: Record) -> list[Signal]:
    """Return parameters of :func:`_model` over a grid of lags, frictions and dead times, best first; K is fitted."""
    size, y = _size(record.u), record.y - np.mean(record.y)
    found = []
    lags = np.geomspace(3.0 * record.period_s, record.duration_s / 5.0, _LAGS).tolist()
    for T, share, late in itertools.product(lags, _FRICTIONS, [0.0, *dead_times(record)]):
        z = np.array([1.0, np.log(T), 0.0, share * size, late])
        turn = _model(record, z)
        turn = turn - np.mean(turn)
        z[_GAIN] = float(turn @ y) / max(float(turn @ turn), np.finfo(float).tiny)
        found.append((float(np.linalg.norm(y - z[_GAIN] * turn)), z))
    return [z for _, z in sorted(found, key=lambda pair: pair[0])]


def _held_out(record: Record, found: _Fitted, free: list[int]) -> float:
    """Fit on the last third; the speed at which it begins is that of the model over the whole record."""
    split = int(_TRAINING_PART * record.u.size)
    try:
        trained = _fitted(record.part(0, split), free, [found.solution]).solution
    except IdentificationError:
        return float("nan")
    y = record.y[split:] - np.mean(record.y[split:])
    turn = _model(record, trained)[split:]
    spread = float(np.linalg.norm(y))
    return 100.0 * (1.0 - float(np.linalg.norm(y - turn + np.mean(turn))) / spread) if spread > 0.0 else float("nan")
