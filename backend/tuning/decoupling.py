"""Existence of the dynamic decoupling: conditions with their figures, and the filters.

Inverted decoupling of A_i y_i = B_i1 u_1 + B_i2 u_2: u_1 = v_1 + d_12 u_2 and u_2 = v_2 + d_21 u_1 with d_12 =
−B_12/B_11, d_21 = −B_21/B_22 leave g_11 and g_22 to the loops (Wade 1997; Garrido, Vázquez and Morilla 2011). Both
filters must be stable themselves, not only as connected: a limited input opens their loop.

Every condition has a distance to its boundary in standard errors of the model: the smallest δ with δᵀ Σ⁻¹ δ = distance²
that moves the coefficients to the boundary. Zeros reach the imaginary axis where B(jω) = 0, two linear equations in the
coefficients, so that the distance is exact for B_ii, also for multiple zeros, and linearized for the determinant.
"""

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control.dynamic_decoupler import DynamicDecoupler
from backend.tuning import messages
from backend.tuning.coupled_model import Array, CoupledModel, find_zeros, multiply, trim
from backend.tuning.decoupling_filters import (
    MAX_ORDER,
    largest_pole,
    least_principal_minor,
    make_residual_filter,
    make_static_part,
)
from plant import Message, T_s

# Outcome -------------------------------------------------------------------------------------------


CERTAIN_DISTANCE = 2.0
"""Standard errors from its boundary at which a condition is certain."""


class DecouplingConditionKind(StrEnum):
    """What a condition bounds."""

    RELATIVE_DEGREE = "relative_degree"
    DIAGONAL_ZEROS = "diagonal_zeros"
    DETERMINANT_ZEROS = "determinant_zeros"
    FAST_ZEROS = "fast_zeros"
    FILTER_ORDER = "filter_order"
    HIGH_FREQUENCY_GAIN = "high_frequency_gain"
    SAMPLED_GAIN = "sampled_gain"
    ALGEBRAIC_LOOP = "algebraic_loop"
    INTERCONNECTION = "interconnection"


@dataclass(frozen=True)
class DecouplingCondition:
    """Condition of the dynamic decoupling: its ``figure`` of ``element``, and whether it holds.

    ``distance`` [standard errors of the model] to the boundary; inf for an exact model.
    """

    kind: DecouplingConditionKind
    element: str
    figure: float
    holds: bool
    distance: float
    text: Message

    @property
    def is_certain(self) -> bool:
        """Return whether 2 standard errors of the model leave the condition as it is."""
        return self.distance >= CERTAIN_DISTANCE

    def describe(self) -> Message:
        """Return the condition with its figure, and its distance if it is uncertain."""
        if self.is_certain:
            return self.text
        return messages.within_standard_errors(condition=self.text, distance=self.distance)


@dataclass(frozen=True)
class StaticCoupling:
    """Gains d_12(0) = −g_12(0)/g_11(0) [rad per N·m/rad] and d_21(0) [N·m/rad per rad], with standard errors.

    They belong to the static decoupler; significant ones show that it differs from the actuator.
    """

    d_12: float
    d_21: float
    error_12: float
    error_21: float

    @property
    def is_significant(self) -> bool:
        """Return whether a gain exceeds two of its standard errors."""
        return abs(self.d_12) > CERTAIN_DISTANCE * self.error_12 or abs(self.d_21) > CERTAIN_DISTANCE * self.error_21


@dataclass(frozen=True)
class Decoupling:
    """Result of ``design_decoupling``: ``decoupler`` is None for static decoupling only.

    ``static`` is None if a static gain of the diagonal is zero. ``swapped`` are the conditions of the other pairing.
    """

    decoupler: DynamicDecoupler | None
    static: StaticCoupling | None
    conditions: tuple[DecouplingCondition, ...]
    swapped: tuple[DecouplingCondition, ...]

    @property
    def failed(self) -> tuple[DecouplingCondition, ...]:
        """Return the conditions that do not hold."""
        return tuple(condition for condition in self.conditions if not condition.holds)

    @property
    def uncertain(self) -> tuple[DecouplingCondition, ...]:
        """Return the conditions that hold, but that 2 standard errors of the model reverse."""
        return tuple(condition for condition in self.conditions if condition.holds and not condition.is_certain)

    @property
    def can_swap(self) -> bool:
        """Return whether the other pairing satisfies all conditions."""
        return all(condition.holds for condition in self.swapped)

    def describe(self) -> Message:
        """Return the outcome: filters with uncertain conditions, or static only with failed ones."""
        if self.decoupler is not None:
            return messages.filters_exist(uncertain=[condition.describe() for condition in self.uncertain])
        return messages.static_only(reasons=[condition.describe() for condition in self.failed], can_swap=self.can_swap)


def design_decoupling(model: CoupledModel, period_s: float = T_s) -> Decoupling:
    """Return the filters of a model if all conditions hold, the conditions, and the static part."""
    conditions, decoupler = _check(model, period_s)
    if not all(condition.holds for condition in conditions):
        decoupler = None
    swapped, _ = _check(model.swap_inputs(), period_s)
    return Decoupling(decoupler, estimate_static_coupling(model), conditions, swapped)


def estimate_static_coupling(model: CoupledModel) -> StaticCoupling | None:
    """Return the static gains of the decoupling, None if g_11(0) or g_22(0) is zero."""
    B_11, B_12, B_21, B_22 = (float(model.numerator(i, j)[-1]) for i in (0, 1) for j in (0, 1))
    if B_11 == 0.0 or B_22 == 0.0:
        return None
    ends = np.cumsum([len(numerator) for row in model.numerators for numerator in row]) - 1
    gradient = np.zeros((2, int(ends[-1]) + 1))
    gradient[0, ends[0]], gradient[0, ends[1]] = B_12 / B_11**2, -1.0 / B_11
    gradient[1, ends[3]], gradient[1, ends[2]] = B_21 / B_22**2, -1.0 / B_22
    variances = np.diag(gradient @ model.numerator_covariance() @ gradient.T)
    errors = np.sqrt(np.maximum(variances, 0.0))
    # + 0.0: no coupling has the gain 0, not -0
    return StaticCoupling(-B_12 / B_11 + 0.0, -B_21 / B_22 + 0.0, float(errors[0]), float(errors[1]))


# Polynomials ---------------------------------------------------------------------------------------


_COMMON = 1e-6
"""Relative distance of two zeros that count as one. Zeros of identified polynomials are never that close by chance."""


Points = NDArray[np.complex128]


class _Polynomials(NamedTuple):
    """Numerators without the factors that both of a row share, and the determinant B_11 B_22 − B_12 B_21.

    ``is_certain``: no factor with a zero in the right half-plane was removed from identified polynomials.
    """

    B_11: Array
    B_12: Array
    B_21: Array
    B_22: Array
    determinant: Array
    is_certain: bool


def _reduce(model: CoupledModel) -> _Polynomials:
    B_11, B_12, unstable_1 = _cancel(model.numerator(0, 0), model.numerator(0, 1))
    B_22, B_21, unstable_2 = _cancel(model.numerator(1, 1), model.numerator(1, 0))
    is_exact = not model.numerator_covariance().any()
    determinant = _subtract(multiply(B_11, B_22), multiply(B_12, B_21))
    return _Polynomials(B_11, B_12, B_21, B_22, determinant, is_exact or not (unstable_1 or unstable_2))


def _cancel(diagonal: Array, coupling: Array) -> tuple[Array, Array, bool]:
    """Return both polynomials without common zeros; whether one of those was unstable."""
    if not coupling.any():
        return diagonal[:1], coupling, False
    zeros, others = find_zeros(diagonal).tolist(), find_zeros(coupling).tolist()
    kept, is_unstable = [], False
    for zero in zeros:
        nearest = min(others, key=lambda other: abs(other - zero), default=None)
        if nearest is not None and abs(nearest - zero) <= _COMMON * max(abs(zero), abs(nearest)):
            others.remove(nearest)
            is_unstable = is_unstable or zero.real >= 0.0
        else:
            kept.append(zero)
    if len(kept) == len(zeros):
        return diagonal, coupling, False
    return (
        diagonal[0] * np.atleast_1d(np.real(np.poly(kept))),
        coupling[0] * np.atleast_1d(np.real(np.poly(others))),
        is_unstable,
    )


def _subtract(p: Array, q: Array) -> Array:
    """Return p − q without leading coefficients that are rounding errors."""
    size = max(p.size, q.size)
    padded_p = np.concatenate([np.zeros(size - p.size), p])
    padded_q = np.concatenate([np.zeros(size - q.size), q])
    difference = padded_p - padded_q
    return trim(np.where(np.abs(difference) > 1e-13 * (np.abs(padded_p) + np.abs(padded_q)), difference, 0.0))


def _shift_rows(p: Array, count: int) -> Array:
    """Return the coefficients of p s^k for k = count − 1 to 0, shape (count, count + size − 1)."""
    rows = np.zeros((count, count + p.size - 1))
    for k in range(count):
        rows[k, k : k + p.size] = p
    return rows


# Distances -----------------------------------------------------------------------------------------


def _least_distance(polynomial: Array, gradient: Array, covariance: Array, s: Points) -> float:
    """Return the standard errors that put a zero of ``polynomial`` at one of the points ``s`` (n,), or at infinity.

    ``gradient`` (m, k) has the derivative of the polynomial by each of m coefficients with ``covariance`` (m, m).
    """
    if not covariance.any():
        return math.inf
    value = np.append(np.polyval(polynomial, s), polynomial[0])
    slope = np.array([np.append(np.polyval(row, s), row[row.size - polynomial.size]) for row in gradient])
    x = np.stack([value.real, value.imag])
    J = np.stack([slope.real, slope.imag])
    spread = np.einsum("imn,mk,jkn->nij", J, covariance, J)
    # The addition makes the matrix regular where a part of the value is certain.
    spread += 1e-16 * np.sum(x**2, axis=0)[:, None, None] * np.eye(2) + np.finfo(float).tiny * np.eye(2)
    squares = np.einsum("in,nij,jn->n", x, np.linalg.inv(spread), x)
    return _unless_exact(math.sqrt(max(float(np.min(squares)), 0.0)))


def _unless_exact(distance: float) -> float:
    return math.inf if distance > 1e7 else distance


def _imaginary_axis(*polynomials: Array) -> Array:
    """Return frequencies [rad/s] that resolve the zeros of the polynomials, with 0."""
    zeros = np.concatenate([find_zeros(polynomial) for polynomial in polynomials])
    moduli = np.abs(zeros[zeros != 0.0])
    if not moduli.size:
        return np.zeros(1)
    grid = np.geomspace(1e-3 * np.min(moduli), 1e3 * np.max(moduli), 1500)
    return np.unique(np.concatenate([[0.0], grid, np.abs(zeros.imag)]))


def _axis_points(polynomial: Array) -> Points:
    return np.asarray(1j * _imaginary_axis(polynomial), dtype=np.complex128)


def _determinant_gradient(model: CoupledModel) -> tuple[Array, Array]:
    """Return the determinant of all numerators, and its derivative by each coefficient."""
    B_11, B_12, B_21, B_22 = (model.full_numerator(i, j) for i in (0, 1) for j in (0, 1))
    products = multiply(B_11, B_22), multiply(B_12, B_21)
    blocks = [
        _shift_rows(B_22, B_11.size),
        -_shift_rows(B_21, B_12.size),
        -_shift_rows(B_12, B_21.size),
        _shift_rows(B_11, B_22.size),
    ]
    size = max(block.shape[1] for block in blocks)
    gradient = np.vstack([np.pad(block, ((0, 0), (size - block.shape[1], 0))) for block in blocks])
    return _subtract(*products), gradient


# Conditions ----------------------------------------------------------------------------------------


def check_conditions(model: CoupledModel, period_s: float = T_s) -> tuple[DecouplingCondition, ...]:
    """Return the conditions of the decoupling of a model.

    A zero g_11 or g_22 has the relative degrees alone. Without filters, because of relative degrees, orders or a static
    gain of zero, their algebraic loop and their interconnection have no figure and are absent.
    """
    return _check(model, period_s)[0]


def _check(model: CoupledModel, period_s: float) -> tuple[tuple[DecouplingCondition, ...], DynamicDecoupler | None]:
    degrees = (_check_relative_degree(model, 0), _check_relative_degree(model, 1))
    if not (model.numerator(0, 0).any() and model.numerator(1, 1).any()):
        return degrees, None
    reduced = _reduce(model)
    conditions = [
        *degrees,
        _check_diagonal_zeros(model, 0, reduced.B_11, reduced.is_certain),
        _check_diagonal_zeros(model, 1, reduced.B_22, reduced.is_certain),
        _check_determinant_zeros(model, reduced),
        _check_fast_zeros(model, 0, reduced.B_11, period_s),
        _check_fast_zeros(model, 1, reduced.B_22, period_s),
        _check_order("d_12", reduced.B_11),
        _check_order("d_21", reduced.B_22),
        *_check_gains(model, reduced, period_s),
    ]
    decoupler = None
    if (
        all(condition.holds for condition in conditions if condition.kind in _NEEDED)
        and reduced.B_11[-1] != 0.0
        and reduced.B_22[-1] != 0.0
        and reduced.determinant[-1] != 0.0
    ):
        decoupler = _make_decoupler(reduced, period_s)
        conditions += _check_interconnection(model, decoupler, period_s)
    return tuple(conditions), decoupler


_NEEDED = (DecouplingConditionKind.RELATIVE_DEGREE, DecouplingConditionKind.FILTER_ORDER)
"""Conditions without which filters cannot be computed."""


def _make_decoupler(reduced: _Polynomials, period_s: float) -> DynamicDecoupler:
    return DynamicDecoupler(
        make_residual_filter(reduced.B_12, reduced.B_11, period_s),
        make_residual_filter(reduced.B_21, reduced.B_22, period_s),
        make_static_part(-reduced.B_12[-1] / reduced.B_11[-1] + 0.0, -reduced.B_21[-1] / reduced.B_22[-1] + 0.0),
    )


def _check_relative_degree(model: CoupledModel, i: int) -> DecouplingCondition:
    """Compare degrees: g_ij and g_ii have the same denominator."""
    diagonal, coupling = model.numerator(i, i), model.numerator(i, 1 - i)
    element, reference = f"g_{i + 1}{2 - i}", f"g_{i + 1}{i + 1}"
    if not diagonal.any():
        difference = -math.inf
    else:
        difference = math.inf if not coupling.any() else float(diagonal.size - coupling.size)
    holds = difference >= 0.0
    distance = math.inf
    if math.isfinite(difference):
        # All leading coefficients of the polynomial that decides must be zero to reverse the condition.
        decides, j = (diagonal, i) if holds else (coupling, 1 - i)
        count = int(difference) + 1 if holds else int(-difference)
        distance = _leading_distance(model, i, j, decides[:count], decides.size)
    return DecouplingCondition(
        DecouplingConditionKind.RELATIVE_DEGREE,
        element,
        difference,
        holds,
        distance,
        messages.relative_degree_condition(element=element, reference=reference, difference=difference),
    )


def _leading_distance(model: CoupledModel, i: int, j: int, leading: Array, size: int) -> float:
    """Return the standard errors that make all ``leading`` coefficients of B_ij zero."""
    counts = [len(numerator) for row in model.numerators for numerator in row]
    first = sum(counts[: 2 * i + j]) + counts[2 * i + j] - size
    covariance = model.numerator_covariance()[first : first + leading.size, first : first + leading.size]
    if not covariance.any():
        return math.inf
    regular = covariance + 1e-16 * np.diag(leading**2) + np.finfo(float).tiny * np.eye(leading.size)
    return _unless_exact(math.sqrt(max(float(leading @ np.linalg.solve(regular, leading)), 0.0)))


def _check_diagonal_zeros(model: CoupledModel, i: int, reduced: Array, is_certain: bool) -> DecouplingCondition:
    element = f"g_{i + 1}{i + 1}"
    figure = float(np.max(find_zeros(reduced).real, initial=-math.inf))
    distance = math.inf
    if reduced.size > 1:
        polynomial = model.numerator(i, i)
        distance = _own_distance(model, i, _axis_points(polynomial))
    return DecouplingCondition(
        DecouplingConditionKind.DIAGONAL_ZEROS,
        element,
        figure,
        figure < 0.0,
        distance if is_certain else 0.0,
        messages.right_half_plane_condition(element=element, real_part=figure),
    )


def _own_distance(model: CoupledModel, i: int, s: Points) -> float:
    """Return ``_least_distance`` of B_ii."""
    counts = [len(numerator) for row in model.numerators for numerator in row]
    first = sum(counts[: 3 * i])
    covariance = model.numerator_covariance()[first : first + counts[3 * i], first : first + counts[3 * i]]
    return _least_distance(model.numerator(i, i), np.eye(counts[3 * i]), covariance, s)


def _check_determinant_zeros(model: CoupledModel, reduced: _Polynomials) -> DecouplingCondition:
    is_zero = not reduced.determinant.any()
    figure = math.inf if is_zero else float(np.max(find_zeros(reduced.determinant).real, initial=-math.inf))
    distance = 0.0 if is_zero else _determinant_distance(model)
    return DecouplingCondition(
        DecouplingConditionKind.DETERMINANT_ZEROS,
        "det G",
        figure,
        figure < 0.0,
        distance if reduced.is_certain else 0.0,
        messages.right_half_plane_condition(element="det G", real_part=figure),
    )


def _determinant_distance(model: CoupledModel) -> float:
    determinant, gradient = _determinant_gradient(model)
    return _least_distance(determinant, gradient, model.numerator_covariance(), _axis_points(determinant))


def _check_fast_zeros(model: CoupledModel, i: int, reduced: Array, period_s: float) -> DecouplingCondition:
    """Bound the zeros of B_ii, the poles of the filter, by 2/T, which the bilinear transform maps to z = 0."""
    element, maximum = f"g_{i + 1}{i + 1}", 2.0 / period_s
    figure = float(np.max(np.abs(find_zeros(reduced)), initial=0.0))
    distance = math.inf
    if reduced.size > 1:
        circle = np.exp(1j * np.linspace(0.0, np.pi, 400))
        distance = _own_distance(model, i, np.asarray(maximum * circle, dtype=np.complex128))
    return DecouplingCondition(
        DecouplingConditionKind.FAST_ZEROS,
        element,
        figure,
        figure <= maximum,
        distance,
        messages.fast_zero_condition(element=element, modulus=figure, maximum=maximum),
    )


def _check_order(element: str, reduced: Array) -> DecouplingCondition:
    order = reduced.size - 1
    return DecouplingCondition(
        DecouplingConditionKind.FILTER_ORDER,
        element,
        float(order),
        order <= MAX_ORDER,
        math.inf,
        messages.filter_order_condition(element=element, order=order, maximum=MAX_ORDER),
    )


def _check_gains(
    model: CoupledModel, reduced: _Polynomials, period_s: float
) -> tuple[DecouplingCondition, DecouplingCondition]:
    """Bound |κ| = |g_12 g_21/(g_11 g_22)| at high frequency, and at each frequency of the sampled filters.

    The bilinear transform moves the sampled frequencies up to π/T to the whole axis, which is the range.
    """
    coupling, diagonal = multiply(reduced.B_12, reduced.B_21), multiply(reduced.B_11, reduced.B_22)
    if not coupling.any() or coupling.size < diagonal.size:
        high = 0.0
    else:
        high = float(abs(coupling[0] / diagonal[0])) if coupling.size == diagonal.size else math.inf
    omega = _imaginary_axis(coupling, diagonal, np.array([1.0, 2.0 / period_s]))
    with np.errstate(divide="ignore", invalid="ignore"):
        gains = np.append(np.abs(np.polyval(coupling, 1j * omega) / np.polyval(diagonal, 1j * omega)), high)
    gains = np.where(np.isnan(gains), math.inf, gains)
    peak = float(np.max(gains))
    distances = _gain_distances(model, omega, gains)
    return (
        DecouplingCondition(
            DecouplingConditionKind.HIGH_FREQUENCY_GAIN,
            "g_12 g_21/(g_11 g_22)",
            high,
            high < 1.0,
            float(distances[-1]),
            messages.high_frequency_gain_condition(gain=high),
        ),
        DecouplingCondition(
            DecouplingConditionKind.SAMPLED_GAIN,
            "g_12 g_21/(g_11 g_22)",
            peak,
            peak < 1.0,
            float(np.min(distances) if peak < 1.0 else np.max(distances[gains >= 1.0])),
            messages.sampled_gain_condition(gain=peak),
        ),
    )


def _gain_distances(model: CoupledModel, omega: Array, gains: Array) -> Array:
    """Return the standard errors between |κ| and 1 at each frequency, and at the end at a very high one."""
    covariance = model.numerator_covariance()
    if not covariance.any():
        return np.full(gains.size, math.inf)
    s = 1j * np.append(omega, 1e6 * max(float(omega[-1]), 1.0))
    B = [model.full_numerator(i, j) for i in (0, 1) for j in (0, 1)]
    powers = [np.array([s**k for k in range(p.size - 1, -1, -1)]) for p in B]
    B_11, B_12, B_21, B_22 = (np.polyval(p, s) for p in B)
    with np.errstate(divide="ignore", invalid="ignore"):
        kappa = B_12 * B_21 / (B_11 * B_22)
        gradient = np.vstack(
            [
                -kappa / B_11 * powers[0],
                B_21 / (B_11 * B_22) * powers[1],
                B_12 / (B_11 * B_22) * powers[2],
                -kappa / B_22 * powers[3],
            ]
        )
        direction = np.where(np.abs(kappa) > 0.0, np.conj(kappa) / np.abs(kappa), 1.0)
        slope = np.real(direction * gradient)
        error = np.sqrt(np.maximum(np.einsum("mn,mk,kn->n", slope, covariance, slope), 0.0))
        distances = np.abs(1.0 - gains) / error
    distances = np.where(np.isnan(distances), 0.0, distances)
    return np.where(distances > 1e7, math.inf, distances)


def _check_interconnection(
    model: CoupledModel, decoupler: DynamicDecoupler, period_s: float
) -> tuple[DecouplingCondition, DecouplingCondition]:
    """Check the sampled filters as connected, by their own equations."""
    minor = least_principal_minor(decoupler)
    modulus = largest_pole(decoupler) if minor != 0.0 else math.inf
    determinant, gradient = _determinant_gradient(model)
    corner = np.array([2.0 / period_s + 0j])
    return (
        DecouplingCondition(
            DecouplingConditionKind.ALGEBRAIC_LOOP,
            "d_12 d_21",
            minor,
            minor > 0.0,
            _least_distance(determinant, gradient, model.numerator_covariance(), corner),
            messages.algebraic_loop_condition(minor=minor),
        ),
        DecouplingCondition(
            DecouplingConditionKind.INTERCONNECTION,
            "d_12 d_21",
            modulus,
            modulus < 1.0,
            _determinant_distance(model),
            messages.interconnection_condition(modulus=modulus),
        ),
    )
