"""Fits of a structure to a record: ARX, output error, and refined instruments."""

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import TypeVar

import numpy as np

from backend.identification import messages
from backend.identification.excitation import NoiseFreeInput, noise_free_input
from backend.identification.initialization import (
    WHITE,
    FitEvaluation,
    FitProblem,
    ModelEvaluation,
    apply_step,
    difference,
    dominant_lag,
    initial_estimates,
    least_squares,
    thorough_starts,
    triangle,
)
from backend.identification.models import CorrelationTest, Poles, Structure
from backend.identification.records import (
    NotContinuousError,
    NotConvergedError,
    Record,
    Signal,
    StructureError,
    UnstableModelError,
)
from backend.identification.validation import fit_autoregression, input_correlation, sandwich, whiteness

# ARX -----------------------------------------------------------------------------------------------
# ARX, the paper's method: least squares on the equation error of a sampled model, after a low-pass on both signals.
#
# For comparison. At 1 ms the equation error weights changes from one sample to the next, a hundred times faster than
# the dynamics, so without the low-pass it models the sensor's noise; with it some bias remains (method section 4).


_SHARE = 1e-2
_FASTER = 3.0
_SETTLED_LAGS = 12.0


def fit_arx(problem: FitProblem, low_pass: bool = True) -> tuple[Signal, Signal]:
    """Return parameters, shape (p,), and covariance, shape (p, p).

    A(z) y = B(z) u + offset, both of the structure's order, by QR, on signals filtered by two lags of the record's
    dominant time constant divided by three. The zeros of B, which the structures lack, are dropped. ``low_pass`` False
    is the plain method, for comparison. Raises NotContinuousError.
    """
    record, order = problem.record, problem.structure.order
    u, y = record.u, record.y
    if low_pass:
        filter_samples = dominant_lag(problem) / (_FASTER * record.period_s)
        settled = min(u.size // 4, int(_SETTLED_LAGS * filter_samples))
        decay = float(np.exp(-1.0 / filter_samples))
        u, y = (_low_pass(decay, _low_pass(decay, signal))[settled:] for signal in (u, y))
    count = u.size - order
    past = [signal[order - lag : order - lag + count] for signal in (-y, u) for lag in range(1, order + 1)]
    columns = np.column_stack((*past, np.ones(count), y[order:]))
    factor = triangle(columns)
    coefficients = least_squares(factor[:-1, :-1], factor[:-1, -1])
    parameters = _continuous(problem, coefficients)
    regressors = columns[:, :-1]
    residuals = columns[:, -1] - regressors @ coefficients
    spread = _root(sandwich(regressors, regressors, residuals))
    moves = [(_continuous(problem, coefficients + _SHARE * move) - parameters) / _SHARE for move in spread.T]
    return parameters, np.asarray(np.transpose(moves) @ np.array(moves))


def continuous_poles(sampled: Poles, period_s: float) -> Poles:
    """Return the poles [rad/s] of the continuous system with these poles in z.

    A real pole at or below zero has no continuous counterpart of the same order, one outside the unit circle no stable
    one. Raises NotContinuousError.
    """
    real = np.abs(sampled.imag) <= 1e-9 * np.abs(sampled)
    if np.any(real & (sampled.real <= 0.0)) or np.any(np.abs(sampled) >= 1.0):
        raise NotContinuousError(messages.arx_not_continuous(poles=sampled))
    return np.asarray(np.log(sampled) / period_s)


def _low_pass(decay: float, signal: Signal) -> Signal:
    from scipy.signal import lfilter

    return np.asarray(lfilter([1.0 - decay], [1.0, -decay], signal))


def _continuous(problem: FitProblem, coefficients: Signal) -> Signal:
    order = problem.structure.order
    a, b = np.concatenate(([1.0], coefficients[:order])), coefficients[order : 2 * order]
    poles = continuous_poles(np.roots(a).astype(np.complex128), problem.record.period_s)
    descending = np.real(np.poly(poles))
    gain = float(np.sum(b) / np.sum(a))
    return problem.structure.from_denominator(gain, np.asarray(descending[::-1] / descending[-1]))


def _root(covariance: Signal) -> Signal:
    """Return independent columns that change the coefficients by one deviation."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


# Output error --------------------------------------------------------------------------------------
# Output error: the parameters with the least simulation error (Levenberg-Marquardt, QR).
#
# With white measurement noise this is the maximum-likelihood estimate, in closed loop too, because the input depends on
# past noise only. With an autoregressive whitening polynomial it is the prediction-error estimate for y = G u + noise /
# D.


MAX_ITERATIONS = 40
FEW_ITERATIONS = 8
FINE = 1e-3
COARSE = 0.1
_FLOOR = 1e-11
_MAX_DAMPING = 1e8

AnyEvaluation = TypeVar("AnyEvaluation", bound=ModelEvaluation)


def fit_output_error(problem: FitProblem, start: Signal, tolerance: float = FINE) -> FitEvaluation:
    """Minimise the output error from ``start``; return the evaluation of the minimum.

    Stops when the possible improvement is below ``tolerance`` standard errors. Raises NotConvergedError,
    UnstableModelError.
    """
    return minimize_output_error(FitEvaluation(problem, start), tolerance)


def minimize_output_error(start: AnyEvaluation, tolerance: float = FINE) -> AnyEvaluation:
    """Return the evaluation of the minimum, for any number of inputs.

    Raises NotConvergedError, UnstableModelError.
    """
    found, converged = _descend(start, tolerance, MAX_ITERATIONS)
    if not converged:
        raise NotConvergedError(messages.no_minimum_within(structure=start.structure.name, iterations=MAX_ITERATIONS))
    return found


def adapt(problem: FitProblem, start: Signal) -> FitEvaluation:
    """Improve good parameters to a tenth of their standard errors.

    The search ends after a few iterations in any case.
    """
    return adapt_evaluation(FitEvaluation(problem, start))


def adapt_evaluation(start: AnyEvaluation) -> AnyEvaluation:
    """Improve good parameters as :func:`adapt`, for any number of inputs."""
    return _descend(start, COARSE, FEW_ITERATIONS)[0]


def _descend(start: AnyEvaluation, tolerance: float, iterations: int) -> tuple[AnyEvaluation, bool]:
    here, damping, linear = start, 1e-3, start.linear
    signal = float(np.linalg.norm(start.output))
    for _ in range(iterations):
        factor, right = _factorise(here)
        remaining = float(np.linalg.norm(right))
        if remaining < tolerance * here.noise or remaining < _FLOOR * signal:
            return here, True
        while True:
            step = _damped_step(factor, right, damping, linear)
            trial = _evaluate(here, apply_step(here.parameters, step, linear))
            if trial is not None and trial.cost < here.cost:
                here, damping = trial, damping / 10.0
                break
            damping *= 5.0
            if damping > _MAX_DAMPING:
                return here, True
    return here, False


def _factorise(here: ModelEvaluation) -> tuple[Signal, Signal]:
    """Return triangle, shape (p, p), and right-hand side of the sensitivities.

    The nuisance terms are projected out.
    """
    first, size = here.nuisance.shape[1], here.parameters.size
    factor = triangle(np.column_stack((here.nuisance, here.sensitivities, here.error)))
    return factor[first : first + size, first : first + size], factor[first : first + size, first + size]


def _damped_step(factor: Signal, right: Signal, damping: float, linear: int) -> Signal:
    # Scaled columns: otherwise the unit of the output would decide which of them is negligible.
    size = np.linalg.norm(factor, axis=0)
    size[size == 0.0] = 1.0
    stacked = np.vstack((factor / size, np.sqrt(damping) * np.eye(size.size)))
    step = least_squares(stacked, np.concatenate((right, np.zeros(right.size)))) / size
    return np.asarray(step / max(1.0, float(np.max(np.abs(step[linear:]))) / 1.5))


def _evaluate(here: AnyEvaluation, parameters: Signal) -> AnyEvaluation | None:
    try:
        return here.move_to(parameters)
    except UnstableModelError:
        return None


# Refined IV ----------------------------------------------------------------------------------------
# Refined instrumental variables in continuous time: SRIVC, its closed-loop form, and RIVC with coloured noise.
#
# The estimate solves sum over k of Z_k(parameters) e_k(parameters) = 0, where e is the whitened output error and Z the
# derivative of the noise-free response to a noise-free input. With the measured input in Z this is SRIVC (Young and
# Jakeman 1980), with an input reconstructed from the external signal of the loop its closed-loop form (Gilson, Garnier,
# Young and Van den Hof 2008), with whitening RIVC. The iteration
#
#     parameters <- parameters + (Z' J)^-1 Z' e
#
# is the usual one written as an increment, with e computed from exact simulation. Its fixed point is the same, it needs
# no derivatives of the measured output, and it is valid for constrained structures as well.


def fit_refined_iv(start: AnyEvaluation, noise_free_input: NoiseFreeInput) -> AnyEvaluation:
    """Iterate from ``start`` to the solution.

    Raises NotConvergedError, UnstableModelError.
    """
    here, signal = start, float(np.linalg.norm(start.output))
    for _ in range(MAX_ITERATIONS):
        matrix, right = _equation(here, here.instruments(noise_free_input(here.parameters)))
        remaining = float(np.linalg.norm(right))
        if remaining < FINE * here.noise or remaining < _FLOOR * signal:
            return here
        here = _stable_step(here, least_squares(matrix, right))
    raise NotConvergedError(
        messages.refined_iv_not_converged(structure=start.structure.name, iterations=MAX_ITERATIONS)
    )


def _equation(here: ModelEvaluation, instruments: Signal) -> tuple[Signal, Signal]:
    """Return Q'J, shape (p, p), and Q'e.

    Q is an orthonormal basis of the instruments without nuisance.
    """
    first, size = here.nuisance.shape[1], here.parameters.size
    factor = triangle(np.column_stack((here.nuisance, instruments, here.sensitivities, here.error)))
    rows = slice(first, first + size)
    return factor[rows, first + size : first + 2 * size], factor[rows, -1]


def _stable_step(here: AnyEvaluation, step: Signal) -> AnyEvaluation:
    """Take the step, shortened to a factor e per parameter, halved until stable."""
    step = step / max(1.0, float(np.max(np.abs(step[here.linear :]))))
    for _ in range(30):
        try:
            return here.move_to(apply_step(here.parameters, step, here.linear))
        except UnstableModelError:
            step = step / 2.0
    raise NotConvergedError(messages.refined_iv_unstable(structure=here.structure.name))


# Fit -----------------------------------------------------------------------------------------------
# Parameters of a record: choice of the estimator, its starting values, and the noise model.


_NOISE_ROUNDS = 6
_NOISE_SETTLED = 0.05
_STARTS_TRIED = 3
_CLOSE = 1.1
_STEEPEST = 100.0


class Method(StrEnum):
    """Estimators.

    ``DEFAULT`` is used for experiments and files alike. It solves the refined-IV equation in its closed-loop form if
    setpoint or controller is known, else output error. Coloured residuals, from noise or friction, are modelled as
    autoregressive. If the residuals still correlate with the input, the structure cannot describe the system, and low
    frequencies are weighted. ``SRIVC`` and ``OUTPUT_ERROR`` omit both, ``RIVC`` always uses the noise model,
    ``LOW_FREQUENCY`` is output error with that weighting. ``ARX`` is the paper's method.
    """

    DEFAULT = "default"
    SRIVC = "srivc"
    RIVC = "rivc"
    OUTPUT_ERROR = "output_error"
    LOW_FREQUENCY = "low_frequency"
    ARX = "arx"


@dataclass(frozen=True)
class Fit:
    """A solution and its method.

    ``drive`` is None if the measured input serves as instrument; ``arx_covariance`` is set if the parameters come from
    ARX.
    """

    solution: FitEvaluation
    drive: NoiseFreeInput | None
    arx_covariance: Signal | None = None

    @property
    def problem(self) -> FitProblem:
        """Record, structure and noise model of the solution."""
        return self.solution.problem

    @property
    def parameters(self) -> Signal:
        """Parameters of the solution, shape (p,)."""
        return self.solution.parameters

    @property
    def method(self) -> str:
        """Name of the estimator for people."""
        if self.arx_covariance is not None:
            return messages.arx_with_prefilter()
        noise_order, is_low_pass = self.problem.whitening.size - 1, bool(self.problem.low_pass)
        if self.drive is not None:
            return messages.refined_iv_in_closed_loop(noise_order=noise_order, is_low_pass=is_low_pass)
        return messages.output_error(noise_order=noise_order, is_low_pass=is_low_pass)

    @cached_property
    def residuals(self) -> Signal:
        """Whitened output error without the nuisance terms, shape (n,)."""
        return self.solution.without_nuisance(self.solution.error[:, np.newaxis])[:, 0]

    @cached_property
    def prediction_errors(self) -> Signal:
        """Residuals without the low-pass, from ``first`` on, for tests and comparisons."""
        residuals = self.residuals
        if self.problem.low_pass:
            plain = FitEvaluation(replace(self.problem, low_pass=0.0), self.parameters)
            residuals = plain.without_nuisance(plain.error[:, np.newaxis])[:, 0]
        return residuals[self.problem.first :]

    @cached_property
    def covariance(self) -> Signal:
        """Covariance of the parameters, shape (p, p), robust to coloured residuals."""
        if self.arx_covariance is not None:
            return self.arx_covariance
        sensitivities = instruments = self.solution.without_nuisance(self.solution.sensitivities)
        if self.drive is not None:
            clean = self.drive(self.parameters)
            instruments = self.solution.without_nuisance(self.solution.instruments(clean))
        if self.problem.structure.delayed:
            # A response that flips within a hundred-thousandth of a parameter has no derivative.
            y = self.problem.record.y
            if np.max(np.linalg.norm(sensitivities[:, 1:], axis=0)) > _STEEPEST * np.linalg.norm(y - np.mean(y)):
                return np.full((self.parameters.size, self.parameters.size), np.nan)
        scale = np.concatenate(([1.0], self.parameters[1:]))
        return np.asarray(sandwich(instruments, sensitivities, self.residuals) * np.outer(scale, scale))

    def input_correlation(self) -> CorrelationTest:
        """Test whether the residuals depend on the input, over five times the sum of lags."""
        record = self.problem.record
        u = record.u if self.drive is None else self.drive(self.parameters)
        whitened = replace(self.problem, low_pass=0.0, first=0).whiten(u)[self.problem.first :]
        sum_of_lags = self.problem.structure.sum_of_lags(self.parameters)
        return input_correlation(self.prediction_errors, whitened, record.period_s, sum_of_lags)

    def whiteness(self) -> CorrelationTest:
        """Test whether the residuals are white."""
        return whiteness(self.prediction_errors, self.problem.record.period_s)


def fit_parameters(record: Record, structure: Structure, method: Method) -> Fit:
    """Estimate the parameters.

    Raises NoStartError, NotConvergedError, NotContinuousError, StructureError.
    """
    problem = FitProblem(record, structure, WHITE)
    if structure.delayed:
        _check_dead_time(structure, record, method)
    if method is Method.ARX:
        return _arx(problem)
    drive = None if method in (Method.OUTPUT_ERROR, Method.LOW_FREQUENCY) else noise_free_input(problem)
    first = _from_starts(problem, drive)
    if method in (Method.OUTPUT_ERROR, Method.SRIVC):
        return first
    if method is Method.LOW_FREQUENCY:
        return first if _is_explanation(first) else _low_frequency(first)
    if method is Method.DEFAULT and first.whiteness().passed:
        return first
    if method is Method.RIVC:
        return _with_noise_model(first)
    try:
        coloured = _with_noise_model(first)
    except (NotConvergedError, UnstableModelError):
        return _low_frequency(first)
    # Residuals that still correlate with the input come from missing dynamics, not from noise: whitening them would
    # trade accuracy at low frequency, where the model is used, for accuracy near the sampling rate.
    if coloured.input_correlation().passed:
        return coloured
    return first if first.input_correlation().passed else _low_frequency(first)


def _check_dead_time(structure: Structure, record: Record, method: Method) -> None:
    """Raise StructureError where a dead time cannot be identified.

    ARX and the closed-loop form with a controller support none.
    """
    if method is Method.ARX:
        raise StructureError(messages.dead_time_with_arx(structure=structure.name))
    if record.controller is not None:
        raise StructureError(messages.dead_time_with_controller(structure=structure.name))


def refit(found: Fit, record: Record) -> FitEvaluation:
    """Adapt a solution to another record, by output error with the same noise model.

    Raises NotContinuousError.
    """
    problem = replace(found.problem, record=record)
    if found.arx_covariance is not None:
        return _arx(problem).solution
    return adapt(problem, found.parameters)


def _arx(problem: FitProblem) -> Fit:
    parameters, covariance = fit_arx(problem)
    return Fit(FitEvaluation(problem, parameters), None, covariance)


def _with_noise_model(first: Fit) -> Fit:
    """Alternate between the parameters and the noise model until they converge."""
    found = first
    for _ in range(_NOISE_ROUNDS):
        problem = replace(first.problem, whitening=fit_autoregression(_without_whitening(found).residuals))
        drive = None if first.drive is None else noise_free_input(problem)
        before = found
        found = _solve(problem, drive, before.parameters)
        if before is first and not found.input_correlation().passed:
            # Under the noise the first solution may be in a local minimum that the whitened one shows to be wrong.
            found = _from_starts(problem, drive, before.parameters)
        step = difference(before.parameters, found.parameters)
        change = float(np.linalg.norm(found.solution.without_nuisance(found.solution.sensitivities) @ step))
        if change < _NOISE_SETTLED * found.solution.noise:
            break
    return found


def _low_frequency(first: Fit) -> Fit:
    """Solve again with both signals filtered by the model's sum of lags.

    Dynamics that the structure cannot describe then cause errors at high frequency rather than in gain and lag, which
    tuning uses.
    """
    sum_of_lags = float(first.problem.structure.denominator(first.parameters)[1])
    low_pass = float(np.exp(-first.problem.record.period_s / sum_of_lags))
    try:
        return _solve(replace(first.problem, low_pass=low_pass), first.drive, first.parameters)
    except (NotConvergedError, UnstableModelError):
        return first


def _without_whitening(found: Fit) -> Fit:
    return Fit(FitEvaluation(replace(found.problem, whitening=WHITE), found.parameters), found.drive)


def _from_starts(problem: FitProblem, drive: NoiseFreeInput | None, *further: Signal) -> Fit:
    """Solve from quick starting values, and from thorough ones if not white.

    Residuals uncorrelated with the input are not enough: in a wrong minimum they may look like coloured noise.
    """
    starts = initial_estimates(problem, *further)
    problem = skip_initial_samples(problem, starts[:_STARTS_TRIED])
    found = _first_converged(problem, starts, FINE if drive is None else COARSE)
    if problem.structure.order >= 3 and (found is None or not Fit(found, drive).whiteness().passed):
        # A start that simulates as well as the improved solution is near a better minimum.
        bound = np.inf if found is None else _CLOSE * found.cost
        better = [start for error, start in thorough_starts(problem) if error < bound]
        other = _first_converged(problem, better, FINE)
        if other is not None and (found is None or other.cost < found.cost):
            found = other
    if found is None:
        raise NotConvergedError(messages.no_minimum_found(structure=problem.structure.name))
    return _with_instruments(found, drive)


def _is_explanation(found: Fit) -> bool:
    """Return whether the residuals are independent of the input; quick test first."""
    return found.whiteness().passed or found.input_correlation().passed


def skip_initial_samples(problem: FitProblem, starts: list[Signal]) -> FitProblem:
    """Omit samples that may depend on inputs before the record.

    Their number is the largest expected dead time: twice the starting value, and half of the lags, which may contain
    it.
    """
    shape, period_s = problem.structure, problem.record.period_s
    if not shape.delayed or problem.first:
        return problem
    longest = max(2.0 * shape.dead_time(start) + 0.5 * shape.sum_of_lags(start) for start in starts)
    return replace(problem, first=min(problem.record.u.size // 4, int(longest / period_s) + 2))


def _first_converged(problem: FitProblem, starts: list[Signal], tolerance: float) -> FitEvaluation | None:
    """Return the first start that converges; with a dead time the best of them.

    A dead time causes many local minima.
    """
    best = None
    for start in starts[:_STARTS_TRIED]:
        try:
            found = fit_output_error(problem, start, tolerance)
        except (NotConvergedError, UnstableModelError):
            continue
        if best is None or found.cost < best.cost:
            best = found
        if not problem.structure.delayed:
            break
    return best


def _solve(problem: FitProblem, drive: NoiseFreeInput | None, start: Signal) -> Fit:
    return _with_instruments(fit_output_error(problem, start, FINE if drive is None else COARSE), drive)


def _with_instruments(near: FitEvaluation, drive: NoiseFreeInput | None) -> Fit:
    """Continue with refined IV if there are instruments; if it fails, output error."""
    if drive is None:
        return Fit(near, None)
    try:
        return Fit(fit_refined_iv(near, drive), drive)
    except (NotConvergedError, UnstableModelError):
        return Fit(fit_output_error(near.problem, near.parameters), None)
