"""From a record to parameters: which estimator runs, from where, and with which noise model."""

from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from backend.identification.excitation import NoiseFreeInput, noise_free_input
from backend.identification.linearisation import WHITE, Problem, Projected, projected
from backend.identification.noise import fit_autoregression
from backend.identification.output_error import NotConvergedError, fit_output_error
from backend.identification.record import Record, Signal
from backend.identification.refined_iv import fit_refined_iv
from backend.identification.residuals import input_correlation, whiteness
from backend.identification.response import UnstableModelError
from backend.identification.start import starting_values
from backend.identification.structures import Structure

_NOISE_ROUNDS = 6
_NOISE_SETTLED = 0.05
_STARTS_TRIED = 4


class Method(StrEnum):
    """Estimators to choose from.

    ``DEFAULT`` solves the refined-IV equation, closed-loop form where set point or controller are known, output
    error where they are not, and models the noise as autoregressive where the residuals are coloured by noise.
    ``SRIVC`` and ``OUTPUT_ERROR`` do without the noise model, ``RIVC`` insists on it.
    """

    DEFAULT = "default"
    SRIVC = "srivc"
    RIVC = "rivc"
    OUTPUT_ERROR = "output_error"


@dataclass(frozen=True)
class Fit:
    """Parameters, shape (p,), and how they were found; ``drive`` is None where the measured input serves."""

    problem: Problem
    parameters: Signal
    drive: NoiseFreeInput | None

    @property
    def method(self) -> str:
        """Name of the estimator that ran, for people."""
        order = self.problem.whitening.size - 1
        if self.drive is not None:
            return f"closed-loop RIVC, AR({order}) noise" if order else "closed-loop SRIVC"
        return f"output error, AR({order}) noise" if order else "output error"

    def test_input(self) -> Signal:
        """Input that the residuals must not depend on, whitened like them, shape (n,)."""
        u = self.problem.record.u if self.drive is None else self.drive(self.parameters)
        return self.problem.whiten(u)

    def linearised(self) -> Projected:
        """Whitened residuals, sensitivities and instruments at the solution."""
        return projected(self.problem, self.parameters, None if self.drive is None else self.drive(self.parameters))


def fit(record: Record, structure: Structure, method: Method) -> Fit:
    """Estimate the parameters. Raises NoStartError, NotConvergedError."""
    problem = Problem(record, structure, WHITE)
    drive = None if method is Method.OUTPUT_ERROR else noise_free_input(problem)
    first = _solve(problem, drive, starting_values(problem))
    if method in (Method.OUTPUT_ERROR, Method.SRIVC):
        return first
    residuals = first.linearised().residuals
    if method is Method.DEFAULT and whiteness(residuals, record.period_s).passed:
        return first
    coloured = _with_noise_model(first, residuals)
    if method is Method.RIVC:
        return coloured
    # Residuals that still follow the input come from missing dynamics, not from noise: whitening them would trade
    # accuracy at low frequency, where the model is used, for accuracy near the sampling rate.
    residuals = coloured.linearised().residuals
    slowest_s = float(coloured.problem.structure.denominator(coloured.parameters)[1])
    explained = input_correlation(residuals, coloured.test_input(), record.period_s, slowest_s).passed
    return coloured if explained else first


def refit(found: Fit, record: Record) -> Fit:
    """Estimate from another record with the same noise model, starting from what was found."""
    problem = replace(found.problem, record=record)
    return _solve(problem, None if found.drive is None else noise_free_input(problem), [found.parameters])


def _with_noise_model(first: Fit, residuals: Signal) -> Fit:
    found = first
    for _ in range(_NOISE_ROUNDS):
        problem = replace(first.problem, whitening=fit_autoregression(residuals))
        starts = starting_values(problem, found.parameters) if found is first else [found.parameters]
        improved = _solve(problem, None if first.drive is None else noise_free_input(problem), starts)
        change = improved.linearised().distance(found.parameters, improved.parameters)
        found = improved
        if change < _NOISE_SETTLED:
            break
        residuals = projected(first.problem, found.parameters, None).residuals
    return found


def _solve(problem: Problem, drive: NoiseFreeInput | None, starts: list[Signal]) -> Fit:
    """Run the estimator from the first of the best few starts from which it converges."""
    for start in starts[:_STARTS_TRIED]:
        try:
            parameters = fit_output_error(problem, start)
        except NotConvergedError as error:
            failure = error
            continue
        if drive is not None:
            try:
                return Fit(problem, fit_refined_iv(problem, parameters, drive), drive)
            except (NotConvergedError, UnstableModelError, np.linalg.LinAlgError):
                return Fit(problem, parameters, None)
        return Fit(problem, parameters, None)
    raise failure
