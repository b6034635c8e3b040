"""Output error: the parameters whose simulation comes nearest to the record (Levenberg-Marquardt, QR).

With white measurement noise this is the maximum-likelihood estimate, in closed loop too, because the input depends
on past noise only. With an autoregressive whitening polynomial it is the prediction-error estimate for
y = G u + noise / D.
"""

import numpy as np

from backend.identification.errors import NotConvergedError, UnstableModelError
from backend.identification.linearisation import Evaluation, Problem, least_squares, moved, triangle
from backend.identification.record import Signal

MAX_ITERATIONS = 40
FEW_ITERATIONS = 8
FINE = 1e-3
COARSE = 0.1
_FLOOR = 1e-11
_MAX_DAMPING = 1e8


def fit_output_error(problem: Problem, start: Signal, tolerance: float = FINE) -> Evaluation:
    """Minimise the output error from ``start``; the solution is the evaluation's ``parameters``.

    Stops when what is left to gain is below ``tolerance`` standard errors. Raises NotConvergedError,
    UnstableModelError.
    """
    found, converged = _descend(problem, start, tolerance, MAX_ITERATIONS)
    if not converged:
        name = problem.structure.name
        raise NotConvergedError(f"{name}: no minimum within {MAX_ITERATIONS} iterations; try a simpler structure")
    return found


def adapt(problem: Problem, start: Signal) -> Evaluation:
    """Improve parameters that are near already, to a tenth of their standard errors or in a few iterations."""
    return _descend(problem, start, COARSE, FEW_ITERATIONS)[0]


def _descend(problem: Problem, start: Signal, tolerance: float, iterations: int) -> tuple[Evaluation, bool]:
    here, damping = Evaluation(problem, start), 1e-3
    signal = float(np.linalg.norm(problem.whiten(problem.record.y)))
    for _ in range(iterations):
        factor, right = _normalised(here)
        remaining = float(np.linalg.norm(right))
        if remaining < tolerance * here.noise or remaining < _FLOOR * signal:
            return here, True
        while True:
            trial = _evaluated(problem, moved(here.parameters, _damped_step(factor, right, damping)))
            if trial is not None and trial.cost < here.cost:
                here, damping = trial, damping / 10.0
                break
            damping *= 5.0
            if damping > _MAX_DAMPING:
                return here, True
    return here, False


def _normalised(here: Evaluation) -> tuple[Signal, Signal]:
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


def _evaluated(problem: Problem, parameters: Signal) -> Evaluation | None:
    try:
        return Evaluation(problem, parameters)
    except UnstableModelError:
        return None
