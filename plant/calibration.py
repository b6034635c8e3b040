"""Commissioning results that apply from the start of the control loop."""

import hashlib
import math
from dataclasses import asdict, dataclass, replace

from plant.wiring import Wiring


@dataclass(frozen=True)
class CellCalibration:
    """Calibration of one tendon's load cell, in place of the wiring file's.

    Slope [N/V] and offset [V]; ``source`` states how and when they were measured.
    """

    tendon: str
    slope: float
    offset: float
    source: str


@dataclass(frozen=True)
class CommissioningResults:
    """Results of commissioning: load cell calibrations and completed checks.

    The directions of the motors were proven and both load cells were measured with the wiring whose fingerprint is
    ``wired``; it is empty where no results were looked up.
    """

    calibrations: tuple[CellCalibration, ...] = ()
    directions_proven: bool = False
    load_cells_measured: bool = False
    wired: str = ""


NO_COMMISSIONING = CommissioningResults()


def wiring_fingerprint(wiring: Wiring) -> str:
    """Return a digest of all entries of a wiring, without its title and its sources."""
    entries = asdict(wiring)
    del entries["sources"], entries["title"]
    return hashlib.sha256(repr(sorted(entries.items())).encode()).hexdigest()


def select_calibration(wired: str, commissioning_results: CommissioningResults) -> CommissioningResults:
    """Return the results found with the wiring of this fingerprint, else none."""
    return commissioning_results if commissioning_results.wired == wired else CommissioningResults(wired=wired)


def apply_calibration(wiring: Wiring, calibrations: tuple[CellCalibration, ...]) -> Wiring:
    """Return the wiring with these calibrations and their sources in place of its own."""
    for found in calibrations:
        section = f"load_cell_{found.tendon}"
        cell = replace(getattr(wiring, section), slope=found.slope, offset=found.offset, table=())
        sources = {f"{section}.slope": found.source, f"{section}.offset": found.source}
        wiring = replace(wiring, sources={**wiring.sources, **sources}, **{section: cell})
    return wiring


def load_cell_line(wiring: Wiring, tendon: str) -> tuple[float, float] | None:
    """Return slope [N/V] and offset [V] of a load cell, or None if it has a table."""
    cell = wiring.load_cell_A if tendon == "A" else wiring.load_cell_B
    return None if math.isnan(cell.slope) else (cell.slope, cell.offset)
