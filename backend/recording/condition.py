"""The condition that a signal meets: a level, an edge through a level, or a window. Pure; nan meets nothing."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from backend.recording.following import columns_of, computed
from backend.recording.formula import Derived
from backend.sample import COMBINED_BY_NAME, INDEX, UNIT_OF


class ConditionKind(StrEnum):
    """What the signal does when the condition is met."""

    ABOVE = "above"
    BELOW = "below"
    RISING = "rising"
    FALLING = "falling"
    INSIDE = "inside"
    OUTSIDE = "outside"


WINDOWS = (ConditionKind.INSIDE, ConditionKind.OUTSIDE)
EDGES = (ConditionKind.RISING, ConditionKind.FALLING)


@dataclass(frozen=True)
class Condition:
    """A signal against ``level``; a window reaches from ``level`` to ``upper``.

    The signal is one of the sample, a combined one, or ``derived``: a formula as it was when the condition was made. An
    edge is a sample beyond the level after one that is not: it takes two neighbouring samples that are numbers.
    """

    signal: str
    kind: ConditionKind
    level: float
    upper: float | None = None
    derived: Derived | None = None

    @property
    def unit(self) -> str:
        """SI unit of the signal."""
        return UNIT_OF[self.signal] if self.derived is None else self.derived.unit

    def values(self, rows: NDArray[np.float64], lengths: dict[str, float]) -> NDArray[np.float64]:
        """Return the signal of rows of the ring [n, WIDTH]; ``lengths`` are those of the geometry [m], by name."""
        following = COMBINED_BY_NAME.get(self.signal) if self.derived is None else self.derived
        if following is None:
            return rows[:, INDEX[self.signal]]
        columns = {name: rows[:, INDEX[name]] for name in columns_of([following])}
        return computed(following, columns, lengths, len(rows))

    def met(self, values: NDArray[np.float64], previous: float) -> NDArray[np.bool_]:
        """Tell for each of ``values`` whether it meets the condition; ``previous`` is the sample before the first."""
        before = np.concatenate(([previous], values[:-1]))
        match self.kind:
            case ConditionKind.ABOVE:
                return values > self.level
            case ConditionKind.BELOW:
                return values < self.level
            case ConditionKind.RISING:
                return (before <= self.level) & (values > self.level)
            case ConditionKind.FALLING:
                return (before >= self.level) & (values < self.level)
            case ConditionKind.INSIDE:
                return (values >= self.level) & (values <= self._upper)
            case ConditionKind.OUTSIDE:
                return (values < self.level) | (values > self._upper)

    def first(self, values: NDArray[np.float64], previous: float) -> int | None:
        """Return the index of the first of ``values`` that meets the condition, None where none does."""
        at = np.flatnonzero(self.met(values, previous))
        return int(at[0]) if len(at) else None

    @property
    def _upper(self) -> float:
        return np.inf if self.upper is None else self.upper

    def told(self) -> str:
        """Return the condition in words, in SI."""
        shown = "" if self.unit == "1" else f" {self.unit}"
        if self.kind in WINDOWS:
            return f"{self.signal} {self.kind} {self.level:.6g} to {self._upper:.6g}{shown}"
        through = " through" if self.kind in EDGES else ""
        return f"{self.signal} {self.kind}{through} {self.level:.6g}{shown}"
