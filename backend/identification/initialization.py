"""Starting values of a fit, and linearization of a structure at its parameters."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self, cast

import numpy as np

from backend.identification import messages
from backend.identification.models import (
    DenominatorKind,
    Poles,
    Structure,
    find_structure,
    free_responses,
    simulate_response,
)
from backend.identification.records import NoStartError, Record, RecordError, Signal, UnstableModelError

# Linearization -------------------------------------------------------------------------------------
# Output error and its sensitivities: the evaluation of a structure on a record.
#
#     y(t) = G(s; parameters) u(t) + initial state + offset + ramp + noise
#
# The terms after the first are nuisance: they are linear and eliminated by orthogonal projection, so that truncated
# records, sensor offsets and slow drifts do not bias the parameters. With a dead time the first samples depend on
# inputs before the record: they are omitted, and the effect of those inputs is in the initial state. Steps are taken in
# coordinates z, in which the gain is unchanged and every other parameter is its logarithm, which keeps them positive
# and of similar size.


_STEP = 1e-5
_BLOCK = 1000
WHITE = np.array([1.0])


@dataclass(frozen=True)
class FitProblem:
    """A record, a structure and the whitening polynomial of the fit.

    The polynomial is (1, d_1, ...) in powers of z^-1. ``low_pass`` is the pole of an additional filter
    1/(1 - low_pass z^-1) on both signals, which weights errors at low frequency; 0 for none. Filtering both signals
    leaves the model between them unchanged. The samples before ``first`` are ignored; that limits the dead time.
    """

    record: Record
    structure: Structure
    whitening: Signal
    low_pass: float = 0.0
    first: int = 0

    def simulate(self, parameters: Signal, u: Signal, initial: Signal | None = None) -> Signal:
        """Return the response to ``u`` from rest or from ``initial``, shape (n,).

        Raises UnstableModelError.
        """
        state = None if initial is None else initial / parameters[0]
        poles, dead_time_s = self.structure.poles(parameters), self.structure.dead_time(parameters)
        return np.asarray(parameters[0] * simulate_response(poles, self.record.period_s, u, state, dead_time_s))

    def nuisance(self, parameters: Signal) -> Signal:
        """Return free responses, offset and ramp, whitened; shape (n, order + 2)."""
        count = self.record.u.size
        free = free_responses(self.structure.poles(parameters), self.record.period_s, count)
        return self.whiten(np.column_stack((free, np.ones(count), np.linspace(-1.0, 1.0, count))))

    def sensitivities(self, parameters: Signal, u: Signal, initial: Signal, simulated: Signal) -> Signal:
        """Differentiate the whitened response with respect to the logarithms of the parameters.

        These are the dynamic parameters, for ``u`` and ``initial``; ``simulated`` is the response itself. The shape is
        (n, parameters - 1). Each forward difference costs one simulation, and the relative error of 1e-5 slows the
        iteration negligibly without changing its solution.
        """
        columns = np.empty((u.size, parameters.size - 1))
        for i in range(1, parameters.size):
            nearby = parameters.copy()
            nearby[i] *= 1.0 + _STEP
            columns[:, i - 1] = self.whiten(self.simulate(nearby, u, initial)) - simulated
        return columns / _STEP

    def whiten(self, signal: Signal) -> Signal:
        """Filter signals by the whitening polynomial and the low-pass; 0 before ``first``."""
        from scipy.signal import lfilter

        if self.whitening.size > 1 or self.low_pass:
            signal = np.asarray(lfilter(self.whitening, [1.0, -self.low_pass], signal, axis=0))
        return np.concatenate((np.zeros_like(signal[: self.first]), signal[self.first :])) if self.first else signal

    @property
    def unweighted(self) -> "FitProblem":
        """The problem of the plain simulation error."""
        return replace(self, whitening=WHITE, low_pass=0.0)


class ModelEvaluation(ABC):
    """Model error at one set of parameters, with the data of steps and standard errors.

    ``error`` shape (n,) and ``nuisance`` shape (n, order + 2), both whitened, the columns of ``nuisance`` with norm 1;
    ``cost`` is the norm of the part of the error that the nuisance terms cannot explain.
    """

    linear = 1
    """Number of parameters, the first ones, that are linear; all others are positive."""

    def __init__(self, parameters: Signal, error: Signal, nuisance: Signal) -> None:
        self.parameters = parameters
        self.error = error
        self._size = np.linalg.norm(nuisance, axis=0)
        self.nuisance = nuisance / self._size
        self._factor = triangle(np.column_stack((self.nuisance, self.error)))
        self.cost = float(abs(self._factor[-1, -1]))

    @property
    @abstractmethod
    def structure(self) -> Structure:
        """Structure of the denominator."""

    @property
    @abstractmethod
    def output(self) -> Signal:
        """Whitened output of the record, shape (n,)."""

    @property
    @abstractmethod
    def sensitivities(self) -> Signal:
        """Derivatives of the whitened model output with respect to z, shape (n, p)."""

    @abstractmethod
    def instruments(self, u: Signal) -> Signal:
        """Differentiate the whitened response to a noise-free input with respect to z; shape (n, p)."""

    @abstractmethod
    def move_to(self, parameters: Signal) -> Self:
        """Evaluate the same problem at other parameters. Raises UnstableModelError."""

    @property
    def noise(self) -> float:
        """Standard deviation of the whitened error."""
        return self.cost / float(np.sqrt(self.error.size))

    @cached_property
    def initial(self) -> Signal:
        """State before the first sample with the least error, shape (order,).

        It is fitted together with offset and ramp.
        """
        solution = least_squares(self._factor[:-1, :-1], self._factor[:-1, -1])
        return np.asarray(solution / self._size)[: self.structure.order]

    @property
    def free_response(self) -> Signal:
        """Whitened response to the initial state, shape (n,)."""
        order = self.structure.order
        return np.asarray(self.nuisance[:, :order] @ (self.initial * self._size[:order]))

    def without_nuisance(self, columns: Signal) -> Signal:
        """Return the part of the columns (n, m) orthogonal to the nuisance terms."""
        count = self.nuisance.shape[1]
        factor = triangle(np.column_stack((self.nuisance, columns)))
        return np.asarray(columns - self.nuisance @ least_squares(factor[:count, :count], factor[:count, count:]))


class FitEvaluation(ModelEvaluation):
    """A problem of one input at one set of parameters. Raises UnstableModelError."""

    def __init__(self, problem: FitProblem, parameters: Signal) -> None:
        self.problem = problem
        dead_time_s = problem.structure.dead_time(parameters)
        if not dead_time_s <= problem.first * problem.record.period_s:
            raise UnstableModelError(messages.dead_time_too_long(dead_time_s=dead_time_s))
        self._from_rest = problem.whiten(problem.simulate(parameters, problem.record.u))
        if not np.all(np.isfinite(self._from_rest)):
            raise UnstableModelError(messages.simulation_overflows())
        super().__init__(parameters, self.output - self._from_rest, problem.nuisance(parameters))

    @property
    def structure(self) -> Structure:
        """Structure of the problem."""
        return self.problem.structure

    @property
    def output(self) -> Signal:
        """Whitened output of the record, shape (n,)."""
        return self.problem.whiten(self.problem.record.y)

    def move_to(self, parameters: Signal) -> "FitEvaluation":
        """Evaluate the same problem at other parameters. Raises UnstableModelError."""
        return FitEvaluation(self.problem, parameters)

    @cached_property
    def sensitivities(self) -> Signal:
        """Derivatives of the whitened model output with respect to z, shape (n, p)."""
        whole = self._from_rest + self.free_response
        in_logarithms = self.problem.sensitivities(self.parameters, self.problem.record.u, self.initial, whole)
        return np.column_stack((self._from_rest / self.parameters[0], in_logarithms))

    def instruments(self, u: Signal) -> Signal:
        """Differentiate the whitened response to a noise-free input with respect to z; shape (n, p)."""
        rest = np.zeros(self.problem.structure.order)
        clean = self.problem.whiten(self.problem.simulate(self.parameters, u))
        in_logarithms = self.problem.sensitivities(self.parameters, u, rest, clean)
        return np.column_stack((clean / self.parameters[0], in_logarithms))


def least_squares(columns: Signal, right: Signal, rcond: float | None = None) -> Signal:
    """Return the least-squares solution of ``columns`` x = ``right``.

    Raises UnstableModelError for values that are not finite, for which LAPACK would write to the terminal, and
    LinAlgError.
    """
    if not (np.all(np.isfinite(columns)) and np.all(np.isfinite(right))):
        raise UnstableModelError(messages.equations_overflow())
    return np.asarray(np.linalg.lstsq(columns, right, rcond=rcond)[0])


def triangle(columns: Signal) -> Signal:
    """Return the triangular factor R of a tall matrix, shape (columns, columns).

    It results from a QR of blocks and a QR of their factors, which is numerically as good as one QR and several times
    faster, since a block stays in the processor's cache.
    """
    count, width = columns.shape
    blocks = count // _BLOCK
    factors = _factor(columns[: blocks * _BLOCK].reshape(blocks, _BLOCK, width))
    return _factor(np.vstack((factors.reshape(-1, width), columns[blocks * _BLOCK :])))


def _factor(columns: Signal) -> Signal:
    # numpy's stubs only have the mode that returns Q as well.
    return cast(Signal, np.linalg.qr(columns, mode="r"))


def apply_step(parameters: Signal, step: Signal, linear: int = 1) -> Signal:
    """Return parameters after a step in z: linear ones added, others multiplied by e^step."""
    return np.concatenate((parameters[:linear] + step[:linear], parameters[linear:] * np.exp(step[linear:])))


def difference(first: Signal, second: Signal, linear: int = 1) -> Signal:
    """Return the step in z from the first parameters to the second."""
    return np.concatenate((second[:linear] - first[:linear], np.log(second[linear:] / first[linear:])))


# Start ---------------------------------------------------------------------------------------------
# Starting values: cheap candidates of several kinds, ranked by their simulation error.


_CUT_OFFS = 6
_LAGS = 10
_FEW_LAGS = 4
_EQUATIONS = 4000
_FAST_PAIRS = 6
_DAMPINGS = (0.3, 1.0)
_LONGEST_DEAD_TIME = 0.1
_DEAD_TIMES = 14
_NEAR = 0.8


def initial_estimates(problem: FitProblem, *further: Signal) -> list[Signal]:
    """Return starting parameters, best first, each shape (p,). Raises NoStartError.

    Candidates are the ``further`` ones, equal lags over a grid of time constants, and state-variable-filter estimates
    over a grid of cut-offs. The gain of each is fitted, and the whitened simulation error ranks them.
    """

    def find_starts(plain: FitProblem, *candidates: Signal) -> list[tuple[float, Signal]]:
        if plain.structure.kind is DenominatorKind.LAGS:
            return ranked_starts(plain, [*candidates, *_equal_lags(plain, plain.structure, _LAGS)])
        few = _equal_lags(plain, plain.structure, _FEW_LAGS)
        return ranked_starts(plain, [*candidates, *few, *_state_variable_filter(plain)])

    if problem.structure.delayed:  # further candidates include a dead time
        ranked = [
            *ranked_starts(problem, list(further)),
            *_over_dead_times(problem, lambda plain: find_starts(plain)[:1]),
        ]
        ranked = _select_distinct(sorted(ranked, key=lambda pair: pair[0]))
    else:
        ranked = find_starts(problem, *further)
    if not ranked:
        raise NoStartError(messages.no_stable_start(structure=problem.structure.name))
    return [parameters for _, parameters in ranked]


def thorough_starts(problem: FitProblem) -> list[tuple[float, Signal]]:
    """Return errors and parameters of further starts for order 3 and more.

    They have additional faster poles at the best single lag, and are ranked, best first.
    """
    if problem.structure.kind is DenominatorKind.LAGS:
        return []
    if problem.structure.delayed:
        return _over_dead_times(problem, thorough_starts)
    return ranked_starts(problem, _lag_and_faster_poles(problem))


def _over_dead_times(
    problem: FitProblem, starts: Callable[[FitProblem], list[tuple[float, Signal]]]
) -> list[tuple[float, Signal]]:
    """Collect the starts of the undelayed structure for each dead time of a grid.

    The grid starts at half a sample.
    """
    record, found = problem.record, []
    for samples in dead_times(record):
        late = round(samples)
        held = np.concatenate((np.full(late, record.u[0]), record.u[: record.u.size - late]))
        try:
            plain = replace(problem, record=replace(record, u=held), structure=problem.structure.undelayed, first=0)
            behind = starts(plain)
        except (RecordError, NoStartError):
            continue
        found += [(error, np.append(parameters, samples * record.period_s)) for error, parameters in behind]
    return sorted(found, key=lambda pair: pair[0])


def _select_distinct(ranked: list[tuple[float, Signal]]) -> list[tuple[float, Signal]]:
    """Omit starts whose dead time is close to that of a better one.

    They would lead to the same solution.
    """
    distinct: list[tuple[float, Signal]] = []
    for error, start in ranked:
        if all(abs(np.log(start[-1] / other[-1])) > _NEAR for _, other in distinct):
            distinct.append((error, start))
    return distinct


def dead_times(record: Record) -> list[float]:
    """Return dead times to start from [samples], half a sample to 10 % of the record."""
    grid = np.geomspace(1.0, max(2.0, _LONGEST_DEAD_TIME * record.u.size), _DEAD_TIMES)
    return [0.5, *np.unique(np.round(grid)).tolist()]


def dominant_lag(problem: FitProblem) -> float:
    """Return the time constant [s] of the best single lag on a coarse grid.

    Raises NoStartError.
    """
    single = FitProblem(problem.record, find_structure("first"), problem.whitening)
    ranked = ranked_starts(single, _equal_lags(single, single.structure, _LAGS))
    if not ranked:
        raise NoStartError(messages.no_response_to_input())
    return float(ranked[0][1][1])


def ranked_starts(problem: FitProblem, among: list[Signal]) -> list[tuple[float, Signal]]:
    """Return whitened errors and parameters of candidates with their best gain.

    Best first.
    """
    scored = []
    for candidate in among:
        if np.all(np.isfinite(candidate)) and np.all(candidate[1:] > 0.0):
            try:
                scored.append(_fit_gain(problem, candidate))
            except UnstableModelError:
                continue
    return sorted(scored, key=lambda pair: pair[0])


def _fit_gain(problem: FitProblem, candidate: Signal) -> tuple[float, Signal]:
    """Return the whitened error with the best gain, and the parameters with that gain."""
    unit = np.concatenate(([1.0], candidate[1:]))
    record = problem.record
    rows = _make_decimation(record.u.size)
    both = problem.whiten(problem.simulate(unit, record.u))[rows], problem.whiten(record.y)[rows]
    columns = np.column_stack((problem.nuisance(unit)[rows], *both))
    columns[:, :-2] /= np.linalg.norm(columns[:, :-2], axis=0)
    factor = triangle(columns)
    gain = factor[-2, -1] / factor[-2, -2] if factor[-2, -2] else 0.0
    if gain == 0.0 or not np.isfinite(gain):
        raise UnstableModelError(messages.no_response_to_input())
    return float(abs(factor[-1, -1])), np.concatenate(([gain], candidate[1:]))


def _make_decimation(count: int, first: int = 0) -> slice:
    """Return a decimation: a few thousand equations select a start as well as all."""
    return slice(first, None, max(1, count // _EQUATIONS))


def _equal_lags(problem: FitProblem, shape: Structure, count: int) -> list[Signal]:
    record = problem.record
    sums = np.geomspace(5.0 * record.period_s, record.duration_s / 3.0, count)
    return [_from_poles(shape, np.full(shape.order, -shape.order / total, dtype=np.complex128)) for total in sums]


def _lag_and_faster_poles(problem: FitProblem) -> list[Signal]:
    """Add faster poles over a grid of frequencies to the best single lag.

    The poles are a pair, at order 4 also another lag.
    """
    T = dominant_lag(problem)
    found = []
    for omega in np.geomspace(3.0 / T, 0.5 / problem.record.period_s, _FAST_PAIRS):
        for damping in _DAMPINGS:
            pole = omega * (-damping + 1j * np.sqrt(1.0 - damping**2))
            lags = np.full(problem.structure.order - 3, -omega, dtype=np.complex128)
            found.append(_from_poles(problem.structure, np.concatenate(([-1.0 / T], lags, [pole, np.conj(pole)]))))
    return found


def _state_variable_filter(problem: FitProblem) -> list[Signal]:
    """Solve A(s) F(s) y = b0 F(s) u by least squares with F = 1/(s/w + 1)^N.

    There is one solution for each cut-off w; unstable poles are mirrored.
    """
    record, shape = problem.record, problem.structure
    order, count, found = shape.order, record.u.size, []
    u, y = problem.whiten(record.u), problem.whiten(record.y)
    trend = np.ones(count), np.linspace(-1.0, 1.0, count)
    for cut_off in np.geomspace(5.0 / record.duration_s, 0.5 / record.period_s, _CUT_OFFS):
        derivatives = filter_derivatives(y, cut_off * record.period_s / 2.0, order)
        u_filtered = simulate_response(np.full(order, -cut_off, dtype=np.complex128), record.period_s, u)
        settled = min(count // 4, int(3.0 * order / (cut_off * record.period_s)))
        columns = (*(-d for d in derivatives[1:]), *trend, u_filtered, derivatives[0])
        rows = _make_decimation(count, settled)
        factor = triangle(np.column_stack([column[rows] for column in columns]))
        try:
            solution = least_squares(factor[:-1, :-1], factor[:-1, -1])
        except UnstableModelError:
            continue
        scaled = np.concatenate(([1.0], solution[:order]))
        if np.all(np.isfinite(scaled)) and scaled[-1] != 0.0:
            poles = np.roots(scaled[::-1]) * cut_off
            mirrored = -np.maximum(np.abs(poles.real), 1e-3 * np.abs(poles)) + 1j * poles.imag
            found.append(_from_poles(shape, mirrored))
    return found


def filter_derivatives(y: Signal, alpha: float, order: int) -> list[Signal]:
    """Return (s/w)^i / (s/w + 1)^N applied to y for i = 0 .. N.

    It uses Tustin's rule with alpha = w period / 2.
    """
    from scipy.signal import lfilter

    lagged = [y]
    for _ in range(order):
        lagged.append(lfilter([alpha, alpha], [1.0 + alpha, alpha - 1.0], lagged[-1]))
    rows = []
    for i in range(order + 1):
        # s/w = (s/w + 1) - 1, expanded by the binomial theorem.
        weights = np.ravel(np.poly1d([1.0, -1.0]) ** i)
        rows.append(np.sum([weights[j] * lagged[order - i + j] for j in range(i + 1)], axis=0))
    return rows


def _from_poles(shape: Structure, poles: Poles) -> Signal:
    descending = np.real(np.poly(poles))
    return shape.from_denominator(1.0, np.asarray(descending[::-1] / descending[-1]))
