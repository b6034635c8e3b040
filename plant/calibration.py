"""What bringing a rig up has found, and what takes effect of it at the start of the loop."""

import hashlib
import math
from dataclasses import asdict, dataclass, replace

from plant.wiring import Wiring


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


def wiring_fingerprint(wiring: Wiring) -> str:
    """Return what tells a wiring from any other: all of its entries, whatever it is called and its sources say."""
    entries = asdict(wiring)
    del entries["sources"], entries["title"]
    return hashlib.sha256(repr(sorted(entries.items())).encode()).hexdigest()


def select_calibration(wired: str, brought_up: BroughtUp) -> BroughtUp:
    """Return what is known with the wiring of this fingerprint: nothing, where it was found with another."""
    return brought_up if brought_up.wired == wired else BroughtUp(wired=wired)


def apply_calibration(wiring: Wiring, calibrations: tuple[CellCalibration, ...]) -> Wiring:
    """Return the wiring with calibrations in the place of its own, and where they come from."""
    for found in calibrations:
        section = f"load_cell_{found.tendon}"
        cell = replace(getattr(wiring, section), slope=found.slope, offset=found.offset, table=())
        sources = {f"{section}.slope": found.source, f"{section}.offset": found.source}
        wiring = replace(wiring, sources={**wiring.sources, **sources}, **{section: cell})
    return wiring


def load_cell_line(wiring: Wiring, tendon: str) -> tuple[float, float] | None:
    """Return slope [N/V] and offset [V] of a load cell; None where a table stands for them."""
    cell = wiring.load_cell_A if tendon == "A" else wiring.load_cell_B
    return None if math.isnan(cell.slope) else (cell.slope, cell.offset)
