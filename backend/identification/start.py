"""Starting values: cheap estimates over a grid of filters, the best chosen by how well it simulates the record."""

import numpy as np
from scipy.signal import lfilter

from backend.identification.linearisation import WHITE, Problem, triangle
from backend.identification.record import Record, Signal
from backend.identification.response import UnstableModelError, check_stable, simulate
from backend.identification.structures import Structure

_CUT_OFFS = 8
_LAGS = 10


class NoStartError(ValueError):
    """No starting value gives a stable model."""


def starting_values(record: Record, structure: Structure) -> Signal:
    """Parameters to start an iteration from, shape (parameters,). Raises NoStartError.

    Candidates are state-variable-filter estimates over a grid of cut-offs and equal lags over a grid of time
    constants. The gain of each is fitted to the record; the smallest simulation error wins.
    """
    candidates = _equal_lags(record, structure)
    if structure.kind != "lags":
        candidates += _state_variable_filter(record, structure)
    problem = Problem(record, structure, WHITE)
    best, smallest = None, np.inf
    for candidate in candidates:
        try:
            fitted, error = _fit_gain(problem, candidate)
        except UnstableModelError:
            continue
        if error < smallest:
            best, smallest = fitted, error
    if best is None:
        raise NoStartError(f"no stable model of structure {structure.name} describes the record")
    return best


def _fit_gain(problem: Problem, candidate: Signal) -> tuple[Signal, float]:
    unit = np.concatenate(([1.0], candidate[1:]))
    record = problem.record
    response = problem.simulated(unit, record.u)
    factor = triangle(np.column_stack((problem.nuisance(unit), response, record.y)))
    gain = factor[-2, -1] / factor[-2, -2] if factor[-2, -2] else 0.0
    if gain == 0.0 or not np.isfinite(gain):
        raise UnstableModelError("the input does not reach the output")
    return np.concatenate(([gain], candidate[1:])), float(abs(factor[-1, -1]))


def _equal_lags(record: Record, structure: Structure) -> list[Signal]:
    sums = np.geomspace(5.0 * record.period_s, record.duration_s / 3.0, _LAGS)
    powers = [np.ravel(np.poly1d([total / structure.order, 1.0]) ** structure.order)[::-1] for total in sums]
    return [structure.from_denominator(1.0, np.asarray(power)) for power in powers]


def _state_variable_filter(record: Record, structure: Structure) -> list[Signal]:
    """Least squares on A(s) F(s) y = b0 F(s) u with F = 1/(s/w + 1)^N, for each cut-off w."""
    order, found = structure.order, []
    for cut_off in np.geomspace(5.0 / record.duration_s, 0.5 / record.period_s, _CUT_OFFS):
        low_passed = [record.y]
        alpha = cut_off * record.period_s / 2.0
        for _ in range(order):
            low_passed.append(lfilter([alpha, alpha], [1.0 + alpha, alpha - 1.0], low_passed[-1]))
        u_filtered = simulate(np.full(order, -cut_off, dtype=np.complex128), record.period_s, record.u)
        derivatives = _filtered_derivatives(low_passed)
        n = record.u.size
        matrix = np.column_stack(
            (*(-d for d in derivatives[1:]), np.ones(n), np.linspace(-1.0, 1.0, n), u_filtered, derivatives[0])
        )
        settled = min(n // 4, int(3.0 * order / (cut_off * record.period_s)))
        factor = triangle(matrix[settled:])
        solution = np.linalg.lstsq(factor[:-1, :-1], factor[:-1, -1], rcond=None)[0]
        denominator = np.concatenate(([1.0], solution[:order] / cut_off ** np.arange(1, order + 1)))
        if np.all(np.isfinite(denominator)) and abs(denominator[-1]) > 0.0:
            stable = _stabilised(denominator)
            found.append(structure.from_denominator(float(solution[-1]), stable))
    return [candidate for candidate in found if _sensible(structure, candidate, record.period_s)]


def _filtered_derivatives(low_passed: list[Signal]) -> list[Signal]:
    """(s/w)^i / (s/w + 1)^N applied to y for i = 0 .. N, from y after 0 .. N lags."""
    order = len(low_passed) - 1
    rows = []
    for i in range(order + 1):
        # s/w = (s/w + 1) - 1, expanded by the binomial theorem.
        weights = np.ravel(np.poly1d([1.0, -1.0]) ** i)
        rows.append(np.sum([weights[j] * low_passed[order - i + j] for j in range(i + 1)], axis=0))
    return rows


def _stabilised(denominator: Signal) -> Signal:
    order = denominator.size - 1
    scale = abs(denominator[-1]) ** (1.0 / order)
    poles = np.roots((denominator / scale ** np.arange(order + 1))[::-1]) / scale
    poles = -np.abs(poles.real) - 1e-3 * np.abs(poles) + 1j * poles.imag
    descending = np.real(np.poly(poles))
    return np.asarray(descending[::-1] / descending[-1])


def _sensible(structure: Structure, parameters: Signal, period_s: float) -> bool:
    if not (np.all(np.isfinite(parameters)) and np.all(parameters[1:] > 0.0)):
        return False
    try:
        check_stable(structure.poles(parameters), period_s)
    except UnstableModelError:
        return False
    return True
