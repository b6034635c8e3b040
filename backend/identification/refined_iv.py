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

from backend.identification.excitation import NoiseFreeInput
from backend.identification.linearisation import Problem, moved, projected
from backend.identification.output_error import NotConvergedError
from backend.identification.record import Signal
from backend.identification.response import UnstableModelError

MAX_ITERATIONS = 40
_TOLERANCE = 1e-3
_FLOOR = 1e-11


def fit_refined_iv(problem: Problem, start: Signal, noise_free_input: NoiseFreeInput) -> Signal:
    """Iterate from ``start`` to the solution; parameters, shape (p,). Raises NotConvergedError, UnstableModelError."""
    parameters = start
    record = problem.record
    signal = float(np.linalg.norm(problem.whiten(record.y)))
    for _ in range(MAX_ITERATIONS):
        here = projected(problem, parameters, noise_free_input(parameters))
        basis = np.linalg.qr(here.instruments)[0]
        right = basis.T @ here.residuals
        remaining = float(np.linalg.norm(right))
        noise = float(np.linalg.norm(here.residuals)) / np.sqrt(record.u.size)
        if remaining < _TOLERANCE * noise or remaining < _FLOOR * signal:
            return parameters
        step = np.linalg.lstsq(basis.T @ here.sensitivities, right, rcond=None)[0]
        parameters = _stable_step(problem, parameters, np.asarray(step))
    raise NotConvergedError(f"{problem.structure.name}: refined IV did not settle within {MAX_ITERATIONS} iterations")


def _stable_step(problem: Problem, parameters: Signal, step: Signal) -> Signal:
    """Take the step, shortened to a factor e per parameter and halved until the model is stable."""
    step = step / max(1.0, float(np.max(np.abs(step[1:]))))
    for _ in range(30):
        trial = moved(parameters, step)
        try:
            problem.simulated(trial, problem.record.u[:2])
        except UnstableModelError:
            step = step / 2.0
        else:
            return trial
    raise NotConvergedError(f"{problem.structure.name}: refined IV leads to an unstable model")
