"""Periodic excitations of a reference as a share of their amplitude, within ±1, sample by sample. Pure."""

import math

from plant.compiled import compiled

FIRST = 1
"""What the register of a sequence holds before its first chip; any number but 0 would do."""

TAPS = {4: 0xC, 5: 0x14, 6: 0x30, 7: 0x60, 8: 0xB8, 9: 0x110, 10: 0x240, 11: 0x500, 12: 0xE08}
"""Bits fed back into a register of so many, for the longest sequence: a primitive polynomial over two elements each."""

LEAST_BITS, MOST_BITS = min(TAPS), max(TAPS)
MOST_LINES = 40
"""Most harmonics of a multisine: each is a cosine in each tick."""


@compiled
def sine(t: float, period_s: float) -> float:
    """Return sin of the time [s]."""
    return math.sin(2.0 * math.pi * t / period_s)


@compiled
def sweep(t: float, period_s: float, period_end_s: float, duration_s: float) -> float:
    """Return a sine whose frequency goes from 1/period_s to 1/period_end_s by the same factor in equal times."""
    growth = math.log(period_s / period_end_s)
    if abs(growth) < 1e-9:
        return math.sin(2.0 * math.pi * t / period_s)
    turns = duration_s / (period_s * growth) * math.expm1(growth * t / duration_s)
    return math.sin(2.0 * math.pi * turns)


@compiled
def multisine(t: float, period_s: float, lines: int, peak: float) -> float:
    """Return the sum of the first ``lines`` harmonics with Schroeder's phases −π k (k − 1)/N, divided by ``peak``."""
    total = 0.0
    for k in range(1, lines + 1):
        total += math.cos(2.0 * math.pi * k * t / period_s - math.pi * k * (k - 1) / lines)
    return min(max(total / peak, -1.0), 1.0)


@compiled
def next_register(register: int, bits: int) -> int:
    """Return a linear feedback shift register after one more chip (Galois form, ``TAPS``)."""
    taps = (0xC, 0x14, 0x30, 0x60, 0xB8, 0x110, 0x240, 0x500, 0xE08)[bits - 4]
    return (register >> 1) ^ (taps if register & 1 else 0)


@compiled
def level(register: int) -> float:
    """Return the level of a register's chip, 1 or −1."""
    return 1.0 if register & 1 else -1.0
