"""Linear model of both outer loops' processes with their coupling, and its covariance."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from backend.tuning import messages
from backend.tuning.gains import TuningError

if TYPE_CHECKING:
    import control

Coefficients = tuple[float, ...]
"""Coefficients of a polynomial in ascending powers of s."""

Array = NDArray[np.float64]

NAMES = (("B_11", "B_12"), ("B_21", "B_22"))


@dataclass(frozen=True, eq=False)
class CoupledModel:
    """Model A_i(s) y_i = B_i1(s) u_1 + B_i2(s) u_2 with u = (q_c, S_c) and y = (q, S).

    ``denominators`` has A_1 and A_2 with the constant coefficient 1, ``numerators[i][j]`` has B_ij [unit of y_i per
    unit of u_j], (0,) for an entry that is not distinguishable from zero. ``covariance`` is that of the numerators in
    the order B_11, B_12, B_21, B_22, each in ascending powers; the denominators do not affect the decoupling. None for
    an exact model. Raises TuningError.
    """

    denominators: tuple[Coefficients, Coefficients]
    numerators: tuple[tuple[Coefficients, Coefficients], tuple[Coefficients, Coefficients]]
    covariance: Array | None = None

    def __post_init__(self) -> None:
        for name, denominator in zip(("A_1", "A_2"), self.denominators, strict=True):
            _check_coefficients(name, denominator)
            if denominator[0] != 1.0:
                raise TuningError(messages.denominator_not_normalized(name=name, constant=denominator[0]))
        for names, row in zip(NAMES, self.numerators, strict=True):
            for name, numerator in zip(names, row, strict=True):
                _check_coefficients(name, numerator)
        if self.covariance is not None:
            _check_covariance(self.covariance, sum(self._counts()))

    def _counts(self) -> list[int]:
        """Return the numbers of coefficients of B_11, B_12, B_21, B_22."""
        return [len(numerator) for row in self.numerators for numerator in row]

    def _indices(self) -> list[NDArray[np.intp]]:
        """Return the indices of the coefficients of each numerator in the covariance."""
        return np.split(np.arange(sum(self._counts())), np.cumsum(self._counts())[:-1])

    def full_numerator(self, i: int, j: int) -> Array:
        """Return B_ij in descending powers, with leading zeros. ``i`` and ``j`` are 0 or 1."""
        return np.array(self.numerators[i][j][::-1], dtype=np.float64)

    def numerator(self, i: int, j: int) -> Array:
        """Return B_ij in descending powers without leading zeros; [0] if it is zero."""
        return trim(self.full_numerator(i, j))

    def numerator_covariance(self) -> Array:
        """Return the covariance in the order of ``full_numerator`` 11, 12, 21, 22; zero for an exact model."""
        if self.covariance is None:
            return np.zeros((sum(self._counts()),) * 2)
        order = np.concatenate([indices[::-1] for indices in self._indices()])
        return np.asarray(self.covariance[np.ix_(order, order)], dtype=np.float64)

    def swap_inputs(self) -> "CoupledModel":
        """Return the model with the inputs exchanged: the other pairing of the loops."""
        (B_11, B_12), (B_21, B_22) = self.numerators
        covariance = self.covariance
        if covariance is not None:
            at_11, at_12, at_21, at_22 = self._indices()
            order = np.concatenate([at_12, at_11, at_22, at_21])
            covariance = covariance[np.ix_(order, order)]
        return CoupledModel(self.denominators, ((B_12, B_11), (B_22, B_21)), covariance)

    def response(self, s: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return G(s), shape (n, 2, 2), at points ``s`` (n,) [rad/s]."""
        rows = [
            [np.polyval(numerator[::-1], s) / np.polyval(denominator[::-1], s) for numerator in row]
            for denominator, row in zip(self.denominators, self.numerators, strict=True)
        ]
        return np.moveaxis(np.array(rows, dtype=np.complex128), 2, 0)

    def make_state_space(self) -> "control.StateSpace":
        """Return the model in state space, with one observer canonical form per output.

        Raises TuningError for an output that an input affects without delay.
        """
        import control

        blocks = [self._realize(i) for i in (0, 1)]
        A = np.zeros((sum(len(block[0]) for block in blocks),) * 2)
        C = np.zeros((2, len(A)))
        first = 0
        for i, (block, _) in enumerate(blocks):
            A[first : first + len(block), first : first + len(block)] = block
            C[i, first] = 1.0
            first += len(block)
        B = np.vstack([inputs for _, inputs in blocks])
        return control.ss(A, B, C, np.zeros((2, 2)), inputs=["q_c", "S_c"], outputs=["q_out", "S_out"])

    def _realize(self, i: int) -> tuple[Array, Array]:
        """Return A and B of one output, which is the first state."""
        denominator = trim(np.array(self.denominators[i][::-1], dtype=np.float64))
        order = denominator.size - 1
        B = np.zeros((order, 2))
        for j in (0, 1):
            numerator = self.numerator(i, j)
            if numerator.any() and numerator.size > order:
                raise TuningError(messages.process_not_strictly_proper(name=NAMES[i][j], order=order))
            B[order - numerator.size :, j] = numerator / denominator[0]
        A = np.eye(order, k=1)
        A[:, 0] = -denominator[1:] / denominator[0]
        return A, B


def trim(polynomial: Array) -> Array:
    """Return a polynomial without leading zeros; [0] if it is zero."""
    nonzero = np.flatnonzero(polynomial)
    return polynomial[nonzero[0] :] if nonzero.size else np.zeros(1)


def multiply(p: Array, q: Array) -> Array:
    """Return the product of two polynomials."""
    return np.asarray(np.convolve(p, q), dtype=np.float64)


def find_zeros(polynomial: Array) -> NDArray[np.complex128]:
    """Return the zeros of a polynomial, none of a constant."""
    return np.asarray(np.roots(polynomial), dtype=np.complex128)


def _check_coefficients(name: str, polynomial: Coefficients) -> None:
    if not polynomial:
        raise TuningError(messages.polynomial_without_coefficients(name=name))
    for k, value in enumerate(polynomial):
        if not np.isfinite(value):
            raise TuningError(messages.coefficient_not_finite(name=name, power=k, value=value))


def _check_covariance(covariance: Array, count: int) -> None:
    if covariance.shape != (count, count):
        raise TuningError(messages.covariance_of_wrong_shape(shape=covariance.shape, count=count))
    if not np.all(np.isfinite(covariance)):
        raise TuningError(messages.covariance_not_finite(count=int(np.count_nonzero(~np.isfinite(covariance)))))
    deviations = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    scale = np.where(deviations > 0.0, deviations, 1.0)
    correlation = covariance / np.outer(scale, scale)  # units of the coefficients differ by powers of s
    if np.max(np.abs(correlation - correlation.T)) > 1e-6:
        raise TuningError(messages.covariance_not_symmetric())
    least = float(np.min(np.linalg.eigvalsh(0.5 * (correlation + correlation.T))))
    if least < -1e-6:
        raise TuningError(messages.covariance_not_positive(eigenvalue=least))
