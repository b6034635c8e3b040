"""Statistics of signals over every sample of a range of a recording."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.recording.stretch import Slab


@dataclass(frozen=True)
class Extreme:
    """A value and the first tick that has it, counted from the first sample of the run."""

    value: float
    tick: int


@dataclass
class Statistics:
    """Statistics of one signal, of as many samples as were added.

    ``values`` counts the samples that have a value, ``without_value`` those that have none (nan). ``squares`` is the
    sum of the squared deviations from ``mean``.
    """

    values: int = 0
    without_value: int = 0
    mean: float = 0.0
    squares: float = 0.0
    minimum: Extreme | None = None
    maximum: Extreme | None = None

    @property
    def deviation(self) -> float:
        """Standard deviation about the mean, of the samples themselves: divided by their number."""
        return float(np.sqrt(self.squares / self.values)) if self.values else float("nan")

    def add(self, ticks: NDArray[np.int64], column: NDArray[np.float64]) -> None:
        """Add samples that follow those added before."""
        there = np.isfinite(column)
        added, at = column[there], ticks[there]
        self.without_value += column.size - added.size
        if not added.size:
            return
        low, high = int(np.argmin(added)), int(np.argmax(added))
        if self.minimum is None or added[low] < self.minimum.value:
            self.minimum = Extreme(float(added[low]), int(at[low]))
        if self.maximum is None or added[high] > self.maximum.value:
            self.maximum = Extreme(float(added[high]), int(at[high]))
        self._merge(added.size, float(added.mean()), float(np.sum((added - added.mean()) ** 2)))

    def _merge(self, count: int, mean: float, squares: float) -> None:
        """Merge mean and squares of a second set (Chan, Golub and LeVeque 1979): without loss for large offsets."""
        total, apart = self.values + count, mean - self.mean
        self.squares += squares + apart * apart * self.values * count / total
        self.mean += apart * count / total
        self.values = total


def add_slab(to: Mapping[str, Statistics], slab: Slab) -> None:
    """Add the samples of a slab to the statistics of each of its signals."""
    for name, statistics in to.items():
        statistics.add(slab.ticks, slab.columns[name])
