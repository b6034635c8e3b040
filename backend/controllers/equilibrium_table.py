"""What a pair of springs does at rest, over the sum of the motor angles: the numerical side of the decoupler."""

import numpy as np
from numpy.typing import NDArray

from plant.dynamics import Spring, polynomial, slope

SUM, STIFFNESS, OFFSET, TENSION = 0, 1, 2, 3
"""Columns of the table: θ_A + θ_B [rad], S [N·m/rad], (x_A − x_B)/(2 r_m) [rad], tension of both tendons [N]."""

ROWS = 1025
"""Straight pieces: with the paper's spring made cubic they miss S by less than 1e-6 N·m/rad."""

_POINTS = 4001

Array = NDArray[np.float64]


def equilibrium_table(spring_A: Spring, spring_B: Spring, r_m: float, r_j: float) -> Array:
    """Table (ROWS, 4), evenly spaced in θ_A + θ_B, from slack to where the first of the springs becomes solid.

    At rest F_A(x_A) = F_B(x_B) = F, S = r_j² (F_A'(x_A) + F_B'(x_B)) (equation 14, erratum E4), and
    θ_A + θ_B = (x_A + x_B)/r_m by equations 1 and 2, whatever q. The springs must stiffen
    (``plant.dynamics.require_stiffening``), so that S rises from row to row.
    """
    x_A, F_A, slope_A = _sampled(spring_A)
    x_B, F_B, slope_B = _sampled(spring_B)
    if F_A[-1] > F_B[-1]:
        table = equilibrium_table(spring_B, spring_A, r_m, r_j)
        table[:, OFFSET] *= -1.0
        return table
    other = np.interp(F_A, F_B, x_B)
    turned = (x_A + other) / r_m
    S = r_j**2 * (slope_A + np.interp(F_A, F_B, slope_B))
    offset = (x_A - other) / (2.0 * r_m)
    even = np.linspace(turned[0], turned[-1], ROWS)
    return np.column_stack([even, *(np.interp(even, turned, column) for column in (S, offset, F_A))])


def _sampled(spring: Spring) -> tuple[Array, Array, Array]:
    """Elongation, force and slope from slack to solid."""
    x = np.linspace(spring.x_slack, spring.x_solid, _POINTS)
    return x, np.array([polynomial(spring, v) for v in x]), np.array([slope(spring, v) for v in x])
