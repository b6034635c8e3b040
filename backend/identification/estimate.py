"""The estimators behind one call: from a record and a structure to a model with its quality."""

import numpy as np

from backend.identification.errors import IdentificationError, NotConvergedError
from backend.identification.fit import Fit, Method, fit
from backend.identification.frequency import check_frequency_response
from backend.identification.friction import both_ways, dry_friction
from backend.identification.output_error import adapt
from backend.identification.record import Record, Signal, coarse_resolution
from backend.identification.reduction import reduce_to_first_order
from backend.identification.result import DryFriction, Estimate, Model, Residuals
from backend.identification.structures import Structure, structure
from backend.identification.unseen import beside, held_out
from backend.identification.validation import Evidence, information_criteria, judge


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
    the output's sensor, found from the record where its values are few. Raises IdentificationError.
    """
    try:
        return _estimate(record, structure(structure_name), method, gain_geometry, y_resolution)
    except np.linalg.LinAlgError:
        raise NotConvergedError(
            f"{structure_name}: the record does not determine it; try a simpler structure"
        ) from None


def _estimate(
    record: Record, shape: Structure, method: Method, gain_geometry: float | None, y_resolution: float | None
) -> Estimate:
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
    fit_percent, fit_all_percent = _held_out_fit(found), beside(found.problem, found.parameters).fit_percent
    std_errors = dict(zip(shape.names, _standard_errors(covariance), strict=True))
    friction = _dry_friction(found, model)
    y_resolution = y_resolution or coarse_resolution(record.y)
    gain_error = None if gain_geometry is None else 100.0 * (model.gain / gain_geometry - 1.0)
    counts = None if y_resolution is None else float(np.ptp(record.y)) / y_resolution
    rounding = 100.0 * (y_resolution or 0.0) / float(np.sqrt(12.0) * np.std(record.y))
    evidence = Evidence(first_order, model, std_errors, fit_percent, residuals, gain_error, counts, rounding, friction)
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
    )


def _dry_friction(found: Fit, model: Model) -> DryFriction | None:
    """Compare friction with the linear model that simulates best: a noise model or a weighting gives up some of that.

    None where the record could not show any.
    """
    if not both_ways(found.problem.record.y):
        return None
    return dry_friction(found.problem.record, adapt(found.problem.unweighted, found.parameters).error, model.dead_time)


def _held_out_fit(found: Fit) -> float:
    """Fit on the last third of the record by a model of the first two thirds; NaN where one of them holds nothing."""
    try:
        return held_out(found).fit_percent
    except (IdentificationError, np.linalg.LinAlgError):
        return float("nan")


def _standard_errors(covariance: Signal) -> list[float]:
    """Square roots of the diagonal; NaN where rounding has eaten a variance."""
    variances = np.diag(covariance)
    return [float(std) for std in np.sqrt(np.where(variances > 0.0, variances, np.nan))]
