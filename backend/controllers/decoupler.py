"""Static decoupler: from joint position and stiffness to motor positions and back (equations 18-21).

Two like quadratic springs have the paper's closed form. Any other pair has a table of what happens at rest: both
tendons then carry the same tension F, so that S = r_j² (F_A' + F_B') and the sum of the motor angles depend on F alone,
not on q, even where the springs differ. What differs is how far each spring is wound for that F: an offset that turns
one motor forward and the other back. ``backend.controllers.equilibrium_table`` makes the table; here it is read, the
same straight pieces in both directions, so that there and back again is exact.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.controllers.equilibrium_table import OFFSET, STIFFNESS, SUM, TENSION, equilibrium_table
from plant.compiled import compiled
from plant.parameters import PlantParameters, SpringParameters


class Decoupler(NamedTuple):
    """Geometry and identified springs: ``r_m``, ``r_j`` [m]; ``k_0`` [N], ``k_1`` [N/m], ``k_2`` [N/m²] of like ones.

    ``table`` is None for like quadratic springs; for any other pair it is what ``equilibrium_table`` gives, and k_0,
    k_1, k_2 are nan.
    """

    r_m: float
    r_j: float
    k_0: float
    k_1: float
    k_2: float
    table: NDArray[np.float64] | None = None


@compiled
def motor_positions(d: Decoupler, q_c: float, S_c: float) -> tuple[float, float]:
    """theta_A, theta_B [rad] that hold q_c [rad] and S_c [N·m/rad] at equilibrium (equations 18, 19)."""
    difference = d.r_j / d.r_m * q_c
    common, offset = _half_sum(d, d.table, S_c)
    return difference + common + offset, -difference + common - offset


@compiled
def stiffness(d: Decoupler, theta_A: float, theta_B: float) -> float:
    """S [N·m/rad] at rest, from motor positions: 2 r_j² (k1 + k2 r_m (θ_A + θ_B)) (equation 16, order 2)."""
    return _stiffness(d, d.table, theta_A + theta_B)


@compiled
def equilibrium(d: Decoupler, theta_A: float, theta_B: float) -> float:
    """q_e [rad] at which the joint rests without load (equation 15)."""
    return d.r_m * (theta_A - theta_B - _difference(d.table, theta_A + theta_B)) / (2.0 * d.r_j)


@compiled
def rates(d: Decoupler, theta_A: float, theta_B: float, rate_A: float, rate_B: float) -> tuple[float, float]:
    """q_e' [rad/s] and S' [N·m/(rad·s)] at motor positions [rad] that change at rate_A, rate_B [rad/s]."""
    S_rate, difference_rate = _slopes(d, d.table, theta_A + theta_B)
    turning = rate_A + rate_B
    return d.r_m * (rate_A - rate_B - difference_rate * turning) / (2.0 * d.r_j), S_rate * turning


@compiled
def stiffness_slope(d: Decoupler, S: float) -> float:
    """dS/dθ [N·m/rad per rad] of one motor at stiffness S [N·m/rad]: 2 r_j² k2 r_m, at any S, for order 2."""
    half_sum, _ = _half_sum(d, d.table, S)
    S_rate, _ = _slopes(d, d.table, 2.0 * half_sum)
    return S_rate


@compiled
def stiffness_under(d: Decoupler, F: float) -> float:
    """S [N·m/rad] at rest with the tension F [N] in both tendons: 2 r_j² √(k1² + 4 k2 (F − k0)) for order 2."""
    return _stiffness_under(d, d.table, F)


@compiled
def tension_under(d: Decoupler, S: float) -> float:
    """Tension [N] in both tendons at rest with stiffness S [N·m/rad]: ``stiffness_under`` inverted."""
    return _tension_under(d, d.table, S)


# Each function below is compiled for a table and for None; for None the compiler drops what the table would need.


@compiled
def _half_sum(d: Decoupler, table: NDArray[np.float64] | None, S: float) -> tuple[float, float]:
    """(θ_A + θ_B)/2 at stiffness S, and what A is turned further, B less, because the springs differ [rad]."""
    if table is None:
        return (S - 2.0 * d.k_1 * d.r_j**2) / (4.0 * d.k_2 * d.r_j**2 * d.r_m), 0.0
    low, share = _row_below(table, STIFFNESS, S)
    return 0.5 * _between(table, low, share, SUM), _between(table, low, share, OFFSET)


@compiled
def _stiffness_under(d: Decoupler, table: NDArray[np.float64] | None, F: float) -> float:
    if table is None:
        return 2.0 * d.r_j**2 * math.sqrt(max(d.k_1**2 + 4.0 * d.k_2 * (F - d.k_0), 0.0))
    low, share = _row_below(table, TENSION, F)
    return _between(table, low, share, STIFFNESS)


@compiled
def _tension_under(d: Decoupler, table: NDArray[np.float64] | None, S: float) -> float:
    if table is None:
        return d.k_0 + ((0.5 * S / d.r_j**2) ** 2 - d.k_1**2) / (4.0 * d.k_2)
    low, share = _row_below(table, STIFFNESS, S)
    return _between(table, low, share, TENSION)


@compiled
def _stiffness(d: Decoupler, table: NDArray[np.float64] | None, turned: float) -> float:
    """S at θ_A + θ_B = turned."""
    if table is None:
        return 2.0 * d.r_j**2 * (d.k_1 + d.k_2 * d.r_m * turned)
    low, share = _place(table, turned)
    return _between(table, low, share, STIFFNESS)


@compiled
def _difference(table: NDArray[np.float64] | None, turned: float) -> float:
    """θ_A − θ_B that keeps q_e = 0 at θ_A + θ_B = turned."""
    if table is None:
        return 0.0
    low, share = _place(table, turned)
    return 2.0 * _between(table, low, share, OFFSET)


@compiled
def _slopes(d: Decoupler, table: NDArray[np.float64] | None, turned: float) -> tuple[float, float]:
    """Differentiate ``_stiffness`` and ``_difference`` with respect to the sum."""
    if table is None:
        return 2.0 * d.r_j**2 * d.k_2 * d.r_m, 0.0
    low, _ = _place(table, turned)
    width = table[low + 1, SUM] - table[low, SUM]
    S_rate = (table[low + 1, STIFFNESS] - table[low, STIFFNESS]) / width
    return S_rate, 2.0 * (table[low + 1, OFFSET] - table[low, OFFSET]) / width


@compiled
def _place(table: NDArray[np.float64], turned: float) -> tuple[int, float]:
    """Row below the sum ``turned`` (rows are evenly spaced in it) and the share of the way to the next one."""
    place = (turned - table[0, SUM]) / (table[1, SUM] - table[0, SUM])
    low = int(min(max(place, 0.0), table.shape[0] - 2.0))
    return low, place - low


@compiled
def _row_below(table: NDArray[np.float64], column: int, value: float) -> tuple[int, float]:
    """Row below ``value`` in a rising column, and the share of the way to the next one."""
    low, high = 0, table.shape[0] - 1
    while high - low > 1:
        middle = (low + high) // 2
        if table[middle, column] <= value:
            low = middle
        else:
            high = middle
    return low, (value - table[low, column]) / (table[high, column] - table[low, column])


@compiled
def _between(table: NDArray[np.float64], low: int, share: float, column: int) -> float:
    """Value between two rows; beyond the ends of the table the outermost piece goes on."""
    here, there = float(table[low, column]), float(table[low + 1, column])
    return here + share * (there - here)


def decoupler_for(parameters: PlantParameters) -> Decoupler:
    """Decoupler of a parameter set's geometry and identified springs."""
    r_m, r_j = parameters.geometry.r_m, parameters.geometry.r_j
    A, B = parameters.identified_curve("A"), parameters.identified_curve("B")
    if A.k == B.k and len(A.k) == 3:
        return Decoupler(r_m, r_j, *A.k)
    return Decoupler(r_m, r_j, np.nan, np.nan, np.nan, _table(A, B, r_m, r_j))


@lru_cache(maxsize=8)
def _table(A: SpringParameters, B: SpringParameters, r_m: float, r_j: float) -> NDArray[np.float64]:
    # Tuning asks for the decoupler at every λ it tries; the table takes 20 ms.
    return equilibrium_table(A.spring(), B.spring(), r_m, r_j)
