"""Fits a structure to a record: ARX, output error, and refined instrumental variables."""

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from backend.identification.excitation import NoiseFreeInput, noise_free_input
from backend.identification.initialization import (
    WHITE,
    FitEvaluation,
    FitProblem,
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
#
# ARX, the paper's method: least squares on the equation error of a sampled model, after a low-pass
# on both signals.
#
# Kept for comparison. At 1 ms the equation error weighs what happens from one sample to the next, a
# hundred times faster than the dynamics, so without the low-pass it returns the sensor's noise;
# with it some bias remains (method section 4).


_SHARE = 1e-2
_FASTER = 3.0
_SETTLED_LAGS = 12.0


def fit_arx(problem: FitProblem, low_pass: bool = True) -> tuple[Signal, Signal]:
    """Parameters, shape (p,), and their covariance, shape (p, p). Raises NotContinuousError.

    A(z) y = B(z) u + offset with both of the structure's order, by QR, on signals that passed two lags of the
    record's dominant time constant divided by three. The zeros of B, which the structures do not have, are dropped.
    Without ``low_pass`` it is the plain method, for comparison.
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
    """Poles [rad/s] of the continuous system with these poles in z. Raises NotContinuousError.

    A real pole at or below zero has no continuous counterpart of the same order, one outside the unit circle no
    stable one.
    """
    real = np.abs(sampled.imag) <= 1e-9 * np.abs(sampled)
    if np.any(real & (sampled.real <= 0.0)) or np.any(np.abs(sampled) >= 1.0):
        shown = np.array2string(sampled, precision=4)
        raise NotContinuousError(
            f"the ARX poles z = {shown} belong to no stable continuous system: filter more, or choose another estimator"
        )
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
    """Columns that each move the coefficients by a standard deviation, in independent directions."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


# Output error --------------------------------------------------------------------------------------
#
# Output error: the parameters whose simulation comes nearest to the record (Levenberg-Marquardt,
# QR).
#
# With white measurement noise this is the maximum-likelihood estimate, in closed loop too, because
# the input depends on past noise only. With an autoregressive whitening polynomial it is the
# prediction-error estimate for y = G u + noise / D.


MAX_ITERATIONS = 40
FEW_ITERATIONS = 8
FINE = 1e-3
COARSE = 0.1
_FLOOR = 1e-11
_MAX_DAMPING = 1e8


def fit_output_error(problem: FitProblem, start: Signal, tolerance: float = FINE) -> FitEvaluation:
    """Minimise the output error from ``start``; the solution is the evaluation's ``parameters``.

    Stops when what is left to gain is below ``tolerance`` standard errors. Raises NotConvergedError,
    UnstableModelError.
    """
    found, converged = _descend(problem, start, tolerance, MAX_ITERATIONS)
    if not converged:
        name = problem.structure.name
        raise NotConvergedError(f"{name}: no minimum within {MAX_ITERATIONS} iterations; try a simpler structure")
    return found


def adapt(problem: FitProblem, start: Signal) -> FitEvaluation:
    """Improve parameters that are near already, to a tenth of their standard errors or in a few iterations."""
    return _descend(problem, start, COARSE, FEW_ITERATIONS)[0]


def _descend(problem: FitProblem, start: Signal, tolerance: float, iterations: int) -> tuple[FitEvaluation, bool]:
    here, damping = FitEvaluation(problem, start), 1e-3
    signal = float(np.linalg.norm(problem.whiten(problem.record.y)))
    for _ in range(iterations):
        factor, right = _factorise(here)
        remaining = float(np.linalg.norm(right))
        if remaining < tolerance * here.noise or remaining < _FLOOR * signal:
            return here, True
        while True:
            trial = _evaluate(problem, apply_step(here.parameters, _damped_step(factor, right, damping)))
            if trial is not None and trial.cost < here.cost:
                here, damping = trial, damping / 10.0
                break
            damping *= 5.0
            if damping > _MAX_DAMPING:
                return here, True
    return here, False


def _factorise(here: FitEvaluation) -> tuple[Signal, Signal]:
    """Triangle of the sensitivities, shape (p, p), and matching right-hand side, nuisance projected out."""
    first, size = here.nuisance.shape[1], here.parameters.size
    factor = triangle(np.column_stack((here.nuisance, here.sensitivities, here.error)))
    return factor[first : first + size, first : first + size], factor[first : first + size, first + size]


def _damped_step(factor: Signal, right: Signal, damping: float) -> Signal:
    # Columns of one size: else the unit of the output would decide which of them is too small to count.
    size = np.linalg.norm(factor, axis=0)
    size[size == 0.0] = 1.0
    stacked = np.vstack((factor / size, np.sqrt(damping) * np.eye(size.size)))
    step = least_squares(stacked, np.concatenate((right, np.zeros(right.size)))) / size
    return np.asarray(step / max(1.0, float(np.max(np.abs(step[1:]))) / 1.5))


def _evaluate(problem: FitProblem, parameters: Signal) -> FitEvaluation | None:
    try:
        return FitEvaluation(problem, parameters)
    except UnstableModelError:
        return None


# Refined IV ----------------------------------------------------------------------------------------
#
# Refined instrumental variables in continuous time: SRIVC, its closed-loop form, and RIVC with
# coloured noise.
#
# The estimate solves sum over k of Z_k(parameters) e_k(parameters) = 0, where e is the whitened
# output error and Z the derivative of the noise-free response to a noise-free input. With the
# measured input in Z this is SRIVC (Young and Jakeman 1980), with an input rebuilt from what enters
# the loop from outside it is its closed-loop form (Gilson, Garnier, Young and Van den Hof 2008),
# with whitening it is RIVC. The iteration
#
#     parameters <- parameters + (Z' J)^-1 Z' e
#
# is the usual one written as an increment, with e computed from exact simulation. Its fixed point
# is the same, it needs no derivatives of the measured output, and it serves constrained structures
# as well.


def fit_refined_iv(start: FitEvaluation, noise_free_input: NoiseFreeInput) -> FitEvaluation:
    """Iterate from ``start`` to the solution. Raises NotConvergedError, UnstableModelError."""
    here, signal = start, float(np.linalg.norm(start.problem.whiten(start.problem.record.y)))
    for _ in range(MAX_ITERATIONS):
        matrix, right = _equation(here, here.instruments(noise_free_input(here.parameters)))
        remaining = float(np.linalg.norm(right))
        if remaining < FINE * here.noise or remaining < _FLOOR * signal:
            return here
        here = _stable_step(here, least_squares(matrix, right))
    name = start.problem.structure.name
    raise NotConvergedError(f"{name}: refined IV did not settle within {MAX_ITERATIONS} iterations")


def _equation(here: FitEvaluation, instruments: Signal) -> tuple[Signal, Signal]:
    """Q'J, shape (p, p), and Q'e, where Q is an orthonormal basis of the instruments without nuisance."""
    first, size = here.nuisance.shape[1], here.parameters.size
    factor = triangle(np.column_stack((here.nuisance, instruments, here.sensitivities, here.error)))
    rows = slice(first, first + size)
    return factor[rows, first + size : first + 2 * size], factor[rows, -1]


def _stable_step(here: FitEvaluation, step: Signal) -> FitEvaluation:
    """Take the step, shortened to a factor e per parameter and halved until the model is stable."""
    step = step / max(1.0, float(np.max(np.abs(step[1:]))))
    for _ in range(30):
        try:
            return FitEvaluation(here.problem, apply_step(here.parameters, step))
        except UnstableModelError:
            step = step / 2.0
    raise NotConvergedError(f"{here.problem.structure.name}: refined IV leads to an unstable model")


# Fit -----------------------------------------------------------------------------------------------
#
# From a record to parameters: which estimator runs, from where, and with which noise model.


_NOISE_ROUNDS = 6
_NOISE_SETTLED = 0.05
_STARTS_TRIED = 3
_CLOSE = 1.1
_STEEPEST = 100.0


class Method(StrEnum):
    """Estimators to choose from.

    ``DEFAULT`` is what experiments and files are identified by alike. It solves the refined-IV equation in its
    closed-loop form where set point or controller are known, output error where they are not. Coloured residuals, of
    noise or of friction, are modelled as autoregressive. Where the residuals follow the input even so, the structure
    cannot carry the system, and low frequencies are weighted.
    ``SRIVC`` and ``OUTPUT_ERROR`` do without either, ``RIVC`` insists on the noise model, ``LOW_FREQUENCY`` is output
    error with that weighting. ``ARX`` is the paper's method.
    """

    DEFAULT = "default"
    SRIVC = "srivc"
    RIVC = "rivc"
    OUTPUT_ERROR = "output_error"
    LOW_FREQUENCY = "low_frequency"
    ARX = "arx"


@dataclass(frozen=True)
class Fit:
    """A solution and how it was found.

    ``drive`` is None where the measured input serves as instrument; ``arx_covariance`` is there where the parameters
    come from ARX.
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
        """Name of the estimator that ran, for people."""
        if self.arx_covariance is not None:
            return "ARX with low-pass prefilter"
        order = self.problem.whitening.size - 1
        noise = f", AR({order}) noise" if order else ""
        weighting = ", low frequencies weighted" if self.problem.low_pass else ""
        if self.drive is not None:
            return f"closed-loop {'RIVC' if order else 'SRIVC'}{noise}{weighting}"
        return f"output error{noise}{weighting}"

    @cached_property
    def residuals(self) -> Signal:
        """Whitened output error without the nuisance terms, shape (n,)."""
        return self.solution.without_nuisance(self.solution.error[:, np.newaxis])[:, 0]

    @cached_property
    def prediction_errors(self) -> Signal:
        """The same without the low-pass, from ``first`` on: what is tested and what models are compared by."""
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
            # A response that a hundred-thousandth of a parameter turns over has no derivative: nothing is measured.
            y = self.problem.record.y
            if np.max(np.linalg.norm(sensitivities[:, 1:], axis=0)) > _STEEPEST * np.linalg.norm(y - np.mean(y)):
                return np.full((self.parameters.size, self.parameters.size), np.nan)
        scale = np.concatenate(([1.0], self.parameters[1:]))
        return np.asarray(sandwich(instruments, sensitivities, self.residuals) * np.outer(scale, scale))

    def input_correlation(self) -> CorrelationTest:
        """Test whether the residuals still depend on the input, over five times the sum of lags."""
        record = self.problem.record
        u = record.u if self.drive is None else self.drive(self.parameters)
        whitened = replace(self.problem, low_pass=0.0, first=0).whiten(u)[self.problem.first :]
        sum_of_lags = self.problem.structure.sum_of_lags(self.parameters)
        return input_correlation(self.prediction_errors, whitened, record.period_s, sum_of_lags)

    def whiteness(self) -> CorrelationTest:
        """Test whether the residuals are white."""
        return whiteness(self.prediction_errors, self.problem.record.period_s)


def fit_parameters(record: Record, structure: Structure, method: Method) -> Fit:
    """Estimate the parameters. Raises NoStartError, NotConvergedError, NotContinuousError, StructureError."""
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
    # Residuals that still follow the input come from missing dynamics, not from noise: whitening them would trade
    # accuracy at low frequency, where the model is used, for accuracy near the sampling rate.
    if coloured.input_correlation().passed:
        return coloured
    return first if first.input_correlation().passed else _low_frequency(first)


def _check_dead_time(structure: Structure, record: Record, method: Method) -> None:
    """Refuse what is not there: ARX and the closed-loop form by the controller know no dead time."""
    if method is Method.ARX or record.controller is not None:
        instead = "another method" if method is Method.ARX else "--setpoint in place of --controller"
        raise StructureError(f"{structure.name} has a dead time, which cannot be found in this way: use {instead}")


def refit(found: Fit, record: Record) -> FitEvaluation:
    """Adapt what was found to another record, by output error with the same noise model. Raises NotContinuousError."""
    problem = replace(found.problem, record=record)
    if found.arx_covariance is not None:
        return _arx(problem).solution
    return adapt(problem, found.parameters)


def _arx(problem: FitProblem) -> Fit:
    parameters, covariance = fit_arx(problem)
    return Fit(FitEvaluation(problem, parameters), None, covariance)


def _with_noise_model(first: Fit) -> Fit:
    """Alternate between the parameters and the noise model until they settle."""
    found = first
    for _ in range(_NOISE_ROUNDS):
        problem = replace(first.problem, whitening=fit_autoregression(_without_whitening(found).residuals))
        drive = None if first.drive is None else noise_free_input(problem)
        before = found
        found = _solve(problem, drive, before.parameters)
        if before is first and not found.input_correlation().passed:
            # Under the noise the first solution may have settled in a valley that the whitened one shows to be wrong.
            found = _from_starts(problem, drive, before.parameters)
        step = difference(before.parameters, found.parameters)
        change = float(np.linalg.norm(found.solution.without_nuisance(found.solution.sensitivities) @ step))
        if change < _NOISE_SETTLED * found.solution.noise:
            break
    return found


def _low_frequency(first: Fit) -> Fit:
    """Solve again with both signals passed through the model's sum of lags.

    What the structure cannot carry is then wrong at high frequency rather than in gain and lag, which tuning uses.
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
    """Solve from quick starting values, and from thorough ones where the residuals are not white.

    That they do not follow the input is not enough: a wrong valley may leave over what looks like coloured noise.
    """
    starts = initial_estimates(problem, *further)
    problem = skip_initial_samples(problem, starts[:_STARTS_TRIED])
    found = _first_converged(problem, starts, FINE if drive is None else COARSE)
    if problem.structure.order >= 3 and (found is None or not Fit(found, drive).whiteness().passed):
        # A start that simulates about as well as the solution before it was improved lies in a better valley.
        bound = np.inf if found is None else _CLOSE * found.cost
        better = [start for error, start in thorough_starts(problem) if error < bound]
        other = _first_converged(problem, better, FINE)
        if other is not None and (found is None or other.cost < found.cost):
            found = other
    if found is None:
        raise NotConvergedError(f"{problem.structure.name}: no minimum found; try a simpler structure")
    return _with_instruments(found, drive)


def _is_explanation(found: Fit) -> bool:
    """Whether nothing of the input is left in the residuals; the quick test first."""
    return found.whiteness().passed or found.input_correlation().passed


def skip_initial_samples(problem: FitProblem, starts: list[Signal]) -> FitProblem:
    """Leave out samples that may come from inputs before the record.

    They are as many as the dead time may become: twice what it starts from, and half of the lags, which may hide it.
    """
    shape, period_s = problem.structure, problem.record.period_s
    if not shape.delayed or problem.first:
        return problem
    longest = max(2.0 * shape.dead_time(start) + 0.5 * shape.sum_of_lags(start) for start in starts)
    return replace(problem, first=min(problem.record.u.size // 4, int(longest / period_s) + 2))


def _first_converged(problem: FitProblem, starts: list[Signal], tolerance: float) -> FitEvaluation | None:
    """Take the first start that leads anywhere; with a dead time, whose valleys are many, the best of them."""
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
    """Go on to refined IV where there are instruments; where it fails, output error has the last word."""
    if drive is None:
        return Fit(near, None)
    try:
        return Fit(fit_refined_iv(near, drive), drive)
    except (NotConvergedError, UnstableModelError):
        return Fit(fit_output_error(near.problem, near.parameters), None)
