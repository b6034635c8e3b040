"""Conversion of one load cell's volts to newtons by its calibration."""

import math
from bisect import bisect_right
from itertools import pairwise

from plant.terminals import SATURATED_V
from plant.wiring import BEYOND_TABLE, LoadCellWiring


class LoadCell:
    """Conversion from volts to newtons, by slope and offset or by a table."""

    def __init__(self, wired: LoadCellWiring) -> None:
        self._slope, self._offset = wired.slope, wired.offset
        self._low = self._high = 0.0
        self._pieces = [(V, F, (F_next - F) / (V_next - V)) for (V, F), (V_next, F_next) in pairwise(wired.table)]
        self._starts = [V for V, _, _ in self._pieces[1:]]
        if wired.table:
            first, last = wired.table[0][0], wired.table[-1][0]
            beyond = BEYOND_TABLE * (last - first)
            self._low, self._high = first - beyond, last + beyond

    def force(self, V: float) -> float:
        """Return the tension [N] at V volts; NaN outside the calibrated range."""
        if not abs(V) < SATURATED_V:
            return math.nan
        if not self._pieces:
            return self._slope * (V - self._offset)
        if not self._low <= V <= self._high:
            return math.nan
        V_0, F_0, slope = self._pieces[bisect_right(self._starts, V)]
        return F_0 + slope * (V - V_0)
