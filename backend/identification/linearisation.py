"""Output error and its sensitivities: the one place where a structure meets a record.

    y(t) = G(s; parameters) u(t) + initial state + offset + ramp + noise

The terms after the first are nuisance: they enter linearly and are eliminated by orthogonal projection, so that cut
records, sensor offsets and slow drifts do not bias the parameters. Behind a dead time the first samples come from
inputs before the record: they are left out, and what those inputs did is in the initial state. Steps are taken in
coordinates z in which the gain is itself and every other parameter is its logarithm, which keeps them positive and of
one size.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np

from backend.identification.errors import UnstableModelError
from backend.identification.record import Record, Signal
from backend.identification.response import free_responses, simulate
from backend.identification.structures import Structure

_STEP = 1e-5
_BLOCK = 1000
WHITE = np.array([1.0])


@dataclass(frozen=True)
class Problem:
    """A record, a structure and the polynomial that whitens the noise (1, d_1 .. in powers of z^-1).

    ``low_pass`` is the pole of a filter 1/(1 - low_pass z^-1) on both signals besides, which weights errors at low
    frequency; 0 for none. Filters of sampled signals leave the model between them as it is. The samples before
    ``first`` do not count; that is how long a dead time may become.
    """

    record: Record
    structure: Structure
    whitening: Signal
    low_pass: float = 0.0
    first: int = 0

    def simulated(self, parameters: Signal, u: Signal, initial: Signal | None = None) -> Signal:
        """Response to ``u`` from rest or from ``initial``, shape (n,). Raises UnstableModelError."""
        state = None if initial is None else initial / parameters[0]
        poles, dead_time_s = self.structure.poles(parameters), self.structure.dead_time(parameters)
        return np.asarray(parameters[0] * simulate(poles, self.record.period_s, u, state, dead_time_s))

    def nuisance(self, parameters: Signal) -> Signal:
        """Free responses, offset and ramp, whitened; shape (n, order + 2)."""
        count = self.record.u.size
        free = free_responses(self.structure.poles(parameters), self.record.period_s, count)
        return self.whiten(np.column_stack((free, np.ones(count), np.linspace(-1.0, 1.0, count))))

    def sensitivities(self, parameters: Signal, u: Signal, initial: Signal, simulated: Signal) -> Signal:
        """Differentiate the whitened response to ``u`` and ``initial`` in the logarithms of the dynamic parameters.

        ``simulated`` is that response; shape (n, parameters - 1). Forward differences: each costs one simulation,
        and the relative error of 1e-5 slows the iteration unnoticeably without moving its solution.
        """
        columns = np.empty((u.size, parameters.size - 1))
        for i in range(1, parameters.size):
            nearby = parameters.copy()
            nearby[i] *= 1.0 + _STEP
            columns[:, i - 1] = self.whiten(self.simulated(nearby, u, initial)) - simulated
        return columns / _STEP

    def whiten(self, signal: Signal) -> Signal:
        """Pass a signal or columns of signals through the whitening polynomial and the low-pass; 0 before ``first``."""
        from scipy.signal import lfilter

        if self.whitening.size > 1 or self.low_pass:
            signal = np.asarray(lfilter(self.whitening, [1.0, -self.low_pass], signal, axis=0))
        return np.concatenate((np.zeros_like(signal[: self.first]), signal[self.first :])) if self.first else signal

    @property
    def unweighted(self) -> "Problem":
        """The problem of the plain simulation error."""
        return replace(self, whitening=WHITE, low_pass=0.0)


class Evaluation:
    """A problem at one set of parameters, with what steps and standard errors need. Raises UnstableModelError.

    ``nuisance`` shape (n, order + 2) and ``error`` shape (n,), both whitened; ``cost`` is the norm of the part of
    the error that the nuisance terms cannot explain.
    """

    def __init__(self, problem: Problem, parameters: Signal) -> None:
        self.problem = problem
        self.parameters = parameters
        dead_time_s = problem.structure.dead_time(parameters)
        if not dead_time_s <= problem.first * problem.record.period_s:
            raise UnstableModelError(f"a dead time of {dead_time_s:.3g} s is longer than what is looked for")
        self._from_rest = problem.whiten(problem.simulated(parameters, problem.record.u))
        if not np.all(np.isfinite(self._from_rest)):
            raise UnstableModelError("the simulation leaves the range of numbers")
        self.error = problem.whiten(problem.record.y) - self._from_rest
        columns = problem.nuisance(parameters)
        self._size = np.linalg.norm(columns, axis=0)
        self.nuisance = columns / self._size
        self._factor = triangle(np.column_stack((self.nuisance, self.error)))
        self.cost = float(abs(self._factor[-1, -1]))

    @property
    def noise(self) -> float:
        """Standard deviation of the whitened error."""
        return self.cost / float(np.sqrt(self.error.size))

    @cached_property
    def initial(self) -> Signal:
        """State before the first sample that fits the error best, with offset and ramp, shape (order,)."""
        solution = least_squares(self._factor[:-1, :-1], self._factor[:-1, -1])
        return np.asarray(solution / self._size)[: self.problem.structure.order]

    @cached_property
    def sensitivities(self) -> Signal:
        """Derivatives of the whitened model output in z, shape (n, p)."""
        order, u = self.problem.structure.order, self.problem.record.u
        whole = self._from_rest + self.nuisance[:, :order] @ (self.initial * self._size[:order])
        in_logarithms = self.problem.sensitivities(self.parameters, u, self.initial, whole)
        return np.column_stack((self._from_rest / self.parameters[0], in_logarithms))

    def instruments(self, u: Signal) -> Signal:
        """Differentiate the whitened response to an input free of noise in z; shape (n, p)."""
        rest = np.zeros(self.problem.structure.order)
        clean = self.problem.whiten(self.problem.simulated(self.parameters, u))
        in_logarithms = self.problem.sensitivities(self.parameters, u, rest, clean)
        return np.column_stack((clean / self.parameters[0], in_logarithms))

    def without_nuisance(self, columns: Signal) -> Signal:
        """Part of the columns, shape (n, m), that is orthogonal to the nuisance terms."""
        count = self.nuisance.shape[1]
        factor = triangle(np.column_stack((self.nuisance, columns)))
        return np.asarray(columns - self.nuisance @ least_squares(factor[:count, :count], factor[:count, count:]))


def least_squares(columns: Signal, right: Signal, rcond: float | None = None) -> Signal:
    """Least-squares solution of ``columns`` x = ``right``. Raises UnstableModelError, LinAlgError.

    Numbers that are not finite are refused: LAPACK would write to the terminal.
    """
    if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(right))):
        raise UnstableModelError("the equations leave the range of numbers")
    return np.asarray(np.linalg.lstsq(columns, right, rcond=rcond)[0])


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


def difference(first: Signal, second: Signal) -> Signal:
    """Step in z from the first parameters to the second."""
    return np.concatenate((second[:1] - first[:1], np.log(second[1:] / first[1:])))
