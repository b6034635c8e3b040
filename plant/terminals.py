"""What is at a rig's terminals: volts and counts out of newtons and radians, the way back from ``plant/rig.py``."""

import math

from plant.wiring import EncoderWiring, LoadCellWiring

RANGE_V = 10.0
"""Range of analog inputs and outputs (±) [V]."""

SATURATED_V = 0.999 * RANGE_V
"""A load cell that reads this or more says nothing any more: its amplifier is at its end."""

_STEP_V = 2.0 * RANGE_V / 2**16
"""One code of the 16-bit converters [V]."""


def counts_of(wired: EncoderWiring, angle: float) -> float:
    """Count the steps of an encoder that has turned by an angle [rad]; nan stays nan."""
    if math.isnan(angle):
        return angle
    return wired.direction * round(angle * wired.counts_per_rev / (2.0 * math.pi))


def volts_of(wired: LoadCellWiring, F: float) -> float:
    """Give the volts of a load cell under a tension F [N]: its calibration the other way round, beyond a table too."""
    if not wired.table:
        return wired.offset + F / wired.slope
    points = sorted((newtons, volts) for volts, newtons in wired.table)
    piece = sum(newtons <= F for newtons, _ in points[1:-1])
    (F_0, V_0), (F_1, V_1) = points[piece : piece + 2]
    return V_0 + (V_1 - V_0) * (F - F_0) / (F_1 - F_0)


def converted(V: float) -> float:
    """Round volts as a 16-bit converter does, at its end where they are beyond; nan stays nan."""
    if math.isnan(V):
        return V
    return min(max(round(V / _STEP_V), -(2**15)), 2**15 - 1) * _STEP_V
