"""Refined instrumental variables in continuous time: SRIVC, its closed-loop form, and RIVC with coloured noise.

The estimate solves  sum over k of Z_k(parameters) e_k(parameters) = 0,  where e is the whitened output error and Z
the derivative of the noise-free response to a noise-free input. With the measured input in Z this is SRIVC (Young and
Jakeman 1980), with an input rebuilt from what enters the loop from outside it is its closed-loop form (Gilson,
Garnier, Young and Van den Hof 2008), with whitening it is RIVC. The iteration

    parameters <- parameters + (Z' J)^-1 Z' e

is the usual one written as an increment, with e computed from exact simulation. Its fixed point is the same, it
needs no derivatives of the measured output, and it serves constrained structures as well.
"""

import numpy as np

from backend.identification.errors import NotConvergedError, UnstableModelError
from backend.identification.excitation import NoiseFreeInput
from backend.identification.linearisation import Evaluation, least_squares, moved, triangle
from backend.identification.output_error import FINE
from backend.identification.record import Signal

MAX_ITERATIONS = 40
_FLOOR = 1e-11


def fit_refined_iv(start: Evaluation, noise_free_input: NoiseFreeInput) -> Evaluation:
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


def _equation(here: Evaluation, instruments: Signal) -> tuple[Signal, Signal]:
    """Q'J, shape (p, p), and Q'e, where Q is an orthonormal basis of the instruments without nuisance."""
    first, size = here.nuisance.shape[1], here.parameters.size
    factor = triangle(np.column_stack((here.nuisance, instruments, here.sensitivities, here.error)))
    rows = slice(first, first + size)
    return factor[rows, first + size : first + 2 * size], factor[rows, -1]


def _stable_step(here: Evaluation, step: Signal) -> Evaluation:
    """Take the step, shortened to a factor e per parameter and halved until the model is stable."""
    step = step / max(1.0, float(np.max(np.abs(step[1:]))))
    for _ in range(30):
        try:
            return Evaluation(here.problem, moved(here.parameters, step))
        except UnstableModelError:
            step = step / 2.0
    raise NotConvergedError(f"{here.problem.structure.name}: refined IV leads to an unstable model")
