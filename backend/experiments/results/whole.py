"""Figures that every experiment has: the tensions and the voltage over the whole of it. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.experiments.results.metrics import figure

Columns = Mapping[str, NDArray[np.float64]]


@dataclass(frozen=True, kw_only=True)
class Whole:
    """Over all samples of the program."""

    min_tension_N: float = figure("N", "Smallest tension", "of both load cells from the start of the program")
    max_tension_N: float = figure("N", "Largest tension", "of both load cells from the start of the program")
    peak_voltage_V: float = figure("V", "Peak voltage", "largest |u_A|, |u_B| after limits")


def whole(columns: Columns) -> dict[str, float]:
    """Measure it, by name."""
    tensions = np.concatenate([columns["F_A"], columns["F_B"]])
    return {
        "min_tension_N": float(tensions.min()),
        "max_tension_N": float(tensions.max()),
        "peak_voltage_V": float(np.abs(np.concatenate([columns["u_A"], columns["u_B"]])).max()),
    }
