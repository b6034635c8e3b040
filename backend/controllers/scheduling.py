"""Which gains of the bank act: switching with hysteresis, or interpolation between the two nearest entries."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.controllers import i_p
from plant.compiled import compiled

HYSTERESIS = 0.2
"""How far beyond the border between two entries S must go before the bank switches [N·m/rad]."""


class Schedule(NamedTuple):
    """The bank as the tick reads it.

    ``entries`` (n, 7), sorted by nominal stiffness: S_nominal, then k_p, k_i, k_r of the position loop and of the
    stiffness loop. ``interpolate``: gain scheduling instead of switching.
    """

    entries: NDArray[np.float64]
    interpolate: bool


@compiled
def select(schedule: Schedule, active: float, S: float) -> float:
    """Active entry for stiffness S [N·m/rad]: an index, fractional while interpolating; ``active`` < 0 to begin."""
    nominal = schedule.entries[:, 0]
    last = nominal.shape[0] - 1
    if schedule.interpolate or active < 0.0 or active > last or active != math.floor(active):
        place = 0.0
        for lower in range(last):
            if nominal[lower] <= S:
                place = lower + min((S - nominal[lower]) / (nominal[lower + 1] - nominal[lower]), 1.0)
        return place if schedule.interpolate else math.floor(place + 0.5)
    entry = int(active)
    while entry < last and 0.5 * (nominal[entry] + nominal[entry + 1]) + HYSTERESIS < S:
        entry += 1
    while entry > 0 and 0.5 * (nominal[entry - 1] + nominal[entry]) - HYSTERESIS > S:
        entry -= 1
    return float(entry)


@compiled
def gains_at(schedule: Schedule, active: float) -> tuple[i_p.Gains, i_p.Gains]:
    """Gains of the position and the stiffness loop at an entry, or between two."""
    lower = int(active)
    upper = min(lower + 1, schedule.entries.shape[0] - 1)
    share = active - lower
    low, high = schedule.entries[lower], schedule.entries[upper]
    return (
        i_p.Gains(_mix(low[1], high[1], share), _mix(low[2], high[2], share), _mix(low[3], high[3], share)),
        i_p.Gains(_mix(low[4], high[4], share), _mix(low[5], high[5], share), _mix(low[6], high[6], share)),
    )


@compiled
def _mix(low: float, high: float, share: float) -> float:
    return (1.0 - share) * low + share * high
