"""From a record to parameters: which estimator runs, from where, and with which noise model."""

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property

import numpy as np

from backend.identification.arx import fit_arx
from backend.identification.errors import NotConvergedError, StructureError, UnstableModelError
from backend.identification.excitation import NoiseFreeInput, noise_free_input
from backend.identification.linearisation import WHITE, Evaluation, Problem, difference
from backend.identification.noise import fit_autoregression
from backend.identification.output_error import COARSE, FINE, adapt, fit_output_error
from backend.identification.record import Record, Signal
from backend.identification.refined_iv import fit_refined_iv
from backend.identification.residuals import input_correlation, whiteness
from backend.identification.result import CorrelationTest
from backend.identification.start import quick_starts, thorough_starts
from backend.identification.structures import Structure
from backend.identification.uncertainty import sandwich

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

    solution: Evaluation
    drive: NoiseFreeInput | None
    arx_covariance: Signal | None = None

    @property
    def problem(self) -> Problem:
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
            plain = Evaluation(replace(self.problem, low_pass=0.0), self.parameters)
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


def fit(record: Record, structure: Structure, method: Method) -> Fit:
    """Estimate the parameters. Raises NoStartError, NotConvergedError, NotContinuousError, StructureError."""
    problem = Problem(record, structure, WHITE)
    if structure.delayed:
        _check_dead_time(structure, record, method)
    if method is Method.ARX:
        return _arx(problem)
    drive = None if method in (Method.OUTPUT_ERROR, Method.LOW_FREQUENCY) else noise_free_input(problem)
    first = _from_starts(problem, drive)
    if method in (Method.OUTPUT_ERROR, Method.SRIVC):
        return first
    if method is Method.LOW_FREQUENCY:
        return first if _explains(first) else _low_frequency(first)
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


def refit(found: Fit, record: Record) -> Evaluation:
    """Adapt what was found to another record, by output error with the same noise model. Raises NotContinuousError."""
    problem = replace(found.problem, record=record)
    if found.arx_covariance is not None:
        return _arx(problem).solution
    return adapt(problem, found.parameters)


def _arx(problem: Problem) -> Fit:
    parameters, covariance = fit_arx(problem)
    return Fit(Evaluation(problem, parameters), None, covariance)


def _with_noise_model(first: Fit) -> Fit:
    """Alternate between the parameters and the noise model until they settle."""
    found = first
    for _ in range(_NOISE_ROUNDS):
        problem = replace(first.problem, whitening=fit_autoregression(_unwhitened(found).residuals))
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


def _unwhitened(found: Fit) -> Fit:
    return Fit(Evaluation(replace(found.problem, whitening=WHITE), found.parameters), found.drive)


def _from_starts(problem: Problem, drive: NoiseFreeInput | None, *further: Signal) -> Fit:
    """Solve from quick starting values, and from thorough ones where the residuals are not white.

    That they do not follow the input is not enough: a wrong valley may leave over what looks like coloured noise.
    """
    starts = quick_starts(problem, *further)
    problem = with_room(problem, starts[:_STARTS_TRIED])
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


def _explains(found: Fit) -> bool:
    """Whether nothing of the input is left in the residuals; the quick test first."""
    return found.whiteness().passed or found.input_correlation().passed


def with_room(problem: Problem, starts: list[Signal]) -> Problem:
    """Leave out samples that may come from inputs before the record.

    They are as many as the dead time may become: twice what it starts from, and half of the lags, which may hide it.
    """
    shape, period_s = problem.structure, problem.record.period_s
    if not shape.delayed or problem.first:
        return problem
    longest = max(2.0 * shape.dead_time(start) + 0.5 * shape.sum_of_lags(start) for start in starts)
    return replace(problem, first=min(problem.record.u.size // 4, int(longest / period_s) + 2))


def _first_converged(problem: Problem, starts: list[Signal], tolerance: float) -> Evaluation | None:
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


def _solve(problem: Problem, drive: NoiseFreeInput | None, start: Signal) -> Fit:
    return _with_instruments(fit_output_error(problem, start, FINE if drive is None else COARSE), drive)


def _with_instruments(near: Evaluation, drive: NoiseFreeInput | None) -> Fit:
    """Go on to refined IV where there are instruments; where it fails, output error has the last word."""
    if drive is None:
        return Fit(near, None)
    try:
        return Fit(fit_refined_iv(near, drive), drive)
    except (NotConvergedError, UnstableModelError):
        return Fit(fit_output_error(near.problem, near.parameters), None)
