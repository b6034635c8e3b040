"""Fit of one output with two inputs: A(s) y = B_1(s) u_1 + B_2(s) u_2 + noise."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from backend.identification import messages
from backend.identification.excitation import fit_input
from backend.identification.fitting import (
    COARSE,
    FINE,
    Method,
    adapt_evaluation,
    fit_refined_iv,
    minimize_output_error,
)
from backend.identification.initialization import (
    WHITE,
    ModelEvaluation,
    difference,
    filter_derivatives,
    least_squares,
    triangle,
)
from backend.identification.models import (
    CorrelationTest,
    DenominatorKind,
    Poles,
    Structure,
    check_stable,
    find_structure,
    free_responses,
    sections,
    simulate_response,
    state_space,
)
from backend.identification.records import (
    NoStartError,
    NotConvergedError,
    Signal,
    StructureError,
    UnstableModelError,
)
from backend.identification.validation import fit_autoregression, input_correlation, whiteness

# Response ------------------------------------------------------------------------------------------
# Exact responses of s^k / A(s) to a held input.


def sampled_numerators(poles: Poles, period_s: float, degree: int) -> Signal:
    """Return the numerators of s^k / A(s), k = 0 .. degree, for a held input; (degree + 1, order).

    The powers of z^-1 ascend, the first tap acts on the newest earlier input, and the denominator is that of
    :func:`sections`. The degree is below the order of A(s), so that the output does not follow the input at once.
    """
    from scipy.linalg import expm

    A, B, C = state_space(poles)
    order = B.size
    joint = np.zeros((order + 1, order + 1))
    joint[:order, :order], joint[:order, order] = A * period_s, B * period_s
    transition = expm(joint)
    step, x = transition[:order, :order], transition[:order, order]
    # C A^k x is the k-th derivative of C x, because C A^i B = 0 for i < order - 1.
    outputs = [C]
    for _ in range(degree):
        outputs.append(outputs[-1] @ A)
    impulses = np.empty((degree + 1, order))
    for k in range(order):
        impulses[:, k] = np.array(outputs) @ x
        x = step @ x
    denominator = np.real(np.poly(np.exp(poles * period_s)))
    taps = np.array([np.convolve(denominator, impulse)[:order] for impulse in impulses])
    return np.asarray(taps / taps[0].sum())


def differentiated_responses(poles: Poles, period_s: float, u: Signal, degree: int) -> Signal:
    """Return s^k / A(s) u for k = 0 .. degree from rest; u (n,), result (n, degree + 1).

    Raises UnstableModelError.
    """
    from scipy.signal import lfilter, sosfilt

    check_stable(poles, period_s)
    filtered = sosfilt(sections(poles, period_s), u)
    columns = np.zeros((u.size, degree + 1))
    for k, taps in enumerate(sampled_numerators(poles, period_s, degree)):
        columns[1:, k] = lfilter(taps, [1.0], filtered[:-1])
    return columns


# Linearization -------------------------------------------------------------------------------------


_STEP = 1e-5


@dataclass(frozen=True)
class OutputStructure:
    """Structure of one output: its denominator A(s) and the degrees of B_1(s) and B_2(s).

    ``denominator`` names a :class:`Structure`. A degree of 0 is a numerator without zeros; a degree must be below the
    order of the denominator. Raises StructureError.
    """

    denominator: str = "order:3"
    degrees: tuple[int, int] = (0, 0)

    def __post_init__(self) -> None:
        shape = find_structure(self.denominator)
        if shape.delayed:
            raise StructureError(messages.dead_time_with_two_inputs(structure=self.denominator))
        for degree in self.degrees:
            if not 0 <= degree < shape.order:
                raise StructureError(
                    messages.numerator_degree_out_of_range(
                        structure=self.denominator, degree=degree, maximum=shape.order - 1
                    )
                )

    @property
    def numerator_count(self) -> int:
        """Number of coefficients of both numerators."""
        return self.degrees[0] + self.degrees[1] + 2

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters: coefficients of B_1 and B_2, parameters of A."""
        numerators = [f"b{j}_{k}" for j, degree in enumerate(self.degrees, 1) for k in range(degree + 1)]
        return (*numerators, *find_structure(self.denominator).names[1:])

    def numerator_slice(self, channel: int) -> slice:
        """Return the place of the coefficients of B_1 (0) or B_2 (1) in the parameters."""
        start = channel * (self.degrees[0] + 1)
        return slice(start, start + self.degrees[channel] + 1)

    def denominator_of(self, parameters: Signal) -> Signal:
        """Return the coefficients 1, a_1 .. a_N of A in ascending powers of s, (order + 1,)."""
        return find_structure(self.denominator).denominator(self._with_unit_gain(parameters))

    def poles(self, parameters: Signal) -> Poles:
        """Return the roots of A [rad/s], shape (order,)."""
        return find_structure(self.denominator).poles(self._with_unit_gain(parameters))

    def _with_unit_gain(self, parameters: Signal) -> Signal:
        return np.concatenate(([1.0], parameters[self.numerator_count :]))


@dataclass(frozen=True)
class TwoInputProblem:
    """Record of one output ``y`` (n,) and two inputs ``u`` (n, 2), structure and whitening.

    Parameters, shape (p,), have the order of ``shape.names``: first the coefficients of the numerators, which are
    linear, then the parameters of the denominator, which are positive. As with one input, initial state, offset and
    ramp are nuisance terms.
    """

    period_s: float
    u: Signal
    y: Signal
    shape: OutputStructure
    whitening: Signal

    @cached_property
    def structure(self) -> Structure:
        """Structure of the denominator."""
        return find_structure(self.shape.denominator)

    @property
    def duration_s(self) -> float:
        """Duration of the record [s]."""
        return self.y.size * self.period_s

    def part(self, start: int, stop: int) -> "TwoInputProblem":
        """Return the problem of the samples start..stop-1."""
        return replace(self, u=self.u[start:stop], y=self.y[start:stop])

    def columns(self, parameters: Signal, u: Signal) -> Signal:
        """Return s^k / A(s) u_j for each coefficient of the numerators, shape (n, linear).

        Raises UnstableModelError.
        """
        poles = self.shape.poles(parameters)
        return np.column_stack(
            [
                differentiated_responses(poles, self.period_s, u[:, channel], degree)
                for channel, degree in enumerate(self.shape.degrees)
            ]
        )

    def simulate(self, parameters: Signal, u: Signal, initial: Signal | None = None) -> Signal:
        """Return the response to ``u`` (n, 2) from rest or from ``initial``, shape (n,).

        Raises UnstableModelError.
        """
        forced = self.columns(parameters, u) @ parameters[: self.shape.numerator_count]
        if initial is not None:
            poles = self.shape.poles(parameters)
            forced = forced + simulate_response(poles, self.period_s, np.zeros(u.shape[0]), initial)
        return np.asarray(forced)

    def nuisance(self, parameters: Signal) -> Signal:
        """Return free responses, offset and ramp, whitened; shape (n, order + 2)."""
        count = self.y.size
        free = free_responses(self.shape.poles(parameters), self.period_s, count)
        return self.whiten(np.column_stack((free, np.ones(count), np.linspace(-1.0, 1.0, count))))

    def whiten(self, signal: Signal) -> Signal:
        """Filter signals by the whitening polynomial; 0 before the first whole window.

        Without the samples before the record, the first whitened errors would be several times larger than the others,
        and mostly change the offset, and with it the static gains.
        """
        from scipy.signal import lfilter

        order = self.whitening.size - 1
        if not order:
            return signal
        whitened = np.asarray(lfilter(self.whitening, [1.0], signal, axis=0))
        whitened[:order] = 0.0
        return whitened


class TwoInputEvaluation(ModelEvaluation):
    """A problem of two inputs at one set of parameters. Raises UnstableModelError."""

    def __init__(self, problem: TwoInputProblem, parameters: Signal) -> None:
        self.problem = problem
        self.linear = problem.shape.numerator_count
        self._columns = problem.whiten(problem.columns(parameters, problem.u))
        if not np.all(np.isfinite(self._columns)):
            raise UnstableModelError(messages.simulation_overflows())
        self._from_rest = self._columns @ parameters[: self.linear]
        super().__init__(parameters, self.output - self._from_rest, problem.nuisance(parameters))

    @property
    def structure(self) -> Structure:
        """Structure of the denominator."""
        return self.problem.structure

    @property
    def output(self) -> Signal:
        """Whitened output of the record, shape (n,)."""
        return self.problem.whiten(self.problem.y)

    @cached_property
    def sensitivities(self) -> Signal:
        """Derivatives of the whitened model output with respect to z, shape (n, p)."""
        whole = self._from_rest + self.free_response
        return np.column_stack((self._columns, self._by_denominator(self.problem.u, self.initial, whole)))

    def instruments(self, u: Signal) -> Signal:
        """Differentiate the whitened response to a noise-free input (n, 2) with respect to z; (n, p)."""
        columns = self.problem.whiten(self.problem.columns(self.parameters, u))
        return np.column_stack((columns, self._by_denominator(u, None, columns @ self.parameters[: self.linear])))

    def _by_denominator(self, u: Signal, initial: Signal | None, simulated: Signal) -> Signal:
        """Return forward differences by the logarithms of the denominator's parameters."""
        columns = []
        for i in range(self.linear, self.parameters.size):
            nearby = self.parameters.copy()
            nearby[i] *= 1.0 + _STEP
            columns.append(self.problem.whiten(self.problem.simulate(nearby, u, initial)) - simulated)
        return np.column_stack(columns) / _STEP

    def move_to(self, parameters: Signal) -> "TwoInputEvaluation":
        """Evaluate the same problem at other parameters. Raises UnstableModelError."""
        return TwoInputEvaluation(self.problem, parameters)


# Start ---------------------------------------------------------------------------------------------
# Candidates for the denominator; the best numerators of each follow by linear least squares.


_LAGS = 10
_CUT_OFFS = 8
_EQUATIONS = 4000
_FAST_POLES = 6
_DAMPINGS = (0.3, 0.7, 1.0)
_CLOSE = 0.02


def rank_starts(problem: TwoInputProblem, *further: Signal) -> list[Signal]:
    """Return starting parameters, best first, each shape (p,). Raises NoStartError.

    Candidates are the ``further`` ones, equal lags, state-variable-filter estimates, and, from order 3 on, a slow lag
    with faster poles. The whitened simulation error with the best numerators ranks them.
    """
    shape, count = problem.structure, problem.shape.numerator_count
    lags = _rank_denominators(
        problem, [dynamics for poles in _equal_lags(problem) for dynamics in _from_poles(shape, poles)]
    )
    ranked = lags + _rank_denominators(problem, [start[count:] for start in further])
    if shape.kind is not DenominatorKind.LAGS:
        poles = _state_variable_poles(problem)
        if shape.order >= 3 and lags:
            poles += _faster_poles(problem, float(problem.shape.denominator_of(lags[0][1])[1]))
        ranked += _rank_denominators(problem, [dynamics for one in poles for dynamics in _from_poles(shape, one)])
    if not ranked:
        raise NoStartError(messages.no_stable_start(structure=shape.name))
    distinct: list[Signal] = []
    for _, start in sorted(ranked, key=lambda pair: pair[0]):
        if all(np.max(np.abs(np.log(start[count:] / other[count:]))) > _CLOSE for other in distinct):
            distinct.append(start)
    return distinct


def _rank_denominators(problem: TwoInputProblem, candidates: list[Signal]) -> list[tuple[float, Signal]]:
    """Return errors and parameters of denominators with their best numerators, best first."""
    ranked = []
    for dynamics in candidates:
        try:
            ranked.append(_fit_numerators(problem, dynamics))
        except (UnstableModelError, np.linalg.LinAlgError):
            continue
    return sorted(ranked, key=lambda pair: pair[0])


def _fit_numerators(problem: TwoInputProblem, dynamics: Signal) -> tuple[float, Signal]:
    """Return the whitened error with the best numerators, and the parameters with them."""
    linear = problem.shape.numerator_count
    parameters = np.concatenate((np.zeros(linear), dynamics))
    rows = slice(0, None, max(1, problem.y.size // _EQUATIONS))
    columns = problem.whiten(problem.columns(parameters, problem.u))[rows]
    columns = np.column_stack((problem.nuisance(parameters)[rows], columns))
    size = np.linalg.norm(columns, axis=0)
    if not np.all(size > 0.0):
        raise UnstableModelError(messages.no_response_to_input())
    factor = triangle(np.column_stack((columns / size, problem.whiten(problem.y)[rows])))
    parameters[:linear] = (least_squares(factor[:-1, :-1], factor[:-1, -1]) / size)[-linear:]
    return float(abs(factor[-1, -1])), parameters


def _equal_lags(problem: TwoInputProblem) -> list[Poles]:
    order = problem.structure.order
    sums = np.geomspace(5.0 * problem.period_s, problem.duration_s / 3.0, _LAGS)
    return [np.full(order, -order / total, dtype=np.complex128) for total in sums]


def _faster_poles(problem: TwoInputProblem, sum_of_lags: float) -> list[Poles]:
    """Combine lags with a given sum [s] with a faster pair over a grid of frequencies."""
    order, found = problem.structure.order, []
    lags = np.full(order - 2, -(order - 2) / sum_of_lags, dtype=np.complex128)
    for omega in np.geomspace(3.0 / sum_of_lags, 0.5 / problem.period_s, _FAST_POLES):
        for damping in _DAMPINGS:
            pole = omega * (-damping + 1j * np.sqrt(1.0 - damping**2))
            found.append(np.concatenate((lags, [pole, np.conj(pole)])))
    return found


def _state_variable_poles(problem: TwoInputProblem) -> list[Poles]:
    """Solve A F y = B_1 F u_1 + B_2 F u_2 by least squares with F = 1/(s/w + 1)^N.

    There is one solution for each cut-off w; unstable poles are mirrored.
    """
    order, count, found = problem.structure.order, problem.y.size, []
    u, y = problem.whiten(problem.u), problem.whiten(problem.y)
    trend = np.ones(count), np.linspace(-1.0, 1.0, count)
    for cut_off in np.geomspace(5.0 / problem.duration_s, 0.5 / problem.period_s, _CUT_OFFS):
        alpha = cut_off * problem.period_s / 2.0
        of_output = filter_derivatives(y, alpha, order)
        of_inputs = [
            derivative
            for channel, degree in enumerate(problem.shape.degrees)
            for derivative in filter_derivatives(u[:, channel], alpha, order)[: degree + 1]
        ]
        settled = min(count // 4, int(3.0 * order / (cut_off * problem.period_s)))
        rows = slice(settled, None, max(1, count // _EQUATIONS))
        columns = (*(-derivative for derivative in of_output[1:]), *trend, *of_inputs, of_output[0])
        factor = triangle(np.column_stack([column[rows] for column in columns]))
        try:
            solution = least_squares(factor[:-1, :-1], factor[:-1, -1])
        except (UnstableModelError, np.linalg.LinAlgError):
            continue
        scaled = np.concatenate(([1.0], solution[:order]))
        if np.all(np.isfinite(scaled)) and scaled[-1] != 0.0:
            poles = np.roots(scaled[::-1]) * cut_off
            found.append(-np.maximum(np.abs(poles.real), 1e-3 * np.abs(poles)) + 1j * poles.imag)
    return found


def _from_poles(shape: Structure, poles: Poles) -> list[Signal]:
    """Return the positive parameters of a denominator with these poles, or none."""
    descending = np.real(np.poly(poles))
    with np.errstate(all="ignore"):
        try:
            dynamics = shape.from_denominator(1.0, np.asarray(descending[::-1] / descending[-1]))[1:]
        except UnstableModelError:
            return []
    return [dynamics] if np.all(np.isfinite(dynamics)) and np.all(dynamics > 0.0) else []


# Fit -----------------------------------------------------------------------------------------------
# Parameters of one output: choice of the estimator, starts, and noise model, as with one input.


_NOISE_ROUNDS = 6
_NOISE_SETTLED = 0.05
_STARTS_TRIED = 4
_CLEARLY_BETTER = 0.999
METHODS = (Method.DEFAULT, Method.SRIVC, Method.RIVC, Method.OUTPUT_ERROR)
"""Estimators for two inputs."""


@dataclass(frozen=True)
class TwoInputFit:
    """A solution and its noise-free input (n, 2).

    Without ``drive`` the applied inputs are free of noise, and serve as instruments themselves.
    """

    solution: TwoInputEvaluation
    drive: Signal | None

    @property
    def problem(self) -> TwoInputProblem:
        """Record, structure and noise model of the solution."""
        return self.solution.problem

    @property
    def parameters(self) -> Signal:
        """Parameters of the solution, shape (p,)."""
        return self.solution.parameters

    @property
    def method(self) -> str:
        """Name of the estimator for people."""
        noise_order = self.problem.whitening.size - 1
        if self.drive is not None:
            return messages.refined_iv_in_closed_loop(noise_order=noise_order, is_low_pass=False)
        return messages.output_error(noise_order=noise_order, is_low_pass=False)

    @cached_property
    def residuals(self) -> Signal:
        """Whitened output error without the nuisance terms, shape (n,)."""
        return self.solution.without_nuisance(self.solution.error[:, np.newaxis])[:, 0]

    @cached_property
    def sensitivities(self) -> Signal:
        """Derivatives by the parameters themselves, without the nuisance terms, (n, p)."""
        return self.solution.without_nuisance(self.solution.sensitivities) / self._scale

    @cached_property
    def instruments(self) -> Signal:
        """Instruments without the nuisance terms, (n, p)."""
        if self.drive is None:
            return self.sensitivities
        return self.solution.without_nuisance(self.solution.instruments(self.drive)) / self._scale

    @property
    def _scale(self) -> Signal:
        linear = self.solution.linear
        return np.concatenate((np.ones(linear), self.parameters[linear:]))

    def input_correlation(self, channel: int) -> CorrelationTest:
        """Test whether the residuals depend on one input, over five times the sum of lags."""
        u = (self.problem.u if self.drive is None else self.drive)[:, channel]
        sum_of_lags = float(self.problem.shape.denominator_of(self.parameters)[1])
        return input_correlation(self.residuals, self.problem.whiten(u), self.problem.period_s, sum_of_lags)

    def whiteness(self) -> CorrelationTest:
        """Test whether the residuals are white."""
        return whiteness(self.residuals, self.problem.period_s)

    @property
    def is_independent_of_inputs(self) -> bool:
        """Whether the residuals are uncorrelated with both inputs."""
        return all(self.input_correlation(channel).passed for channel in (0, 1))


def fit_two_inputs(problem: TwoInputProblem, method: Method, external: Signal | None = None) -> TwoInputFit:
    """Estimate the parameters of one output.

    ``external`` (n, 2) are signals of the loop free of noise, if there is one; the refined-IV methods reconstruct both
    inputs from them. The methods are those of one input; DEFAULT and RIVC model coloured residuals as autoregressive,
    DEFAULT only if the residuals then are independent of both inputs. Raises NoStartError, NotConvergedError,
    StructureError.
    """
    if method not in METHODS:
        raise StructureError(messages.method_for_one_input_only(method=method.value))
    drive = None
    if external is not None and method is not Method.OUTPUT_ERROR:
        fitted = [fit_input(problem.u[:, channel], external, problem.period_s) for channel in (0, 1)]
        drive = np.column_stack([u - np.mean(u) for u in fitted])
    first = _fit_from_starts(problem, drive)
    if method in (Method.OUTPUT_ERROR, Method.SRIVC) or (method is Method.DEFAULT and first.whiteness().passed):
        return first
    if method is Method.RIVC:
        return _fit_with_noise_model(first)
    try:
        coloured = _fit_with_noise_model(first)
    except (NotConvergedError, UnstableModelError):
        return first
    # Residuals that still depend on an input come from missing dynamics, not from noise: whitening them would trade
    # accuracy at low frequency, where the model is used, for accuracy near the sampling rate.
    return coloured if coloured.is_independent_of_inputs else first


def refit_part(found: TwoInputFit, start: int, stop: int) -> TwoInputEvaluation:
    """Adapt a solution to a part of its record, by output error with the same noise model."""
    return adapt_evaluation(TwoInputEvaluation(found.problem.part(start, stop), found.parameters))


def _fit_from_starts(problem: TwoInputProblem, drive: Signal | None, *further: Signal) -> TwoInputFit:
    """Return the best solution from several starts."""
    best = None
    for start in rank_starts(problem, *further)[:_STARTS_TRIED]:
        try:
            found = minimize_output_error(TwoInputEvaluation(problem, start), FINE if drive is None else COARSE)
        except (NotConvergedError, UnstableModelError):
            continue
        if best is None or found.cost < _CLEARLY_BETTER * best.cost:
            best = found
    if best is None:
        raise NotConvergedError(messages.no_minimum_found(structure=problem.structure.name))
    return _with_instruments(best, drive)


def _fit_with_noise_model(first: TwoInputFit) -> TwoInputFit:
    """Alternate between the parameters and the noise model until they converge."""
    found, linear = first, first.solution.linear
    for _ in range(_NOISE_ROUNDS):
        plain = TwoInputFit(TwoInputEvaluation(replace(found.problem, whitening=WHITE), found.parameters), None)
        problem = replace(first.problem, whitening=fit_autoregression(plain.residuals))
        tolerance = FINE if first.drive is None else COARSE
        near = minimize_output_error(TwoInputEvaluation(problem, found.parameters), tolerance)
        before, found = found, _with_instruments(near, first.drive)
        if before is first and not found.is_independent_of_inputs:
            # Under the noise the first solution may be in a local minimum that the whitened one shows to be wrong.
            found = _fit_from_starts(problem, first.drive, before.parameters)
        step = difference(before.parameters, found.parameters, linear)
        change = float(np.linalg.norm(found.solution.without_nuisance(found.solution.sensitivities) @ step))
        if change < _NOISE_SETTLED * found.solution.noise:
            break
    return found


def _with_instruments(near: TwoInputEvaluation, drive: Signal | None) -> TwoInputFit:
    """Continue with refined IV if there are instruments; if it fails, output error."""
    if drive is None:
        return TwoInputFit(near, None)

    def noise_free_input(_: Signal) -> Signal:
        return drive

    try:
        return TwoInputFit(fit_refined_iv(near, noise_free_input), drive)
    except (NotConvergedError, UnstableModelError):
        return TwoInputFit(minimize_output_error(near, FINE), None)
