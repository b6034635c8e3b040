"""Model structures: what a handful of parameters means as a transfer function.

All are a gain over a polynomial without zeros, b0 / (a_N s^N + ... + a_1 s + 1), parametrised in different ways, and
after it a dead time e^(-t_d s) where the structure has one.
"""

import re
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from backend.identification.errors import StructureError, UnstableModelError
from backend.identification.record import Signal

MAX_ORDER = 4
MAX_LAGS = 6
DEAD_TIME = "+delay"
"""What a structure's name ends with that has a dead time."""
KNOWN = f"first, third, lags2 .. lags{MAX_LAGS}, order:1 .. order:{MAX_ORDER}, each also with {DEAD_TIME}"


class Kind(StrEnum):
    """How the parameters make the denominator."""

    FIRST = "first"
    THIRD = "third"
    LAGS = "lags"
    FREE = "free"


@dataclass(frozen=True)
class Structure:
    """A parametrised transfer function; build it with :func:`structure`.

    ``names`` are the parameters in order, the gain first, all others positive; where the structure is ``delayed`` the
    last one is the dead time t_d [s].
    """

    name: str
    kind: Kind
    order: int
    names: tuple[str, ...]
    delayed: bool = False

    @property
    def undelayed(self) -> "Structure":
        """The same without the dead time."""
        return structure(self.name.removesuffix(DEAD_TIME))

    def dead_time(self, parameters: Signal) -> float:
        """Dead time [s], 0 where the structure has none."""
        return float(parameters[-1]) if self.delayed else 0.0

    def sum_of_lags(self, parameters: Signal) -> float:
        """a_1 + t_d [s], minus the slope of the phase at zero frequency."""
        return float(self.denominator(parameters)[1]) + self.dead_time(parameters)

    def denominator(self, parameters: Signal) -> Signal:
        """Coefficients 1, a_1 .. a_N in ascending powers of s, shape (order + 1,); units s^i."""
        dynamics = self._dynamics(parameters)
        match self.kind:
            case Kind.FIRST:
                return np.array([1.0, dynamics[0]])
            case Kind.THIRD:
                T, a2, a1 = dynamics
                return np.convolve([1.0, T], [1.0, a1, a2])
            case Kind.LAGS:
                return np.asarray(np.poly1d([dynamics[0], 1.0]) ** self.order).ravel()[::-1]
            case Kind.FREE:
                return np.concatenate(([1.0], dynamics))

    def poles(self, parameters: Signal) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
        """Poles [rad/s], shape (order,)."""
        if self.kind in (Kind.FIRST, Kind.LAGS):
            return np.full(self.order, -1.0 / parameters[1], dtype=np.complex128)
        if self.kind is Kind.THIRD:
            T, a2, a1 = self._dynamics(parameters)
            return np.concatenate(([-1.0 / T], _roots(np.array([1.0, a1, a2]))))
        return _roots(self.denominator(parameters))

    def from_denominator(self, gain: float, denominator: Signal) -> Signal:
        """Parameters, without dead time, nearest to a stable denominator of the same order (ascending, 1 first)."""
        if self.kind is Kind.FIRST:
            return np.array([gain, denominator[1]])
        if self.kind is Kind.LAGS:
            return np.array([gain, denominator[1] / self.order])
        if self.kind is Kind.THIRD:
            poles = _roots(denominator)
            slowest = int(np.argmin(np.where(np.abs(poles.imag) < 1e-9 * np.abs(poles), np.abs(poles), np.inf)))
            a2, a1, _ = np.real(np.poly(np.delete(poles, slowest)) / np.prod(-np.delete(poles, slowest)).real)
            return np.array([gain, -1.0 / poles[slowest].real, a2, a1])
        return np.concatenate(([gain], denominator[1:]))

    def _dynamics(self, parameters: Signal) -> Signal:
        return parameters[1:-1] if self.delayed else parameters[1:]


def structure(name: str) -> Structure:
    """Return the structure of that name, one of KNOWN. Raises StructureError."""
    if name.endswith(DEAD_TIME):
        plain = structure(name.removesuffix(DEAD_TIME))
        if not plain.delayed:
            return replace(plain, name=name, names=(*plain.names, "t_d"), delayed=True)
    if name == "first":
        return Structure(name, Kind.FIRST, 1, ("K", "T"))
    if name == "third":
        return Structure(name, Kind.THIRD, 3, ("K", "T", "a2", "a1"))
    lags = re.fullmatch(r"lags([2-9])", name)
    if lags and int(lags[1]) <= MAX_LAGS:
        return Structure(name, Kind.LAGS, int(lags[1]), ("K", "tau"))
    free = re.fullmatch(r"order:([1-9])", name)
    if free and int(free[1]) <= MAX_ORDER:
        order = int(free[1])
        return Structure(name, Kind.FREE, order, ("b0", *(f"a{i}" for i in range(1, order + 1))))
    raise StructureError(f"structure '{name}' does not exist: choose one of {KNOWN}")


def _roots(ascending: Signal) -> np.ndarray[tuple[int], np.dtype[np.complex128]]:
    """Roots of a polynomial given in ascending powers; scaled first, since a_N may be 10 powers of ten below 1."""
    order = ascending.size - 1
    scale = abs(ascending[-1]) ** (1.0 / order)
    if not (scale > 0.0 and np.all(np.isfinite(ascending))):
        raise UnstableModelError("the coefficients leave the range of numbers")
    scaled = ascending / scale ** np.arange(order + 1)
    found = np.asarray(np.roots(scaled[::-1]) / scale, dtype=np.complex128)
    if found.size != order or not np.all(np.isfinite(found)):  # a coefficient that underflows takes its root along
        raise UnstableModelError("the coefficients leave the range of numbers")
    return found
