"""Relative gain of a 2 x 2 process, and its standard error."""

import numpy as np

from backend.identification.models import Complex
from backend.identification.records import Signal

# The relative gain array of Bristol (1966) is G with each entry multiplied by that of the transposed inverse. For two
# inputs and outputs it is [[r, 1 - r], [1 - r, r]] with r = g_11 g_22 / (g_11 g_22 - g_12 g_21).


def relative_gain(G: Complex | Signal) -> Complex:
    """Return r, the entry 11 of the relative gain array, of matrices (..., 2, 2); shape (...).

    It is infinite for a singular matrix.
    """
    G = np.asarray(G, dtype=np.complex128)
    direct, crossed = G[..., 0, 0] * G[..., 1, 1], G[..., 0, 1] * G[..., 1, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(direct / (direct - crossed))


def relative_gain_std(G: Complex | Signal, covariance: Complex | Signal) -> Signal:
    """Return the standard error of r for matrices (..., 2, 2), shape (...).

    ``covariance``, shape (..., 4, 4), is E[dg dg^H] of the entries in the order 11, 12, 21, 22. For a complex r the
    error is the root mean square of its distance. Delta method of second order, for normal errors:
    var r = c^T C c* + tr(H C H* C^T) / 2 with the derivatives c and H of r. The second term matters if both couplings
    are close to zero, where r is a product of two small errors.
    """
    g = np.asarray(G, dtype=np.complex128).reshape(*np.shape(G)[:-2], 4)
    C = np.asarray(covariance, dtype=np.complex128)
    with np.errstate(divide="ignore", invalid="ignore"):
        gradient, hessian = _derivatives(g)
        first = np.einsum("...i,...ij,...j->...", gradient, C, gradient.conj()).real
        second = np.einsum("...ij,...jl,...kl,...ik->...", hessian, C, hessian.conj(), C).real / 2.0
        return np.asarray(np.sqrt(np.where(first + second >= 0.0, first + second, np.nan)))


def _derivatives(g: Complex) -> tuple[Complex, Complex]:
    """Return first and second derivatives of r by the entries, (..., 4) and (..., 4, 4)."""
    a, b, c, d = np.moveaxis(g, -1, 0)
    D, both = a * d - b * c, a * d + b * c
    gradient = np.stack((-b * c * d, a * c * d, a * b * d, -a * b * c), axis=-1) / (D**2)[..., np.newaxis]
    rows = (
        (2.0 * b * c * d**2, -c * d * both, -b * d * both, b * c * both),
        (-c * d * both, 2.0 * a * d * c**2, a * d * both, -a * c * both),
        (-b * d * both, a * d * both, 2.0 * a * d * b**2, -a * b * both),
        (b * c * both, -a * c * both, -a * b * both, 2.0 * b * c * a**2),
    )
    hessian = np.stack([np.stack(row, axis=-1) for row in rows], axis=-2) / (D**3)[..., np.newaxis, np.newaxis]
    return gradient, hessian
