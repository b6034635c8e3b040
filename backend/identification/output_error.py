"""Output error: the parameters whose simulation comes nearest to the record (Levenberg-Marquardt, QR).

With white measurement noise this is the maximum-likelihood estimate, in closed loop too, because the input depends
on past noise only. With an autoregressive whitening polynomial it is the prediction-error estimate for
y = G u + noise / D.
"""

import numpy as np

from backend.identification.linearisation import Problem, cost, moved, triangle
from backend.identification.record import Signal
from backend.identification.response import UnstableModelError

MAX_ITERATIONS = 60
_TOLERANCE = 1e-3
_FLOOR = 1e-11
_MAX_DAMPING = 1e8


class NotConvergedError(ValueError):
    """The iteration found no minimum; the record does not determine this structure."""


def fit_output_error(problem: Problem, start: Signal) -> Signal:
    """Minimise the output error from ``start``; parameters, shape (p,).

    Stops when the next step would be below a thousandth of the standard errors. Raises NotConvergedError.
    """
    parameters, damping = start, 1e-3
    signal = float(np.linalg.norm(problem.whiten(problem.record.y)))
    for _ in range(MAX_ITERATIONS):
        factor, right, here = _normalised(problem, parameters)
        remaining = float(np.linalg.norm(right))
        if remaining < _TOLERANCE * here / np.sqrt(problem.record.u.size) or remaining < _FLOOR * signal:
            return parameters
        while True:
            trial = moved(parameters, _damped_step(factor, right, damping))
            if _cost_or_inf(problem, trial) < here:
                parameters, damping = trial, damping / 10.0
                break
            damping *= 5.0
            if damping > _MAX_DAMPING:
                return parameters
    raise NotConvergedError(
        f"{problem.structure.name}: no minimum within {MAX_ITERATIONS} iterations; try a simpler structure"
    )


def _normalised(problem: Problem, parameters: Signal) -> tuple[Signal, Signal, float]:
    """Triangle of the sensitivities and matching right-hand side, nuisance projected out, and the cost."""
    record = problem.record
    simulated = problem.simulated(parameters, record.u)
    sensitivities = problem.whiten(problem.sensitivities(parameters, record.u, simulated))
    nuisance = problem.nuisance(parameters)
    error = problem.whiten(record.y - simulated)
    factor = triangle(np.column_stack((nuisance, sensitivities, error)))
    first, last = nuisance.shape[1], nuisance.shape[1] + parameters.size
    here = float(abs(factor[last, last]))
    right = factor[first:last, last]
    return factor[first:last, first:last], right, float(np.hypot(here, np.linalg.norm(right)))


def _damped_step(factor: Signal, right: Signal, damping: float) -> Signal:
    size = right.size
    weights = np.sqrt(damping) * np.linalg.norm(factor, axis=0)
    stacked = np.vstack((factor, np.diag(weights)))
    step = np.linalg.lstsq(stacked, np.concatenate((right, np.zeros(size))), rcond=None)[0]
    longest = float(np.max(np.abs(step[1:]), initial=0.0))
    return np.asarray(step * min(1.0, 1.5 / longest) if longest > 0.0 else step)


def _cost_or_inf(problem: Problem, parameters: Signal) -> float:
    try:
        return cost(problem, parameters)
    except (UnstableModelError, np.linalg.LinAlgError):
        return float("inf")
