"""What commissioning has measured of a rig: load-cell calibration, encoder offsets and tested parts."""

import hashlib
import math
from bisect import bisect_right
from dataclasses import asdict, dataclass, replace
from itertools import pairwise

from plant.wiring import BEYOND_TABLE, SATURATED_V, LoadCellWiring, Wiring

# Load cell -----------------------------------------------------------------------------------------
#
# Newtons from the volts of one load cell, as the wiring says it was calibrated.


class LoadCell:
    """Newtons from volts, by slope and offset or along the pieces of a table."""

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
        """Return the tension [N] behind V volts; nan beyond what was calibrated."""
        if not abs(V) < SATURATED_V:
            return math.nan
        if not self._pieces:
            return self._slope * (V - self._offset)
        if not self._low <= V <= self._high:
            return math.nan
        V_0, F_0, slope = self._pieces[bisect_right(self._starts, V)]
        return F_0 + slope * (V - V_0)


# Brought up ----------------------------------------------------------------------------------------
#
# What bringing a rig up has found, and what takes effect of it at the start of the loop.


@dataclass(frozen=True)
class CellCalibration:
    """Slope [N/V] and offset [V] of the load cell of one tendon, in place of the wiring's; ``source`` says whose."""

    tendon: str
    slope: float
    offset: float
    source: str


@dataclass(frozen=True)
class BroughtUp:
    """Calibrations of load cells, and whether directions were proven and both load cells measured with this wiring.

    ``wired`` is the fingerprint of the wiring that all of it was found with; empty where nothing was looked up.
    """

    calibrations: tuple[CellCalibration, ...] = ()
    directions_proven: bool = False
    load_cells_measured: bool = False
    wired: str = ""


NOT_BROUGHT_UP = BroughtUp()


def fingerprint(wiring: Wiring) -> str:
    """Return what tells a wiring from any other: all of its entries, whatever it is called and its sources say."""
    entries = asdict(wiring)
    del entries["sources"], entries["title"]
    return hashlib.sha256(repr(sorted(entries.items())).encode()).hexdigest()


def found_with(wired: str, brought_up: BroughtUp) -> BroughtUp:
    """Return what is known with the wiring of this fingerprint: nothing, where it was found with another."""
    return brought_up if brought_up.wired == wired else BroughtUp(wired=wired)


def calibrated(wiring: Wiring, calibrations: tuple[CellCalibration, ...]) -> Wiring:
    """Return the wiring with calibrations in the place of its own, and where they come from."""
    for found in calibrations:
        section = f"load_cell_{found.tendon}"
        cell = replace(getattr(wiring, section), slope=found.slope, offset=found.offset, table=())
        sources = {f"{section}.slope": found.source, f"{section}.offset": found.source}
        wiring = replace(wiring, sources={**wiring.sources, **sources}, **{section: cell})
    return wiring


def linear(wiring: Wiring, tendon: str) -> tuple[float, float] | None:
    """Return slope [N/V] and offset [V] of a load cell; None where a table stands for them."""
    cell = wiring.load_cell_A if tendon == "A" else wiring.load_cell_B
    return None if math.isnan(cell.slope) else (cell.slope, cell.offset)
