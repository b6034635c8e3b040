"""Model structures: what a handful of parameters means as a transfer function.

All are a gain over a polynomial without zeros, b0 / (a_N s^N + ... + a_1 s + 1), parametrised in different ways.
"""

import re
from dataclasses import dataclass

import numpy as np

from backend.identification.errors import StructureError
from backend.identification.record import Signal

MAX_ORDER = 4
MAX_LAGS = 6


@dataclass(frozen=True)
class Structure:
    """A parametrised transfer function; build it with :func:`structure`.

    ``names`` are the parameters in order, the gain first, all others positive. ``kind`` is "first", "third",
    "lags" or "free".
    """

    name: str
    kind: str
    order: int
    names: tuple[str, ...]

    def denominator(self, parameters: Signal) -> Signal:
        """Coefficients 1, a_1 .. a_N in ascending powers of s, shape (order + 1,); units s^i."""
        dynamics = parameters[1:]
        if self.kind == "first":
            return np.array([1.0, dynamics[0]])
        if self.kind == "third":
            T, a2, a1 = dynamics
            return np.convolve([1.0, T], [1.0, a1, a2])
        if self.kind == "lags":
            return np.asarray(np.poly1d([dynamics[0], 1.0]) ** self.order).ravel()[::-1]
        return np.concatenate(([1.0], dynamics))

    def poles(self, parameters: Signal) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
        """Poles [rad/s], shape (order,)."""
        if self.kind in ("first", "lags"):
            return np.full(self.order, -1.0 / parameters[1], dtype=np.complex128)
        if self.kind == "third":
            T, a2, a1 = parameters[1:]
            return np.concatenate(([-1.0 / T], _roots(np.array([1.0, a1, a2]))))
        return _roots(self.denominator(parameters))

    def from_denominator(self, gain: float, denominator: Signal) -> Signal:
        """Parameters nearest to a stable denominator of the same order (ascending powers, first one 1)."""
        if self.kind == "first":
            return np.array([gain, denominator[1]])
        if self.kind == "lags":
            return np.array([gain, denominator[1] / self.order])
        if self.kind == "third":
            poles = _roots(denominator)
            slowest = int(np.argmin(np.where(np.abs(poles.imag) < 1e-9 * np.abs(poles), np.abs(poles), np.inf)))
            a2, a1, _ = np.real(np.poly(np.delete(poles, slowest)) / np.prod(-np.delete(poles, slowest)).real)
            return np.array([gain, -1.0 / poles[slowest].real, a2, a1])
        return np.concatenate(([gain], denominator[1:]))


def structure(name: str) -> Structure:
    """Return the structure of that name: first, third, lags2 .. lags6, order:1 .. order:4. Raises StructureError."""
    if name == "first":
        return Structure(name, "first", 1, ("K", "T"))
    if name == "third":
        return Structure(name, "third", 3, ("K", "T", "a2", "a1"))
    lags = re.fullmatch(r"lags([2-9])", name)
    if lags and int(lags[1]) <= MAX_LAGS:
        return Structure(name, "lags", int(lags[1]), ("K", "tau"))
    free = re.fullmatch(r"order:([1-9])", name)
    if free and int(free[1]) <= MAX_ORDER:
        order = int(free[1])
        return Structure(name, "free", order, ("b0", *(f"a{i}" for i in range(1, order + 1))))
    known = f"first, third, lags2 .. lags{MAX_LAGS}, order:1 .. order:{MAX_ORDER}"
    raise StructureError(f"structure '{name}' does not exist: choose one of {known}")


def _roots(ascending: Signal) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """Roots of a polynomial given in ascending powers; scaled first, since a_N may be 10 powers of ten below 1."""
    order = ascending.size - 1
    scale = abs(ascending[-1]) ** (1.0 / order)
    scaled = ascending / scale ** np.arange(order + 1)
    return np.asarray(np.roots(scaled[::-1]) / scale, dtype=np.complex128)
