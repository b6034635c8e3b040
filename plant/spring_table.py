"""A spring from measured points, joined by a curve that rises wherever the points do."""

import numpy as np
from numpy.typing import NDArray

from plant.spring import Spring, polynomial

Array = NDArray[np.float64]


def tabulated_spring(x: Array, F: Array, x_solid: float, k_solid: float) -> Spring:
    """Spring through measured points (elongation [m], force [N]) by monotone cubic interpolation (Fritsch-Carlson).

    The first point is at zero force; ``x_solid``, where the coils touch, lies inside the table. Raises ValueError for
    points that do not rise.
    """
    if x.ndim != 1 or x.shape != F.shape or x.size < 3:
        raise ValueError(
            f"a spring table needs two columns of equal length, 3 rows or more; got {x.shape} and {F.shape}"
        )
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(F))):
        raise ValueError("the spring table holds values that are not finite: remove those rows")
    wrong = np.flatnonzero((np.diff(x) <= 0.0) | (np.diff(F) <= 0.0))
    if wrong.size:
        raise ValueError(
            f"elongation [m] and force [N] of the spring table must both rise from row to row, but do not after "
            f"row {wrong[0] + 1}: ({x[wrong[0]]:g} m, {F[wrong[0]]:g} N)"
        )
    if abs(F[0]) > 1e-9:
        raise ValueError(f"the spring table must begin at zero force, not {F[0]:g} N")
    if not x[0] < x_solid <= x[-1]:
        raise ValueError(f"x_solid = {x_solid:g} m lies outside the spring table, {x[0]:g} to {x[-1]:g} m")
    h, secant = np.diff(x), np.diff(F) / np.diff(x)
    at_node = _monotone_slopes(h, secant)
    left, right = at_node[:-1], at_node[1:]
    pieces = np.column_stack(
        (x[:-1], F[:-1], left, (3.0 * secant - 2.0 * left - right) / h, (left + right - 2.0 * secant) / h**2)
    )
    no_polynomial = (0.0,)
    spring = Spring(no_polynomial, pieces, float(x[0]), x_solid, 0.0, k_solid)
    return spring._replace(F_solid=polynomial(spring, x_solid))


def _monotone_slopes(h: Array, secant: Array) -> Array:
    """Slopes at the nodes of a table: weighted harmonic means inside, limited three-point formula at the ends."""
    w_left, w_right = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    inner = (w_left + w_right) / (w_left / secant[:-1] + w_right / secant[1:])

    def end(h0: float, h1: float, s0: float, s1: float) -> float:
        return min(max(((2.0 * h0 + h1) * s0 - h0 * s1) / (h0 + h1), 0.0), 3.0 * s0)

    first = end(h[0], h[1], secant[0], secant[1])
    last = end(h[-1], h[-2], secant[-1], secant[-2])
    return np.concatenate(([first], inner, [last]))
