"""How well the beat is kept, from the samples of the last seconds."""

from dataclasses import dataclass

import numpy as np

from backend.loop.ring import Ring
from backend.sample import INDEX
from plant.interface import T_s

WINDOW_TICKS = 5000


@dataclass(frozen=True)
class Timing:
    """Rate [Hz] and lateness [s] over the last ``WINDOW_TICKS`` samples; ``overruns`` since the loop started.

    The rate is what is left of the nominal one after skipped deadlines; all but ``overruns`` are nan before the first
    samples.
    """

    rate_Hz: float
    lateness_p50_s: float
    lateness_p99_s: float
    overruns: int


def timing(ring: Ring) -> Timing:
    """Compute the timing of the loop that writes ``ring``."""
    end = ring.count
    _, rows, _ = ring.read(max(0, end - WINDOW_TICKS), WINDOW_TICKS)
    if len(rows) < 2:
        return Timing(np.nan, np.nan, np.nan, 0)
    overruns = rows[:, INDEX["overruns"]]
    periods = len(rows) - 1 + overruns[-1] - overruns[0]
    p50, p99 = np.percentile(rows[:, INDEX["lateness_s"]], [50.0, 99.0])
    return Timing(float((len(rows) - 1) / (periods * T_s)), float(p50), float(p99), int(overruns[-1]))


LATENESS_EDGES_S = (0.0, 20e-6, 50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3, np.inf)
"""Bounds of the histogram's classes [s]; the last class has no upper one."""


def lateness_histogram(ring: Ring) -> list[int]:
    """Count the ticks that the ring still holds by how late they began, one number per class."""
    end = ring.count
    _, rows, _ = ring.read(max(0, end - ring.capacity), ring.capacity)
    counts, _ = np.histogram(np.maximum(rows[:, INDEX["lateness_s"]], 0.0), LATENESS_EDGES_S)
    return [int(count) for count in counts]
