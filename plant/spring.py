"""The non-linear tendon spring: tension over elongation (equations 3-4), slack below, solid above.

Any spring is kept as a piecewise polynomial: a polynomial spring is one piece, a tabulated one a monotone
interpolation with a piece per interval. The same compiled functions serve both.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant.compiled import compiled


class Spring(NamedTuple):
    """A spring ready for the compiled functions.

    ``breaks`` (n,) [m] start the pieces; ``coefficients`` (n, order + 1), lowest power first, of the elongation
    counted from the piece's start. ``x_slack`` [m] is the root of zero force, ``x_solid`` [m] where the coils touch,
    ``k_solid`` [N/m] the slope beyond.
    """

    breaks: NDArray[np.float64]
    coefficients: NDArray[np.float64]
    x_slack: float
    x_solid: float
    k_solid: float


@compiled
def polynomial(spring: Spring, x: float) -> float:
    """Force [N] of the fitted curve at elongation x [m], whether or not the tendon is taut there."""
    piece = 0
    while piece + 1 < spring.breaks.shape[0] and x >= spring.breaks[piece + 1]:
        piece += 1
    s = x - spring.breaks[piece]
    force = 0.0
    for power in range(spring.coefficients.shape[1] - 1, -1, -1):
        force = force * s + spring.coefficients[piece, power]
    return force


@compiled
def slope(spring: Spring, x: float) -> float:
    """F'(x) [N/m] of the fitted curve at elongation x [m], whether or not the tendon is taut there."""
    piece = 0
    while piece + 1 < spring.breaks.shape[0] and x >= spring.breaks[piece + 1]:
        piece += 1
    s = x - spring.breaks[piece]
    rate = 0.0
    for power in range(spring.coefficients.shape[1] - 1, 0, -1):
        rate = rate * s + power * spring.coefficients[piece, power]
    return rate


@compiled
def tension(spring: Spring, x: float) -> float:
    """Force in the tendon [N] at elongation x [m]: never pushes, steep once the spring is solid."""
    if x <= spring.x_slack:
        return 0.0
    if x > spring.x_solid:
        return polynomial(spring, spring.x_solid) + spring.k_solid * (x - spring.x_solid)
    return polynomial(spring, x)


@compiled
def tension_slope(spring: Spring, x: float) -> float:
    """dF/dx [N/m] of ``tension``: zero while slack, ``k_solid`` when solid."""
    if x <= spring.x_slack:
        return 0.0
    if x > spring.x_solid:
        return spring.k_solid
    return slope(spring, x)


def polynomial_spring(coefficients: tuple[float, ...], x_solid: float, k_solid: float) -> Spring:
    """Spring F(x) = k0 + k1 x + k2 x² + ... (coefficients lowest power first).

    Raises ValueError where the curve has no zero-force root below ``x_solid`` or does not rise and stiffen from
    there on: stiffness of the joint could then not be set.
    """
    k = np.asarray(coefficients, dtype=np.float64)
    spring = Spring(np.zeros(1), k[np.newaxis, :].copy(), 0.0, x_solid, k_solid)
    return spring._replace(x_slack=_zero_force_root(spring))


def tabulated_spring(x: NDArray[np.float64], F: NDArray[np.float64], k_solid: float) -> Spring:
    """Spring through measured points (elongation [m], force [N]) by monotone cubic interpolation (Fritsch-Carlson).

    The first point must be at zero force, the last is where the spring becomes solid. Raises ValueError for points
    that do not rise.
    """
    if x.ndim != 1 or x.shape != F.shape or x.size < 3:
        raise ValueError(
            f"a spring table needs two columns of equal length, 3 rows or more; got {x.shape} and {F.shape}"
        )
    if not (np.all(np.isfinite(x)) and np.all(np.isfinite(F))):
        raise ValueError("the spring table holds values that are not finite: remove those rows")
    if np.any(np.diff(x) <= 0.0) or np.any(np.diff(F) <= 0.0):
        raise ValueError("elongation [m] and force [N] of the spring table must both rise from row to row")
    if abs(F[0]) > 1e-9:
        raise ValueError(f"the spring table must begin at zero force, not {F[0]:g} N")
    h, secant = np.diff(x), np.diff(F) / np.diff(x)
    at_node = _monotone_slopes(h, secant)
    left, right = at_node[:-1], at_node[1:]
    coefficients = np.column_stack(
        (F[:-1], left, (3.0 * secant - 2.0 * left - right) / h, (left + right - 2.0 * secant) / h**2)
    )
    return Spring(x[:-1].astype(np.float64), coefficients, float(x[0]), float(x[-1]), k_solid)


def elongation(spring: Spring, F: float) -> float:
    """Elongation [m] at which the taut spring carries F [N], 0 < F <= force at ``x_solid``; else ValueError."""
    F_solid = tension(spring, spring.x_solid)
    if not 0.0 < F <= F_solid:
        raise ValueError(f"tension {F:g} N is outside 0-{F_solid:.1f} N, where the spring is neither slack nor solid")
    return _root(lambda x: polynomial(spring, x) - F, spring.x_slack, spring.x_solid)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Root of a rising function between low and high, by bisection to the last bit (the tick may not need SciPy)."""
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if function(middle) < 0.0 else (low, middle)
    return high


def _monotone_slopes(h: NDArray[np.float64], secant: NDArray[np.float64]) -> NDArray[np.float64]:
    """Slopes at the nodes of a table: weighted harmonic means inside, limited three-point formula at the ends."""
    w_left, w_right = 2.0 * h[1:] + h[:-1], h[1:] + 2.0 * h[:-1]
    inner = (w_left + w_right) / (w_left / secant[:-1] + w_right / secant[1:])

    def end(h0: float, h1: float, s0: float, s1: float) -> float:
        return min(max(((2.0 * h0 + h1) * s0 - h0 * s1) / (h0 + h1), 0.0), 3.0 * s0)

    first = end(h[0], h[1], secant[0], secant[1])
    last = end(h[-1], h[-2], secant[-1], secant[-2])
    return np.concatenate(([first], inner, [last]))


def _zero_force_root(spring: Spring) -> float:
    """Return the largest root of F(x) = 0 below x_solid, after checking that the curve rises and stiffens above it."""
    curve = np.polynomial.Polynomial(spring.coefficients[0])
    x = np.linspace(-spring.x_solid, spring.x_solid, 4001)
    negative = np.flatnonzero(curve(x) <= 0.0)
    if negative.size == 0 or negative[-1] == x.size - 1:
        raise ValueError(f"the spring polynomial has no zero-force root below x_solid = {spring.x_solid:g} m")
    below = int(negative[-1])
    x_slack = _root(lambda value: polynomial(spring, value), float(x[below]), float(x[below + 1]))
    taut = curve.deriv()(x[below + 1 :])
    if np.any(taut <= 0.0) or np.any(np.diff(taut) < 0.0):
        raise ValueError("the spring polynomial must rise and stiffen between its zero-force root and x_solid")
    return x_slack
