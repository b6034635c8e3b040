"""Signals at a rig's terminals: volts and counts from newtons and radians.

The inverse of the conversion in ``plant/rig.py``.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant.compilation import compiled
from plant.interface import Measurement
from plant.wiring import EncoderWiring, LoadCellWiring, Wiring

RANGE_V = 10.0
"""Range of analog inputs and outputs (±) [V]."""

SATURATED_V = 0.999 * RANGE_V
"""Voltage from which a load cell reading is invalid: its amplifier is saturated."""

_STEP_V = 2.0 * RANGE_V / 2**16
"""Resolution of the 16-bit converters [V]."""

_LOWEST, _HIGHEST = -(2.0**15), 2.0**15 - 1.0


class LoadCellScaling(NamedTuple):
    """Calibration of a load cell: ``slope`` [N/V], ``offset`` [V], or ``table``.

    ``table`` (n, 2) holds N and V; without rows slope and offset apply.
    """

    slope: float
    offset: float
    table: NDArray[np.float64]


class Encoder(NamedTuple):
    """Counts per revolution of an encoder, and +1 or -1 for its direction."""

    counts_per_rev: float
    direction: float


class Terminals(NamedTuple):
    """Conversions of all terminals, for the compiled functions."""

    cell_A: LoadCellScaling
    cell_B: LoadCellScaling
    encoder_q: Encoder
    encoder_A: Encoder
    encoder_B: Encoder


def make_terminals(w: Wiring) -> Terminals:
    """Return the conversions of a wiring."""
    q, A, B = (_make_encoder(wired) for wired in (w.encoder_q, w.encoder_A, w.encoder_B))
    return Terminals(_make_cell(w.load_cell_A), _make_cell(w.load_cell_B), q, A, B)


@compiled
def compute_terminals(
    wires: Terminals, m: Measurement, pull_A: float, pull_B: float
) -> tuple[float, float, float, float, float]:
    """Return load cell volts and encoder counts, as in a ``RawReading``.

    ``pull_A``, ``pull_B`` [N] pull at the load cells in addition.
    """
    return (
        quantize_volts(compute_volts(wires.cell_A, m.F_A + pull_A)),
        quantize_volts(compute_volts(wires.cell_B, m.F_B + pull_B)),
        compute_counts(wires.encoder_q, m.q),
        compute_counts(wires.encoder_A, m.theta_A),
        compute_counts(wires.encoder_B, m.theta_B),
    )


@compiled
def compute_counts(encoder: Encoder, angle: float) -> float:
    """Return the count of an encoder at an angle [rad]; NaN stays NaN."""
    return encoder.direction * float(np.rint(angle * encoder.counts_per_rev / (2.0 * math.pi)))


@compiled
def compute_volts(cell: LoadCellScaling, F: float) -> float:
    """Return the volts of a load cell at tension F [N]: its inverse calibration.

    Tables are extrapolated.
    """
    points = cell.table
    if points.shape[0] == 0:
        return cell.offset + F / cell.slope
    low = 0
    while low < points.shape[0] - 2 and points[low + 1, 0] <= F:
        low += 1
    F_0, V_0, F_1, V_1 = points[low, 0], points[low, 1], points[low + 1, 0], points[low + 1, 1]
    return float(V_0 + (V_1 - V_0) * (F - F_0) / (F_1 - F_0))


@compiled
def quantize_volts(V: float) -> float:
    """Round volts as a 16-bit converter does, limited to its range; NaN stays NaN."""
    if math.isnan(V):
        return V
    return float(np.rint(min(max(V / _STEP_V, _LOWEST), _HIGHEST))) * _STEP_V


def _make_cell(wired: LoadCellWiring) -> LoadCellScaling:
    points = sorted((newtons, volts) for volts, newtons in wired.table)
    return LoadCellScaling(float(wired.slope), float(wired.offset), np.array(points, dtype=np.float64).reshape(-1, 2))


def _make_encoder(wired: EncoderWiring) -> Encoder:
    return Encoder(float(wired.counts_per_rev), float(wired.direction))
