"""Identification of a 2 x 2 model from one run that excites both channels."""

from collections.abc import Sequence

import numpy as np

from backend.identification import messages
from backend.identification.estimation import TRAINING_PART, fit_percent
from backend.identification.fitting import Method
from backend.identification.initialization import WHITE
from backend.identification.records import (
    IdentificationError,
    NoStartError,
    NotConvergedError,
    Signal,
    UnstableModelError,
    coarse_resolution,
    find_wrap,
    quantum,
    rest_at_limit,
)
from backend.identification.relative_gain import relative_gain, relative_gain_std
from backend.identification.two_channel_models import (
    EntryEstimate,
    OutputEstimate,
    OutputModel,
    RelativeGain,
    TwoChannelIdentification,
    TwoChannelModel,
    compute_first_order,
    compute_frequency_matrix,
    compute_gain_covariance,
)
from backend.identification.two_channel_record import TwoChannelRecord
from backend.identification.two_channel_verdict import SIGNIFICANT_STD, EntryData, judge_entry, judge_model
from backend.identification.two_input_fit import (
    OutputStructure,
    TwoInputEvaluation,
    TwoInputFit,
    TwoInputProblem,
    fit_two_inputs,
    refit_part,
)
from backend.identification.validation import (
    RESIDUAL_LEVEL,
    has_noise_feedback,
    information_criteria,
    joint_sandwich,
    misfit_percent,
)

_LINES = 60
_FASTEST = 30.0
_ROUNDING = 1e-7


def identify_two_channels(
    record: TwoChannelRecord,
    structures: tuple[OutputStructure, OutputStructure] = (OutputStructure(), OutputStructure()),
    method: Method = Method.DEFAULT,
    *,
    y_resolution: tuple[float | None, float | None] = (None, None),
    omega: Signal | None = None,
) -> TwoChannelIdentification:
    """Identify A_i(s) y_i = B_i1(s) u_1 + B_i2(s) u_2 for both outputs.

    ``structures`` are those of y_1 and y_2; ``y_resolution`` is one count of each output's sensor, detected from the
    record if it has few values; ``omega`` [rad/s] are the lines of the frequency response, by default 60 from one
    period in the record to well above the loops. Raises RecordError, StructureError and NotConvergedError.
    """
    try:
        with np.errstate(all="ignore"):
            return _identify(record, structures, method, y_resolution, omega)
    except np.linalg.LinAlgError:
        raise NotConvergedError(
            messages.structure_not_determined(structure=" and ".join(one.denominator for one in structures))
        ) from None


def select_structure(
    record: TwoChannelRecord,
    row: int,
    candidates: Sequence[OutputStructure],
    method: Method = Method.DEFAULT,
) -> OutputStructure:
    """Return the candidate for output ``row`` (0 or 1) whose model has the smallest BIC.

    Candidates that give no model are left out. Raises NotConvergedError if none gives one, and StructureError.
    """
    found, reasons = [], []
    for shape in candidates:
        problem = TwoInputProblem(record.period_s, record.u, record.y[:, row], shape, WHITE)
        try:
            with np.errstate(all="ignore"):
                fit = fit_two_inputs(problem, method, record.r)
        except (NoStartError, NotConvergedError, UnstableModelError) as error:
            reasons.append(str(error))
        except np.linalg.LinAlgError:
            reasons.append(messages.structure_not_determined(structure=shape.denominator))
        else:
            found.append((information_criteria(fit.residuals, _count_parameters(fit))[1], shape))
    if not found:
        raise NotConvergedError(messages.no_structure_fits(reasons=reasons))
    return min(found, key=lambda pair: pair[0])[1]


def _count_parameters(found: TwoInputFit) -> int:
    """Return the number of fitted values: parameters, initial state, offset, ramp and noise model."""
    problem = found.problem
    return len(problem.shape.names) + problem.structure.order + 2 + problem.whitening.size - 1


def _identify(
    record: TwoChannelRecord,
    structures: tuple[OutputStructure, OutputStructure],
    method: Method,
    y_resolution: tuple[float | None, float | None],
    omega: Signal | None,
) -> TwoChannelIdentification:
    first, second = (
        fit_two_inputs(TwoInputProblem(record.period_s, record.u, record.y[:, i], shape, WHITE), method, record.r)
        for i, shape in enumerate(structures)
    )
    model = TwoChannelModel(record.inputs, record.outputs, (_build_model(first), _build_model(second)))
    covariance = joint_sandwich([(fit.instruments, fit.sensitivities, fit.residuals) for fit in (first, second)])
    gain_covariance = compute_gain_covariance(model, covariance)
    gains, edge = model.gains, len(structures[0].names)
    own = covariance[:edge, :edge], covariance[edge:, edge:]
    first_row = _OutputResult(record, 0, first, model.rows[0], own[0], y_resolution[0])
    second_row = _OutputResult(record, 1, second, model.rows[1], own[1], y_resolution[1])
    entries = (
        (first_row.estimate_entry(0), first_row.estimate_entry(1)),
        (second_row.estimate_entry(0), second_row.estimate_entry(1)),
    )
    found = RelativeGain(float(relative_gain(gains).real), float(relative_gain_std(gains, gain_covariance)))
    return TwoChannelIdentification(
        model=model,
        covariance=covariance,
        gains=((float(gains[0, 0]), float(gains[0, 1])), (float(gains[1, 0]), float(gains[1, 1]))),
        gain_covariance=gain_covariance,
        relative_gain=found,
        entries=entries,
        outputs=(first_row.estimate(), second_row.estimate()),
        frequency=compute_frequency_matrix(
            model, covariance, _default_lines(record, model) if omega is None else omega
        ),
        input_correlation=record.input_correlation(),
        verdict=judge_model([entry for row in entries for entry in row], found),
    )


def _build_model(found: TwoInputFit) -> OutputModel:
    shape = found.problem.shape
    return OutputModel(shape, dict(zip(shape.names, found.parameters.tolist(), strict=True)))


def _default_lines(record: TwoChannelRecord, model: TwoChannelModel) -> Signal:
    """Return lines [rad/s] evenly spaced in log, up to 30 times the corner of the fastest row."""
    lowest = 2.0 * np.pi / (record.size * record.period_s)
    corner = max(1.0 / float(row.denominator[1]) for row in model.rows)
    highest = min(_FASTEST * corner, np.pi / record.period_s)
    return np.geomspace(lowest, max(highest, 10.0 * lowest), _LINES)


class _OutputResult:
    """Quality of the fit of one output, and of its two entries."""

    def __init__(
        self,
        record: TwoChannelRecord,
        row: int,
        found: TwoInputFit,
        model: OutputModel,
        covariance: Signal,
        y_resolution: float | None,
    ) -> None:
        self.record, self.row, self.found, self.model = record, row, found, model
        self.covariance = covariance
        y = record.y[:, row]
        self.y_resolution = y_resolution or coarse_resolution(y)
        variances = np.diag(covariance)
        self.std = np.sqrt(np.where(variances > 0.0, variances, np.nan))
        self.whiteness = found.whiteness()
        self.input_correlations = found.input_correlation(0), found.input_correlation(1)
        self.left = _simulation_error(found.problem, found.parameters)
        self.motion = y - np.mean(y)
        self.fit_all = fit_percent(self.left, self.motion)
        self.fit = _held_out_fit(found)

    def estimate(self) -> OutputEstimate:
        """Return the quality of the row."""
        found, shape = self.found, self.found.problem.shape
        AIC, BIC, FPE = information_criteria(found.residuals, _count_parameters(found))
        return OutputEstimate(
            output=self.record.outputs[self.row],
            std_errors=dict(zip(shape.names, self.std.tolist(), strict=True)),
            method=found.method,
            noise=tuple(found.problem.whitening[1:].tolist()),
            fit_percent=self.fit,
            fit_all_percent=self.fit_all,
            y_resolution=self.y_resolution,
            whiteness=self.whiteness,
            input_correlations=self.input_correlations,
            residual_std=float(np.std(found.residuals)),
            AIC=AIC,
            BIC=BIC,
            FPE=FPE,
        )

    def estimate_entry(self, channel: int) -> EntryEstimate:
        """Return the entry of one input with its verdict."""
        from scipy.stats import chi2

        place = self.found.problem.shape.numerator_slice(channel)
        numerator = self.model.numerator(channel)
        wald = _compute_wald(numerator, self.covariance[place, place], self._find_smallest_coefficients(place))
        bound = float(chi2.ppf(1.0 - RESIDUAL_LEVEL, numerator.size))
        gain, gain_std = float(numerator[0]), float(self.std[place.start])
        has_gain = abs(gain) > SIGNIFICANT_STD * gain_std
        first_order = compute_first_order(self.model, channel, self.covariance) if has_gain else None
        u, motion = self.record.u[:, channel], float(np.std(self.motion))
        caused = self.model.simulate_input(channel, u, self.record.period_s)
        data = EntryData(
            input=self.record.inputs[channel],
            output=self.record.outputs[self.row],
            is_direct=channel == self.row,
            gain=gain,
            gain_std=gain_std,
            wald=wald,
            wald_bound=bound,
            first_order=first_order,
            motion_percent=100.0 * float(np.std(caused)) / motion,
            gain_std_percent=100.0 * gain_std * float(np.std(u)) / motion,
            relative_errors=self._relative_errors(),
            fit=self.fit,
            misfit=self._misfit(),
            is_white=self.whiteness.passed,
            is_independent=self.input_correlations[channel].passed,
            rounding=self._is_rounding(),
            has_known_sensor=self.y_resolution is not None,
            counts=None if self.y_resolution is None else float(np.ptp(self.motion)) / self.y_resolution,
            wrap=self._wrap(),
            at_limit=rest_at_limit(u, self.record.y[:, self.row]),
            is_fed_back=self._is_fed_back(channel, gain),
        )
        return EntryEstimate(
            input=data.input,
            output=data.output,
            gain=gain,
            gain_std=gain_std,
            numerator=tuple(numerator.tolist()),
            numerator_std=tuple(self.std[place].tolist()),
            denominator=tuple(self.model.denominator.tolist()),
            wald=wald,
            wald_bound=bound,
            is_zero=data.is_zero,
            first_order=first_order,
            motion_percent=data.motion_percent,
            verdict=judge_entry(data),
        )

    def _find_smallest_coefficients(self, place: slice) -> Signal:
        """Return the coefficients that move the output by no more than the rounding of the fit."""
        solution = self.found.solution
        return np.asarray(
            _ROUNDING * np.linalg.norm(solution.output) / np.linalg.norm(solution.sensitivities[:, place], axis=0)
        )

    def _relative_errors(self) -> dict[str, float]:
        shape = self.found.problem.shape
        first = shape.numerator_count
        relative = 100.0 * self.std[first:] / self.model.vector[first:]
        return dict(zip(shape.names[first:], relative.tolist(), strict=True))

    def _misfit(self) -> float:
        rounding = 100.0 * (self.y_resolution or 0.0) / float(np.sqrt(12.0) * np.std(self.motion))
        return misfit_percent(self.fit, rounding)

    def _is_rounding(self) -> bool:
        step = quantum(self.record.y[:, self.row])
        return step is not None and float(np.sqrt(np.mean(self.left**2))) <= 0.5 * step

    def _wrap(self) -> float | None:
        wrap = find_wrap(self.record.y[:, self.row])
        return None if wrap is None else wrap[1]

    def _is_fed_back(self, channel: int, gain: float) -> bool:
        """Return whether the input reacts to coloured noise of the output through an unknown loop."""
        is_coloured = self.found.problem.whitening.size > 1 or not self.whiteness.passed
        return self.record.r is None and is_coloured and has_noise_feedback(self.record.u[:, channel], self.left, gain)


def _compute_wald(coefficients: Signal, covariance: Signal, smallest: Signal) -> float:
    """Return b' C^-1 b, chi-squared with as many degrees of freedom as coefficients if b is zero.

    ``smallest`` are coefficients below which b is rounding: without noise, C would be as small.
    """
    covariance = covariance + np.diag(smallest**2)
    size = np.sqrt(np.diag(covariance))
    scaled = coefficients / size
    return float(scaled @ np.linalg.solve(covariance / np.outer(size, size), scaled))


def _simulation_error(problem: TwoInputProblem, parameters: Signal) -> Signal:
    """Return the plain simulation error without the nuisance terms, shape (n,)."""
    plain = TwoInputProblem(problem.period_s, problem.u, problem.y, problem.shape, WHITE)
    here = TwoInputEvaluation(plain, parameters)
    return here.without_nuisance(here.error[:, np.newaxis])[:, 0]


def _held_out_fit(found: TwoInputFit) -> float:
    """Return the fit on the last third of the record of a model of the first two.

    NaN if a part is unsuitable.
    """
    count = found.problem.y.size
    split = int(TRAINING_PART * count)
    try:
        trained = refit_part(found, 0, split).parameters
        rest = found.problem.part(split, count)
        return fit_percent(_simulation_error(rest, trained), rest.y - np.mean(rest.y))
    except (IdentificationError, np.linalg.LinAlgError):
        return float("nan")
