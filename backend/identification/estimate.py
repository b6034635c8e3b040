"""The estimators behind one call: from a record and a structure to a model with its quality."""

from dataclasses import replace

import numpy as np

from backend.identification.linearisation import WHITE, Problem
from backend.identification.output_error import fit_output_error
from backend.identification.record import Record, Signal
from backend.identification.reduction import reduce_to_first_order
from backend.identification.result import Estimate, Model
from backend.identification.start import starting_values
from backend.identification.structures import structure
from backend.identification.uncertainty import sandwich
from backend.identification.validation import fit_percent, judge, residual_tests

_TRAINING_PART = 2.0 / 3.0


def estimate(
    record: Record,
    structure_name: str,
    method: str = "default",
    *,
    gain_geometry: float | None = None,
    y_resolution: float | None = None,
) -> Estimate:
    """Identify the structure from the record.

    ``gain_geometry`` [unit of y / unit of u] is the static gain to compare with; ``y_resolution`` one count of
    the output's sensor. Raises StructureError, NoStartError, NotConvergedError.
    """
    shape = structure(structure_name)
    centred = replace(record, u=record.u - record.u[0], y=record.y - record.y[0])
    problem = Problem(centred, shape, WHITE)
    parameters = fit_output_error(problem, starting_values(centred, shape))
    return _assess(problem, parameters, method, gain_geometry, y_resolution)


def _assess(
    problem: Problem, parameters: Signal, method: str, gain_geometry: float | None, y_resolution: float | None
) -> Estimate:
    record = problem.record
    model = Model(problem.structure.name, dict(zip(problem.structure.names, parameters.tolist(), strict=True)))
    simulated = problem.simulated(parameters, record.u)
    sensitivities = problem.whiten(problem.sensitivities(parameters, record.u, simulated))
    basis = np.linalg.qr(problem.nuisance(parameters))[0]
    raw_error = record.y - simulated
    error = problem.whiten(raw_error)
    error = error - basis @ (basis.T @ error)
    sensitivities = sensitivities - basis @ (basis.T @ sensitivities)
    to_parameters = np.concatenate(([1.0], parameters[1:]))
    covariance = sandwich(sensitivities, sensitivities, error) * np.outer(to_parameters, to_parameters)
    first_order = reduce_to_first_order(model, covariance)
    residuals = residual_tests(error, record.u, record.period_s, first_order.T, parameters.size + basis.shape[1])
    gain_error = None if gain_geometry is None else 100.0 * (model.gain / gain_geometry - 1.0)
    held_out = _held_out_fit(problem, parameters)
    counts = None if y_resolution is None else float(np.ptp(record.y)) / y_resolution
    return Estimate(
        model=model,
        std_errors=dict(zip(problem.structure.names, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        covariance=covariance,
        method=method,
        fit_percent=held_out,
        fit_all_percent=_simulated_fit(problem, parameters),
        first_order=first_order,
        noise=tuple(problem.whitening[1:].tolist()),
        residuals=residuals,
        gain_geometry=gain_geometry,
        gain_error_percent=gain_error,
        verdict=judge(first_order, held_out, residuals, gain_error, counts),
    )


def _simulated_fit(problem: Problem, parameters: Signal) -> float:
    """Fit of the simulation with the nuisance terms of this record."""
    plain = replace(problem, whitening=WHITE)
    basis = np.linalg.qr(plain.nuisance(parameters))[0]
    error = plain.record.y - plain.simulated(parameters, plain.record.u)
    return fit_percent(plain.record.y, plain.record.y - (error - basis @ (basis.T @ error)))


def _held_out_fit(problem: Problem, parameters: Signal) -> float:
    """Fit on the last third of the record by a model of the first two thirds."""
    record = problem.record
    split = int(_TRAINING_PART * record.u.size)
    training = replace(problem, record=record.part(0, split))
    trained = fit_output_error(training, parameters)
    return _simulated_fit(replace(problem, record=record.part(split, record.u.size)), trained)
