"""Starting values: cheap candidates of several kinds, ranked by how well they simulate the record."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from backend.identification.errors import NoStartError, RecordError, UnstableModelError
from backend.identification.linearisation import Problem, least_squares, triangle
from backend.identification.record import Record, Signal
from backend.identification.response import Poles, simulate
from backend.identification.structures import Kind, Structure, structure

_CUT_OFFS = 6
_LAGS = 10
_FEW_LAGS = 4
_EQUATIONS = 4000
_FAST_PAIRS = 6
_DAMPINGS = (0.3, 1.0)
_LONGEST_DEAD_TIME = 0.1
_DEAD_TIMES = 14
_NEAR = 0.8


def quick_starts(problem: Problem, *further: Signal) -> list[Signal]:
    """Parameters to start from, best first, each shape (p,). Raises NoStartError.

    Candidates are the ``further`` ones, equal lags over a grid of time constants, and state-variable-filter
    estimates over a grid of cut-offs. The gain of each is fitted, the whitened simulation error ranks them.
    """

    def found(plain: Problem, *given: Signal) -> list[tuple[float, Signal]]:
        if plain.structure.kind is Kind.LAGS:
            return ranked_starts(plain, [*given, *_equal_lags(plain, plain.structure, _LAGS)])
        few = _equal_lags(plain, plain.structure, _FEW_LAGS)
        return ranked_starts(plain, [*given, *few, *_state_variable_filter(plain)])

    if problem.structure.delayed:  # further ones have their dead time already
        ranked = [*ranked_starts(problem, list(further)), *_over_dead_times(problem, lambda plain: found(plain)[:1])]
        ranked = _apart(sorted(ranked, key=lambda pair: pair[0]))
    else:
        ranked = found(problem, *further)
    if not ranked:
        raise NoStartError(f"no stable model of structure {problem.structure.name} describes the record")
    return [parameters for _, parameters in ranked]


def thorough_starts(problem: Problem) -> list[tuple[float, Signal]]:
    """Return simulation errors and parameters of further starts for order 3 and more, best first.

    They are the best single lag with faster poles behind it.
    """
    if problem.structure.kind is Kind.LAGS:
        return []
    if problem.structure.delayed:
        return _over_dead_times(problem, thorough_starts)
    return ranked_starts(problem, _lag_and_faster_poles(problem))


def _over_dead_times(
    problem: Problem, starts: Callable[[Problem], list[tuple[float, Signal]]]
) -> list[tuple[float, Signal]]:
    """Collect the starts of the undelayed structure behind each of a grid of dead times, from half a sample on."""
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


def _apart(ranked: list[tuple[float, Signal]]) -> list[tuple[float, Signal]]:
    """Leave out starts whose dead time is near that of a better one, and lead where that leads."""
    kept: list[tuple[float, Signal]] = []
    for error, start in ranked:
        if all(abs(np.log(start[-1] / other[-1])) > _NEAR for _, other in kept):
            kept.append((error, start))
    return kept


def dead_times(record: Record) -> list[float]:
    """Dead times to start from [samples], half a sample to a tenth of the record."""
    grid = np.geomspace(1.0, max(2.0, _LONGEST_DEAD_TIME * record.u.size), _DEAD_TIMES)
    return [0.5, *np.unique(np.round(grid)).tolist()]


def dominant_lag(problem: Problem) -> float:
    """Time constant [s], on a coarse grid, of the single lag that simulates the record best. Raises NoStartError."""
    single = Problem(problem.record, structure("first"), problem.whitening)
    ranked = ranked_starts(single, _equal_lags(single, single.structure, _LAGS))
    if not ranked:
        raise NoStartError("the input does not reach the output")
    return float(ranked[0][1][1])


def ranked_starts(problem: Problem, among: list[Signal]) -> list[tuple[float, Signal]]:
    """Return whitened errors of candidates with their best gain, and their parameters with it, best first."""
    scored = []
    for candidate in among:
        if np.all(np.isfinite(candidate)) and np.all(candidate[1:] > 0.0):
            try:
                scored.append(_fit_gain(problem, candidate))
            except UnstableModelError:
                continue
    return sorted(scored, key=lambda pair: pair[0])


def _fit_gain(problem: Problem, candidate: Signal) -> tuple[float, Signal]:
    """Whitened error with the best gain, and the parameters with that gain."""
    unit = np.concatenate(([1.0], candidate[1:]))
    record = problem.record
    rows = _thinned(record.u.size)
    both = problem.whiten(problem.simulated(unit, record.u))[rows], problem.whiten(record.y)[rows]
    columns = np.column_stack((problem.nuisance(unit)[rows], *both))
    columns[:, :-2] /= np.linalg.norm(columns[:, :-2], axis=0)
    factor = triangle(columns)
    gain = factor[-2, -1] / factor[-2, -2] if factor[-2, -2] else 0.0
    if gain == 0.0 or not np.isfinite(gain):
        raise UnstableModelError("the input does not reach the output")
    return float(abs(factor[-1, -1])), np.concatenate(([gain], candidate[1:]))


def _thinned(count: int, first: int = 0) -> slice:
    """Every so many samples: a few thousand equations choose a start as well as all of them."""
    return slice(first, None, max(1, count // _EQUATIONS))


def _equal_lags(problem: Problem, shape: Structure, count: int) -> list[Signal]:
    record = problem.record
    sums = np.geomspace(5.0 * record.period_s, record.duration_s / 3.0, count)
    return [_from_poles(shape, np.full(shape.order, -shape.order / total, dtype=np.complex128)) for total in sums]


def _lag_and_faster_poles(problem: Problem) -> list[Signal]:
    """Put faster poles over a grid of frequencies behind the best single lag: a pair, at order 4 and another lag."""
    T = dominant_lag(problem)
    found = []
    for omega in np.geomspace(3.0 / T, 0.5 / problem.record.period_s, _FAST_PAIRS):
        for damping in _DAMPINGS:
            pole = omega * (-damping + 1j * np.sqrt(1.0 - damping**2))
            lags = np.full(problem.structure.order - 3, -omega, dtype=np.complex128)
            found.append(_from_poles(problem.structure, np.concatenate(([-1.0 / T], lags, [pole, np.conj(pole)]))))
    return found


def _state_variable_filter(problem: Problem) -> list[Signal]:
    """Least squares on A(s) F(s) y = b0 F(s) u with F = 1/(s/w + 1)^N, for each cut-off w; unstable poles mirrored."""
    record, shape = problem.record, problem.structure
    order, count, found = shape.order, record.u.size, []
    u, y = problem.whiten(record.u), problem.whiten(record.y)
    trend = np.ones(count), np.linspace(-1.0, 1.0, count)
    for cut_off in np.geomspace(5.0 / record.duration_s, 0.5 / record.period_s, _CUT_OFFS):
        derivatives = _filtered_derivatives(y, cut_off * record.period_s / 2.0, order)
        u_filtered = simulate(np.full(order, -cut_off, dtype=np.complex128), record.period_s, u)
        settled = min(count // 4, int(3.0 * order / (cut_off * record.period_s)))
        columns = (*(-d for d in derivatives[1:]), *trend, u_filtered, derivatives[0])
        rows = _thinned(count, settled)
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


def _filtered_derivatives(y: Signal, alpha: float, order: int) -> list[Signal]:
    """(s/w)^i / (s/w + 1)^N applied to y for i = 0 .. N, by Tustin's rule with alpha = w period / 2."""
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
