"""Estimators with one common function: structures, ranking, quality, and hints."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from backend.identification import messages
from backend.identification.excitation import check_frequency_response, external_signal
from backend.identification.fitting import (
    Fit,
    Method,
    adapt,
    fit_output_error,
    fit_parameters,
    refit,
    skip_initial_samples,
)
from backend.identification.friction import SIGNIFICANT_STD, dry_friction, has_both_directions
from backend.identification.initialization import (
    WHITE,
    FitEvaluation,
    FitProblem,
    dead_times,
    least_squares,
    ranked_starts,
    triangle,
)
from backend.identification.models import (
    DEAD_TIME,
    MAX_LAGS,
    MAX_ORDER,
    DenominatorKind,
    DryFriction,
    Estimate,
    Grade,
    Hint,
    InputOffset,
    Model,
    Residuals,
    Structure,
    find_structure,
    reduce_to_first_order,
)
from backend.identification.records import (
    IdentificationError,
    NoStartError,
    NotContinuousError,
    NotConvergedError,
    Record,
    Signal,
    UnstableModelError,
    coarse_resolution,
    find_wrap,
    has_one_step,
    quantum,
    rest_at_limit,
    time_at_limit_percent,
)
from backend.identification.validation import (
    GOOD_FIT_PERCENT,
    MIN_COUNTS,
    NEGLIGIBLE_PERCENT,
    ValidationData,
    has_noise_feedback,
    information_criteria,
    judge,
    sandwich,
)

# Validation ----------------------------------------------------------------------------------------
# Validation of a model on data that it was not fitted to: measurement, prediction, and their difference.
#
# If the data begin during motion, initial state, offset and ramp are not part of the model: they are determined by
# least squares on that data, as in every fit here.


TRAINING_PART = 2.0 / 3.0
"""Fraction of a record that a model is fitted to when the rest is validation data."""


@dataclass(frozen=True)
class ModelComparison:
    """Measured and predicted output, shape (n,) each, from sample ``first`` on."""

    first: int
    measured: Signal
    predicted: Signal

    @property
    def fit_percent(self) -> float:
        """100 (1 - |y - y_hat| / |y - mean y|)."""
        return fit_percent(self.measured - self.predicted, self.measured - np.mean(self.measured))

    @property
    def rms(self) -> float:
        """RMS of measured minus predicted, in the unit of the output."""
        return float(np.sqrt(np.mean((self.measured - self.predicted) ** 2)))


def fit_percent(error: Signal, motion: Signal) -> float:
    """Return the fit [%] from the residual and the motion about its mean.

    Raises IdentificationError if there is no motion.
    """
    if np.ptp(motion) == 0.0:
        raise IdentificationError(messages.comparison_output_constant())
    return 100.0 * (1.0 - float(np.linalg.norm(error)) / float(np.linalg.norm(motion)))


def count_fitted_samples(record: Record) -> int:
    """Return the number of samples, from the first on, that a model is fitted to.

    The rest of the record is validation data.
    """
    return int(TRAINING_PART * record.u.size)


def split_last_part(record: Record) -> Record:
    """Return the validation part of a record. Raises RecordError if it is unsuitable."""
    return record.part(count_fitted_samples(record), record.u.size)


def compare_with_record(problem: FitProblem, parameters: Signal) -> ModelComparison:
    """Compare a structure with these parameters with the record of ``problem``.

    Raises UnstableModelError.
    """
    here = FitEvaluation(problem.unweighted, parameters)
    unknown = least_squares(here.nuisance, here.error)
    left_over = here.error - here.nuisance @ unknown
    y = problem.record.y[problem.first :]
    return ModelComparison(problem.first, y, y - left_over[problem.first :])


def validate_on_record(model: Model, record: Record) -> ModelComparison:
    """Compare a model with a record that it was not fitted to.

    Raises UnstableModelError.
    """
    return compare_with_record(FitProblem(record, find_structure(model.structure), WHITE), model.vector)


def validate_held_out(found: Fit) -> ModelComparison:
    """Fit a model to the first two thirds of a record, compare it with the last third.

    The fit is made as ``found`` was. Raises IdentificationError, LinAlgError if a part is unsuitable.
    """
    record = found.problem.record
    trained = refit(found, record.part(0, count_fitted_samples(record))).parameters
    return compare_with_record(replace(found.problem, record=split_last_part(record)), trained)


# Hints ---------------------------------------------------------------------------------------------
# Hints on whether a dead time or a higher order would improve an incomplete structure.
#
# Both models are fitted by output error to the same samples, so their fits and criteria are comparable. The other model
# starts from the found one: with dead times of a grid, or with another lag of a grid.


MIN_BIC_GAIN = 10.0
"""Difference of BIC that counts as very strong evidence."""
MOST_LEFT = 0.9
"""Largest fraction of the residuals remaining with another model that justifies a hint, if they still correlate with
the input."""
_STARTS_TRIED = 2
_LAGS = 8
_SHORTER = (1.0, 0.7, 0.4)


def find_hint(record: Record, model: Model) -> Hint | None:
    """Return the structure that explains the record much better, or None."""
    shape, problem = find_structure(model.structure), FitProblem(record, find_structure(model.structure), WHITE)
    best: Hint | None = None
    for other, starts in _others(problem, shape, model.vector, with_dead_time=record.controller is None):
        try:
            hint = _compare_structures(problem, model.vector, replace(problem, structure=other), starts)
        except (IdentificationError, np.linalg.LinAlgError):
            continue
        if hint is not None and (best is None or hint.BIC_gain > best.BIC_gain):
            best = hint
    return best


def _others(
    problem: FitProblem, shape: Structure, parameters: Signal, *, with_dead_time: bool
) -> Iterator[tuple[Structure, list[Signal]]]:
    """Yield the structure with a dead time, and that of one order more, with starts."""
    record = problem.record
    if with_dead_time and not shape.delayed:
        yield (
            find_structure(shape.name + DEAD_TIME),
            [
                np.concatenate((parameters[:1], _shorten_lags(shape, parameters, share)[1:], [late * record.period_s]))
                for late in dead_times(record)
                for share in _SHORTER
            ],
        )
    higher = _one_order_more(shape)
    if higher is not None:
        poles, lags = shape.poles(parameters), np.geomspace(2.0 * record.period_s, record.duration_s / 10.0, _LAGS)
        tail = parameters[-1:] if shape.delayed else parameters[:0]
        starts = []
        for lag in lags:
            # The sum of lags stays about the same: the others are reduced by the new one.
            share = max(0.3, 1.0 - lag / shape.sum_of_lags(parameters))
            descending = np.real(np.poly(np.append(poles / share, -1.0 / lag)))
            ascending = np.asarray(descending[::-1] / descending[-1])
            starts.append(np.concatenate((higher.from_denominator(float(parameters[0]), ascending), tail)))
        yield higher, starts


def _shorten_lags(shape: Structure, parameters: Signal, share: float) -> Signal:
    """Return the parameters with all lags scaled by ``share``, for a dead time."""
    powers = share ** np.arange(shape.order + 1)
    return shape.from_denominator(float(parameters[0]), shape.denominator(parameters) * powers)


def _one_order_more(shape: Structure) -> Structure | None:
    """Return the structure with another lag, None if there is none."""
    suffix = DEAD_TIME if shape.delayed else ""
    if shape.kind is DenominatorKind.LAGS:
        return find_structure(f"lags{shape.order + 1}{suffix}") if shape.order < MAX_LAGS else None
    return find_structure(f"order:{shape.order + 1}{suffix}") if shape.order < MAX_ORDER else None


def _compare_structures(
    problem: FitProblem, parameters: Signal, other: FitProblem, starts: list[Signal]
) -> Hint | None:
    """Fit both structures to the same samples and compare them.

    Returns None unless the other is clearly better.
    """
    ranked = [start for _, start in ranked_starts(other, starts)][:_STARTS_TRIED]
    if not ranked:
        return None
    other = skip_initial_samples(other, ranked)
    first = max(other.first, _count_dead_time_samples(problem, parameters))
    other, problem = replace(other, first=first), replace(problem, first=first)
    before = adapt(problem, parameters)
    after = min((fit_output_error(other, start) for start in ranked), key=lambda found: found.cost)
    count = problem.record.u.size - first
    more = other.structure.order + len(other.structure.names) - problem.structure.order - len(problem.structure.names)
    gain = 2.0 * count * float(np.log(before.cost / after.cost)) - more * float(np.log(count))
    spare = count - len(other.structure.names) - other.structure.order - 2
    ratio = ((before.cost / after.cost) ** 2 - 1.0) * spare / more
    tests = [Fit(found, None).input_correlation().passed for found in (before, after)]
    helps = after.cost < MOST_LEFT * before.cost or tests == [False, True]
    if not (gain > MIN_BIC_GAIN and helps):
        return None
    return Hint(
        structure=other.structure.name,
        dead_time=other.structure.delayed and not problem.structure.delayed,
        fit_percent_before=_fit_percent(before),
        fit_percent=_fit_percent(after),
        BIC_gain=gain,
        F=float(ratio),
        more_parameters=more,
        white=Fit(after, None).whiteness().passed,
        independent_of_input=tests[1],
    )


def _count_dead_time_samples(problem: FitProblem, parameters: Signal) -> int:
    """Return the number of samples omitted for a dead time that the structure has."""
    return skip_initial_samples(problem, [parameters]).first


def _fit_percent(found: FitEvaluation) -> float:
    y = found.problem.record.y[found.problem.first :]
    return 100.0 * (1.0 - found.cost / float(np.linalg.norm(y - np.mean(y))))


# Estimate ------------------------------------------------------------------------------------------
# One common function of all estimators: from a record and a structure to a model with its quality.


_RESTS = 0.1
"""Fraction of its total motion below which a part of a record counts as resting."""
_CLEARLY_LESS = 0.8


def estimate_model(
    record: Record,
    structure_name: str,
    method: Method = Method.DEFAULT,
    *,
    gain_geometry: float | None = None,
    y_resolution: float | None = None,
    hint: bool = True,
) -> Estimate:
    """Identify the structure from the record; ``hint`` adds better structures.

    ``gain_geometry`` [unit of y / unit of u] is the static gain for comparison; ``y_resolution`` is one count of the
    output sensor, detected from the record if it has few values. Raises IdentificationError.
    """
    try:
        # Overflows are handled where they arise; NumPy's own warnings are of no use here.
        with np.errstate(all="ignore"):
            found = _estimate(record, find_structure(structure_name), method, gain_geometry, y_resolution)
            return with_hint(record, found) if hint else found
    except np.linalg.LinAlgError:
        raise _cause_in(record, structure_name) or NotConvergedError(
            messages.structure_not_determined(structure=structure_name)
        ) from None
    except (NoStartError, NotConvergedError, NotContinuousError, UnstableModelError) as error:
        cause = _cause_in(record, structure_name)
        if cause is None:
            raise
        raise cause from error


def _cause_in(record: Record, structure_name: str) -> NotConvergedError | None:
    """Return the error that names the defect of the record, None if none is known."""
    wrap = find_wrap(record.y)
    if wrap is not None:
        return NotConvergedError(
            messages.no_model_of_wrapped_angle(structure=structure_name, jump=wrap[1], sample=wrap[0])
        )
    lead = _lead(record, float("inf"))
    if lead is None:
        return None
    return NotConvergedError(messages.no_time_constant(structure=structure_name, gain=lead))


def with_hint(record: Record, found: Estimate) -> Estimate:
    """Add a hint to an estimate whose residuals show unmodelled dynamics."""
    tests, friction = found.residuals, found.friction
    explained = tests.whiteness.passed and tests.input_correlation.passed
    if explained or 100.0 - found.fit_all_percent <= NEGLIGIBLE_PERCENT or (friction is not None and friction.found):
        return found
    rest, resolution = rest_at_limit(record.u, record.y), found.y_resolution
    if (rest is not None and rest.abrupt) or (resolution and np.ptp(record.y) < MIN_COUNTS * resolution):
        return found
    with np.errstate(all="ignore"):
        hint = find_hint(record, found.model)
    if hint is None:
        return found
    verdict = replace(found.verdict, reasons=(*found.verdict.reasons, hint.sentence))
    return replace(found, hint=hint, verdict=verdict)


def _estimate(
    record: Record, shape: Structure, method: Method, gain_geometry: float | None, y_resolution: float | None
) -> Estimate:
    found = fit_parameters(record, shape, method)
    model = Model(shape.name, dict(zip(shape.names, found.parameters.tolist(), strict=True)))
    covariance = found.covariance
    first_order = reduce_to_first_order(model, covariance)
    AIC, BIC, FPE = information_criteria(found.prediction_errors, found.parameters.size + shape.order + 2)
    residuals = Residuals(
        whiteness=found.whiteness(),
        input_correlation=found.input_correlation(),
        std=float(np.std(found.prediction_errors)),
        AIC=AIC,
        BIC=BIC,
        FPE=FPE,
    )
    whole = compare_with_record(found.problem, found.parameters)
    fit_percent, fit_all_percent = _held_out_fit(found), whole.fit_percent
    std_errors = dict(zip(shape.names, _standard_errors(covariance), strict=True))
    friction = _dry_friction(found, model)
    y_resolution = y_resolution or coarse_resolution(record.y)
    gain_error = None if gain_geometry is None else 100.0 * (model.gain / gain_geometry - 1.0)
    counts = None if y_resolution is None else float(np.ptp(record.y)) / y_resolution
    rounding = 100.0 * (y_resolution or 0.0) / float(np.sqrt(12.0) * np.std(record.y))
    step = quantum(record.y)
    left = whole.measured - whole.predicted
    wrap = find_wrap(record.y)
    evidence = ValidationData(
        first_order=first_order,
        model=model,
        std_errors=std_errors,
        fit=fit_percent,
        residuals=residuals,
        gain_error_percent=gain_error,
        motion_counts=counts,
        resolution_percent=rounding,
        friction=friction,
        fit_all=fit_all_percent,
        unseen_rests=not fit_percent >= GOOD_FIT_PERCENT and _has_rest(whole.predicted),
        one_step=has_one_step(record.u),
        rounding=step is not None and float(np.sqrt(np.mean(left**2))) <= 0.5 * step,
        largest_bias_percent=_largest_bias_percent(found, model),
        at_limit=rest_at_limit(record.u, record.y),
        input_at_limit_percent=0.0 if record.controller is None else time_at_limit_percent(record.u),
        lead=_lead(record, float(np.linalg.norm(left))),
        period_s=record.period_s,
        wrap=None if wrap is None else wrap[1],
        fed_back=external_signal(record) is None and _has_coloured_residuals(found) and _has_feedback(found),
    )
    return Estimate(
        model=model,
        std_errors=std_errors,
        covariance=covariance,
        method=found.method,
        fit_percent=fit_percent,
        fit_all_percent=fit_all_percent,
        first_order=first_order,
        noise=tuple(found.problem.whitening[1:].tolist()),
        residuals=residuals,
        frequency=check_frequency_response(model, record),
        gain_geometry=gain_geometry,
        gain_error_percent=gain_error,
        y_resolution=y_resolution,
        friction=friction,
        spread_percent=evidence.spread_with_friction,
        verdict=judge(evidence),
        input_offset=_input_offset(found),
    )


def _dry_friction(found: Fit, model: Model) -> DryFriction | None:
    """Compare friction with the linear model with the least simulation error.

    A noise model or a weighting increases that error. The result is None if the record cannot show friction.
    """
    if not has_both_directions(found.problem.record.y):
        return None
    return dry_friction(found.problem.record, adapt(found.problem.unweighted, found.parameters).error, model.dead_time)


def _held_out_fit(found: Fit) -> float:
    """Return the fit on the last third of the record of a model of the first two.

    NaN if a part is unsuitable.
    """
    try:
        return validate_held_out(found).fit_percent
    except (IdentificationError, np.linalg.LinAlgError):
        return float("nan")


def _has_coloured_residuals(found: Fit) -> bool:
    """Return whether the simulation residual is coloured, with or without noise model."""
    return found.problem.whitening.size > 1 or not found.whiteness().passed


def _has_feedback(found: Fit) -> bool:
    here = FitEvaluation(found.problem.unweighted, found.parameters)
    left = here.without_nuisance(here.error[:, np.newaxis])[:, 0]
    return has_noise_feedback(found.problem.record.u, left, float(found.parameters[0]))


def _input_offset(found: Fit) -> InputOffset | None:
    """Return the offset of the record, referred to the input, if it is significant.

    It is the offset at the middle of the record, at which the fitted ramp is zero.
    """
    plain = replace(found.problem, low_pass=0.0, whitening=WHITE)
    here = FitEvaluation(plain, found.parameters)
    columns = np.column_stack((here.nuisance, here.sensitivities))
    at, K = here.nuisance.shape[1] - 2, float(found.parameters[0])
    try:
        unknown = least_squares(here.nuisance, here.error)
        left = here.error - here.nuisance @ unknown
        covariance = sandwich(columns, columns, left)
    except (IdentificationError, np.linalg.LinAlgError):
        return None
    size = float(np.sqrt(plain.record.u.size - plain.first))
    offset, rows = float(unknown[at]) / size, [at, columns.shape[1] - found.parameters.size]
    gradient = np.array([-1.0 / (K * size), offset / K**2])
    variance = float(gradient @ covariance[np.ix_(rows, rows)] @ gradient)
    u_0 = -offset / K
    if not (variance > 0.0 and abs(u_0) > SIGNIFICANT_STD * np.sqrt(variance)):
        return None
    # An offset within the rounding errors is zero.
    if abs(u_0) < 1e-6 * float(np.max(np.abs(plain.record.u))):
        return None
    return InputOffset(u_0, float(np.sqrt(variance)))


def _has_rest(predicted: Signal) -> bool:
    """Return whether the model's output hardly moves in one part of the record.

    The parts are the first two thirds and the last third; ``predicted`` has shape (n,).
    """
    split = int(TRAINING_PART * predicted.size)
    return min(float(np.ptp(predicted[:split])), float(np.ptp(predicted[split:]))) < _RESTS * float(np.ptp(predicted))


def _largest_bias_percent(found: Fit, model: Model) -> float:
    """Return the largest bias of K and T by residuals of this size [%].

    By Cauchy and Schwarz the solution of J x = e is at most as long as |e| times that of J's pseudo-inverse. The result
    is infinite if it cannot be computed.
    """
    sensitivities = found.solution.without_nuisance(found.solution.sensitivities)
    factor = triangle(sensitivities)
    if not (np.all(np.isfinite(factor)) and np.all(np.diag(factor) != 0.0)):
        return float("inf")
    scale = np.concatenate(([1.0], found.parameters[1:]))
    inverse = np.linalg.inv(factor) * scale[:, np.newaxis] * float(np.linalg.norm(found.residuals))
    bias = reduce_to_first_order(model, inverse @ inverse.T)
    K_std, T_std = bias.deviations
    worst_case = 100.0 * max(abs(K_std / bias.K), abs(T_std / bias.T))
    return worst_case if np.isfinite(worst_case) else float("inf")


def _lead(record: Record, left: float) -> float | None:
    """Return the gain of an output that follows the input of the same sample, or None.

    A lag cannot cause this. ``left`` is the norm of the model's residual.
    """
    now = np.column_stack((np.ones(record.u.size), record.u))
    errors, gain = [], 0.0
    for columns in (now[1:], now[:-1]):
        offset_and_gain = least_squares(columns, record.y[1:])
        errors.append(float(np.linalg.norm(record.y[1:] - columns @ offset_and_gain)))
        gain = gain or float(offset_and_gain[1])
    return gain if errors[0] < _CLEARLY_LESS * min(errors[1], left) else None


def _standard_errors(covariance: Signal) -> list[float]:
    """Return the square roots of the diagonal; NaN for variances lost to rounding."""
    variances = np.diag(covariance)
    return [float(std) for std in np.sqrt(np.where(variances > 0.0, variances, np.nan))]


# Candidates ----------------------------------------------------------------------------------------
# Several structures on one record, ranked.


@dataclass(frozen=True)
class Candidates:
    """Estimates of one record, best first, and failed structures with the reason."""

    ranked: tuple[Estimate, ...]
    failed: dict[str, str]

    @property
    def best(self) -> Estimate:
        """First of the ranking."""
        return self.ranked[0]

    def to_json(self) -> dict[str, Any]:
        """Return plain dictionaries, lists and numbers."""
        return {"ranked": [candidate.to_json() for candidate in self.ranked], "failed": self.failed}


def rank(
    record: Record,
    structures: Sequence[str],
    method: Method = Method.DEFAULT,
    *,
    gain_geometry: float | None = None,
    y_resolution: float | None = None,
) -> Candidates:
    """Estimate each structure and rank: usable ones first, then by BIC.

    Arguments as for :func:`estimate_model`. Raises StructureError, and NotConvergedError if no structure gives a model.
    """
    found, failed = [], {}
    for name in structures:
        try:
            one = estimate_model(
                record, name, method, gain_geometry=gain_geometry, y_resolution=y_resolution, hint=False
            )
            found.append(one)
        except (NotConvergedError, NoStartError, NotContinuousError) as error:
            failed[name] = str(error)
    if not found:
        raise NotConvergedError(messages.no_structure_fits(reasons=list(failed.values())))
    best, *others = sorted(found, key=_rank)
    return Candidates((with_hint(record, best), *others), failed)


def _rank(candidate: Estimate) -> tuple[bool, float]:
    BIC = candidate.residuals.BIC
    return candidate.verdict.grade is Grade.UNUSABLE, float("inf") if BIC is None else BIC
