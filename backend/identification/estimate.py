"""The estimators behind one call: from a record and a structure to a model with its quality."""

from dataclasses import replace

import numpy as np

from backend.identification.fit import Fit, Method, fit, refit
from backend.identification.frequency import check_frequency_response
from backend.identification.linearisation import Evaluation, Problem
from backend.identification.record import Record, Signal
from backend.identification.reduction import reduce_to_first_order
from backend.identification.result import Estimate, Model, Residuals
from backend.identification.structures import structure
from backend.identification.validation import information_criteria, judge

_TRAINING_PART = 2.0 / 3.0


def estimate(
    record: Record,
    structure_name: str,
    method: Method = Method.DEFAULT,
    *,
    gain_geometry: float | None = None,
    y_resolution: float | None = None,
) -> Estimate:
    """Identify the structure from the record.

    ``gain_geometry`` [unit of y / unit of u] is the static gain to compare with; ``y_resolution`` one count of
    the output's sensor. Raises IdentificationError.
    """
    shape = structure(structure_name)
    found = fit(record, shape, method)
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
    held_out = _held_out_fit(found)
    gain_error = None if gain_geometry is None else 100.0 * (model.gain / gain_geometry - 1.0)
    counts = None if y_resolution is None else float(np.ptp(record.y)) / y_resolution
    rounding = 100.0 * (y_resolution or 0.0) / float(np.sqrt(12.0) * np.std(record.y))
    return Estimate(
        model=model,
        std_errors=dict(zip(shape.names, np.sqrt(np.diag(covariance)).tolist(), strict=True)),
        covariance=covariance,
        method=found.method,
        fit_percent=held_out,
        fit_all_percent=_simulated_fit(found.problem, found.parameters),
        first_order=first_order,
        noise=tuple(found.problem.whitening[1:].tolist()),
        residuals=residuals,
        frequency=check_frequency_response(model, record),
        gain_geometry=gain_geometry,
        gain_error_percent=gain_error,
        verdict=judge(first_order, held_out, residuals, gain_error, counts, rounding),
    )


def _simulated_fit(problem: Problem, parameters: Signal) -> float:
    """Fit of the simulation with the nuisance terms of this record."""
    y = problem.record.y
    error = Evaluation(problem.unweighted, parameters).cost
    return 100.0 * (1.0 - error / float(np.linalg.norm(y - np.mean(y))))


def _held_out_fit(found: Fit) -> float:
    """Fit on the last third of the record by a model of the first two thirds."""
    record = found.problem.record
    split = int(_TRAINING_PART * record.u.size)
    trained = refit(found, record.part(0, split)).parameters
    return _simulated_fit(replace(found.problem, record=record.part(split, record.u.size)), trained)
