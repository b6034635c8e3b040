"""Output error and its sensitivities: the one place where a structure meets a record.

    y(t) = G(s; parameters) u(t) + initial state + offset + ramp + noise

The terms after the first are nuisance: they enter linearly and are eliminated by orthogonal projection, so that cut
records, sensor offsets and slow drifts do not bias the parameters. Steps are taken in coordinates z in which the gain
is itself and every other parameter is its logarithm, which keeps them positive and of one size.
"""

from dataclasses import dataclass
from typing import cast

import numpy as np
from scipy.signal import lfilter

from backend.identification.record import Record, Signal
from backend.identification.response import free_responses, simulate
from backend.identification.structures import Structure
from backend.identification.uncertainty import sandwich

_STEP = 1e-5
_BLOCK = 1000
WHITE = np.array([1.0])


@dataclass(frozen=True)
class Problem:
    """A record, a structure and the polynomial that whitens the noise (1, d_1 .. in powers of z^-1)."""

    record: Record
    structure: Structure
    whitening: Signal

    def simulated(self, parameters: Signal, u: Signal) -> Signal:
        """Noise-free response to ``u`` from rest, shape (n,). Raises UnstableModelError."""
        poles = self.structure.poles(parameters)
        return np.asarray(parameters[0] * simulate(poles, self.record.period_s, u))

    def nuisance(self, parameters: Signal) -> Signal:
        """Free responses, offset and ramp, whitened, shape (n, order + 2)."""
        count = self.record.u.size
        free = free_responses(self.structure.poles(parameters), self.record.period_s, count)
        columns = np.column_stack((free, np.ones(count), np.linspace(-1.0, 1.0, count)))
        return self.whiten(columns)

    def sensitivities(self, parameters: Signal, u: Signal, simulated: Signal) -> Signal:
        """Differentiate the simulated response in z; shape (n, parameters), before whitening.

        Forward differences: each costs one simulation, and the relative error of 1e-5 slows the iteration
        unnoticeably without moving its solution.
        """
        columns = np.empty((u.size, parameters.size))
        columns[:, 0] = simulated / parameters[0]
        for i in range(1, parameters.size):
            moved = parameters.copy()
            moved[i] *= 1.0 + _STEP
            columns[:, i] = (self.simulated(moved, u) - simulated) / _STEP
        return columns

    def whiten(self, signal: Signal) -> Signal:
        """Pass a signal or columns of signals through the whitening polynomial."""
        return signal if self.whitening.size == 1 else np.asarray(lfilter(self.whitening, [1.0], signal, axis=0))


@dataclass(frozen=True)
class Projected:
    """Linearisation at ``parameters``, whitened, orthogonal to the nuisance terms.

    ``residuals`` shape (n,); ``sensitivities`` and ``instruments`` shape (n, p), both in the coordinates z.
    """

    parameters: Signal
    residuals: Signal
    sensitivities: Signal
    instruments: Signal

    def covariance(self) -> Signal:
        """Covariance of the parameters, shape (p, p), robust to coloured residuals."""
        scale = np.concatenate(([1.0], self.parameters[1:]))
        return np.asarray(sandwich(self.instruments, self.sensitivities, self.residuals) * np.outer(scale, scale))

    def distance(self, first: Signal, second: Signal) -> float:
        """Difference of two parameter vectors as they move the output, in standard deviations of the noise."""
        step = np.concatenate((second[:1] - first[:1], np.log(second[1:] / first[1:])))
        noise = np.linalg.norm(self.residuals) / np.sqrt(self.residuals.size)
        return float(np.linalg.norm(self.sensitivities @ step) / max(noise, np.finfo(float).tiny))


def projected(problem: Problem, parameters: Signal, noise_free_input: Signal | None) -> Projected:
    """Linearise with instruments made of ``noise_free_input``, or of the measured input where that is None."""
    record = problem.record
    basis = np.linalg.qr(problem.nuisance(parameters))[0]

    def without_nuisance(columns: Signal) -> Signal:
        whitened = problem.whiten(columns)
        return np.asarray(whitened - basis @ (basis.T @ whitened))

    simulated = problem.simulated(parameters, record.u)
    sensitivities = without_nuisance(problem.sensitivities(parameters, record.u, simulated))
    instruments = sensitivities
    if noise_free_input is not None:
        clean = problem.simulated(parameters, noise_free_input)
        instruments = without_nuisance(problem.sensitivities(parameters, noise_free_input, clean))
    return Projected(parameters, without_nuisance(record.y - simulated), sensitivities, instruments)


def triangle(columns: Signal) -> Signal:
    """Triangular factor R of a tall matrix, shape (columns, columns), by QR of blocks and QR of their factors.

    Numerically as good as one QR and several times faster, since a block stays in the processor's cache.
    """
    count, width = columns.shape
    blocks = count // _BLOCK
    factors = _factor(columns[: blocks * _BLOCK].reshape(blocks, _BLOCK, width))
    return _factor(np.vstack((factors.reshape(-1, width), columns[blocks * _BLOCK :])))


def _factor(columns: Signal) -> Signal:
    # numpy's stubs know only the mode that returns Q as well.
    return cast(Signal, np.linalg.qr(columns, mode="r"))


def moved(parameters: Signal, step: Signal) -> Signal:
    """Parameters after a step in z: gain added, the others multiplied by the exponential."""
    return np.concatenate((parameters[:1] + step[:1], parameters[1:] * np.exp(step[1:])))


def cost(problem: Problem, parameters: Signal) -> float:
    """Norm of the whitened output error after the nuisance terms are taken out. Raises UnstableModelError."""
    record = problem.record
    error = problem.whiten(record.y - problem.simulated(parameters, record.u))
    return float(abs(triangle(np.column_stack((problem.nuisance(parameters), error)))[-1, -1]))
