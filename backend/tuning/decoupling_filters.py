"""Sampled filters of the dynamic decoupler: from polynomials to sections, in state space, and per bank entry.

The bilinear transform s = (2/T) (z − 1)/(z + 1) maps the imaginary axis to the unit circle, so that stability and
|g_12 g_21/(g_11 g_22)| < 1 hold for the sampled filters exactly where they hold for the model. Its error is of second
order in ω T. The filter and the process that follow the same hold then cancel without the delay of half a sample that a
zero-order hold of the filter would add; the ratio of the processes behind the hold, which would be exact, has poles
outside the unit circle wherever g_11 has a relative degree above 2.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import dynamic_decoupler
from backend.control.dynamic_decoupler import (
    COLUMNS,
    NO_FILTER,
    STATIC_ONLY,
    DynamicDecoupler,
    DynamicDecouplerState,
    HighPassSection,
    ResidualFilter,
    ResidualState,
    SecondOrderSection,
    StaticPart,
)
from backend.tuning import messages
from backend.tuning.coupled_model import Array, find_zeros, trim
from backend.tuning.gains import TuningError
from plant import T_s

# Sections ------------------------------------------------------------------------------------------


MAX_ORDER = 4
"""Largest order of a filter: the ratio of two motor loops with four lags each."""

_NEGLIGIBLE = 1e-13
"""Share of the largest coefficient, all weighed at s = 2/T, below which a leading one is a rounding error."""


def make_residual_filter(B_coupling: Array, B_diagonal: Array, period_s: float = T_s) -> ResidualFilter:
    """Return −B_coupling/B_diagonal minus its static gain, sampled with the bilinear transform.

    Polynomials in s, the highest power first; B_diagonal has at most MAX_ORDER zeros, none of them 0, and at least as
    many as B_coupling. The slow poles and the zero at zero frequency are in the first section.
    """
    order = B_diagonal.size - 1
    padded = np.concatenate([np.zeros(order + 1 - B_coupling.size), B_coupling])
    numerator = -(padded - padded[-1] / B_diagonal[-1] * B_diagonal)
    numerator[-1] = 0.0
    weight = np.abs(numerator) * (2.0 / period_s) ** np.arange(order, -1, -1)
    reference = np.max(np.abs(padded) * (2.0 / period_s) ** np.arange(order, -1, -1))
    numerator = trim(np.where(weight > _NEGLIGIBLE * reference, numerator, 0.0))
    if not numerator.any():
        return NO_FILTER
    poles, zeros = find_zeros(B_diagonal), find_zeros(trim(numerator[:-1]))
    slow, fast = _split_poles(poles)
    first_zeros, second_zeros = _split_zeros(zeros, slow.size - 1, fast.size)
    s_c = float(np.exp(np.mean(np.log(np.abs(fast))))) if fast.size else 1.0
    second_numerator, second_denominator = _unit_polynomial(second_zeros, s_c), _unit_polynomial(fast, s_c)
    first_denominator = _unit_polynomial(slow, 1.0)
    first_numerator = np.append(np.real(np.poly(first_zeros)), 0.0)
    # Both products equal the polynomials up to the ratio of the leading coefficients, which the first section gets.
    wanted = numerator[0] / B_diagonal[0]
    found = first_numerator[0] * second_numerator[0] / (first_denominator[0] * second_denominator[0])
    first_numerator *= wanted / found
    (b_0, b_1, _), (a_1, a_2) = _sample(first_numerator, first_denominator, period_s)
    second_b, second_a = _sample(second_numerator, second_denominator, period_s)
    return ResidualFilter(HighPassSection(a_1, a_2, b_0, b_1), SecondOrderSection(*second_a, *second_b))


def _split_poles(poles: NDArray[np.complex128]) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the poles of both sections, slow ones first.

    Complex pairs stay together. Of three poles the first section has one, so that any zeros fit to both sections.
    """
    poles = poles[np.argsort(np.abs(poles), kind="stable")]
    is_pair = np.abs(poles.imag) > 0.0
    if poles.size <= 2:
        return poles, poles[:0]
    if poles.size == 3:
        single = int(np.flatnonzero(~is_pair)[0])
        return poles[[single]], np.delete(poles, single)
    if is_pair.all() or not is_pair.any():
        return poles[:2], poles[2:]  # conjugates have equal moduli, so that a stable sort keeps them adjacent
    pair, real = poles[is_pair], poles[~is_pair]
    return (pair, real) if abs(pair[0]) <= abs(real[0]) else (real, pair)


def _split_zeros(
    zeros: NDArray[np.complex128], order_first: int, order_second: int
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the zeros of both sections, apart from the one at zero frequency; complex pairs in the second."""
    zeros = zeros[np.argsort(np.abs(zeros), kind="stable")]
    is_pair = np.abs(zeros.imag) > 0.0
    zeros = np.concatenate([zeros[~is_pair], zeros[is_pair]])
    split = min(order_first, max(zeros.size - order_second, 0))
    return zeros[:split], zeros[split:]


def _unit_polynomial(roots: NDArray[np.complex128], scale: float) -> Array:
    """Return the product of (1 − s/root), with s/scale for a root 0."""
    polynomial = np.ones(1, dtype=np.complex128)
    for root in roots:
        factor = [-1.0 / root, 1.0] if root != 0.0 else [1.0 / scale, 0.0]
        polynomial = np.convolve(polynomial, np.array(factor, dtype=np.complex128))
    return np.asarray(polynomial.real, dtype=np.float64)


def _sample(
    numerator: Array, denominator: Array, period_s: float
) -> tuple[tuple[float, float, float], tuple[float, float]]:
    """Return b_0, b_1, b_2 and a_1, a_2 of the bilinear transform in δ = z − 1.

    s = (2/T) δ/(δ + 2). A section of lower order gets common factors δ + 1: unreachable states that vanish at once.
    """
    order = denominator.size - 1
    K = 2.0 / period_s

    def transform(polynomial: Array) -> Array:
        result = np.zeros(order + 1)
        for power, coefficient in enumerate(polynomial[::-1]):
            result += (
                coefficient * K**power * np.append([[1.0], [1.0, 2.0], [1.0, 4.0, 4.0]][order - power], [0.0] * power)
            )
        return np.convolve(result, [[1.0, 2.0, 1.0], [1.0, 1.0], [1.0]][order])

    b, a = transform(numerator), transform(denominator)
    b, a = b / a[0], a / a[0]
    return (float(b[0]), float(b[1]), float(b[2])), (float(a[1]), float(a[2]))


# State space ---------------------------------------------------------------------------------------


class SampledSystem(NamedTuple):
    """Sampled system x⁺ = A x + B v, u = C x + D v."""

    A: Array
    B: Array
    C: Array
    D: Array

    def response(self, z: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the frequency response at points ``z`` (n,), shape (n, outputs, inputs)."""
        resolvent = z[:, None, None] * np.eye(len(self.A)) - self.A
        states = np.linalg.solve(resolvent, np.broadcast_to(self.B, (z.size, *self.B.shape)))
        return np.asarray(self.C @ states + self.D, dtype=np.complex128)


_STATES = 10


def make_state_space(d: DynamicDecoupler) -> SampledSystem:
    """Return the decoupler from (v_q, v_S) to (q_c, S_c), without limits.

    The compiled step is linear; its values for unit vectors are the columns of the matrices. The states are those of
    r_12 and r_21, then the inputs of the previous step.
    """
    columns = []
    for vector in np.eye(_STATES + 2):
        x = [float(value) for value in vector]
        state = DynamicDecouplerState(ResidualState(*x[:4]), ResidualState(*x[4:8]), q_c=x[8], S_c=x[9])
        q_c, S_c, after = dynamic_decoupler.step(d, state, x[10], x[11])
        columns.append([*after.r_12, *after.r_21, after.q_c, after.S_c, q_c, S_c])
    joint = np.array(columns).T
    return SampledSystem(
        joint[:_STATES, :_STATES], joint[:_STATES, _STATES:], joint[_STATES:, :_STATES], joint[_STATES:, _STATES:]
    )


def largest_pole(d: DynamicDecoupler) -> float:
    """Return the largest modulus of the poles of both connected filters."""
    return float(np.max(np.abs(np.linalg.eigvals(make_state_space(d).A))))


def least_principal_minor(d: DynamicDecoupler) -> float:
    """Return the least principal minor of the algebraic loop of ``dynamic_decoupler.solve_inputs``."""
    F_12, F_21 = d.r_12.first.b_0 * d.r_12.second.b_0, d.r_21.first.b_0 * d.r_21.second.b_0
    M = d.static
    A = np.eye(2) - np.array([[0.0, F_12], [F_21, 0.0]]) @ np.array([[M.q_q, M.q_S], [M.S_q, M.S_S]])
    return float(min(A[0, 0], A[1, 1], np.linalg.det(A)))


# Schedule ------------------------------------------------------------------------------------------


_SHARES = np.linspace(0.0, 1.0, 11)[1:-1]


def build_schedule(decouplers: Sequence[DynamicDecoupler | None]) -> Array:
    """Return the rows of the bank's entries, shape (n, COLUMNS), for ``interpolate_decoupler``.

    ``decouplers`` are sorted by nominal stiffness; None decouples statically only. Such an entry has the poles of the
    nearest other entry and gain 0, so that the filters fade out towards it. Raises TuningError if the filters are
    unstable, or their algebraic loop has no unique solution, between two entries.
    """
    if not decouplers:
        raise TuningError(messages.no_entries())
    existing = [k for k, d in enumerate(decouplers) if d is not None]
    entries = np.empty((len(decouplers), COLUMNS))
    for k, d in enumerate(decouplers):
        if d is None and existing:
            nearest = decouplers[min(existing, key=lambda other: abs(other - k))] or STATIC_ONLY
            d = _silence(nearest)
        entries[k] = _flatten(d or STATIC_ONLY)
        if not np.all(np.isfinite(entries[k])):
            raise TuningError(messages.filter_not_finite(entry=k + 1))
        _check_stability(entries[: k + 1], float(k))
    for lower in range(len(entries) - 1):
        for share in _SHARES:
            _check_stability(entries, lower + float(share))
    return entries


def _check_stability(entries: Array, active: float) -> None:
    d = dynamic_decoupler.interpolate_decoupler(entries, active)
    minor, modulus = least_principal_minor(d), largest_pole(d)
    if not (modulus < 1.0 and minor > 0.0):
        raise TuningError(messages.unstable_schedule(active=active + 1.0, modulus=modulus, minor=minor))


def _silence(d: DynamicDecoupler) -> DynamicDecoupler:
    """Return the decoupler with the same poles whose filters have gain 0."""

    def without_gain(r: ResidualFilter) -> ResidualFilter:
        return ResidualFilter(HighPassSection(r.first.a_1, r.first.a_2, 0.0, 0.0), r.second)

    return DynamicDecoupler(without_gain(d.r_12), without_gain(d.r_21), d.static)


def _flatten(d: DynamicDecoupler) -> Array:
    return np.array([*d.r_12.first, *d.r_12.second, *d.r_21.first, *d.r_21.second, *d.static])


def make_static_part(d_12: float, d_21: float) -> StaticPart:
    """Return M = (I − D(0))⁻¹ of the static gains d_12 = −g_12(0)/g_11(0), d_21 = −g_21(0)/g_22(0)."""
    d_12, d_21 = float(d_12), float(d_21)
    determinant = 1.0 - d_12 * d_21
    return StaticPart(1.0 / determinant, d_12 / determinant, d_21 / determinant, 1.0 / determinant)
