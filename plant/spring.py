"""The non-linear tendon spring: tension over elongation (equations 3-4), slack below, solid above.

A spring is a polynomial or, where ``pieces`` is given, a table joined by cubics. Whether ``pieces`` is None is known to
the compiler, so that the polynomial runs without the table's search.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant.compiled import compiled
from plant.root import root


class Spring(NamedTuple):
    """A spring ready for the compiled functions; ``polynomial_spring`` and ``tabulated_spring`` make it.

    ``k`` [N/m^i], lowest power first. ``pieces`` (n, 5): where a piece starts [m], then its polynomial of the
    elongation counted from there. ``x_slack`` [m] is the root of zero force, ``x_solid`` [m] where the coils touch,
    ``F_solid`` [N] the force there and ``k_solid`` [N/m] the slope beyond.
    """

    k: tuple[float, ...]
    pieces: NDArray[np.float64] | None
    x_slack: float
    x_solid: float
    F_solid: float
    k_solid: float


@compiled
def _derivative(k: tuple[float, ...], s: float, order: int) -> float:
    """Differentiate a polynomial ``order`` times, 0 to 2; Horner's rule."""
    total = 0.0
    for power in range(len(k) - 1, order - 1, -1):
        factor = 1.0
        for down in range(order):
            factor *= power - down
        total = total * s + factor * k[power]
    return total


@compiled
def _curve(k: tuple[float, ...], pieces: NDArray[np.float64] | None, x: float, order: int) -> float:
    if pieces is None:
        return _derivative(k, x, order)
    low, high = 0, pieces.shape[0]
    while high - low > 1:
        middle = (low + high) // 2
        if x < pieces[middle, 0]:
            high = middle
        else:
            low = middle
    piece = (pieces[low, 1], pieces[low, 2], pieces[low, 3], pieces[low, 4])
    return _derivative(piece, x - pieces[low, 0], order)


@compiled
def polynomial(spring: Spring, x: float) -> float:
    """Force [N] of the fitted curve at elongation x [m], whether or not the tendon is taut there."""
    return _curve(spring.k, spring.pieces, x, 0)


@compiled
def slope(spring: Spring, x: float) -> float:
    """F'(x) [N/m] of the fitted curve at elongation x [m], whether or not the tendon is taut there."""
    return _curve(spring.k, spring.pieces, x, 1)


@compiled
def curvature(spring: Spring, x: float) -> float:
    """F''(x) [N/m²] of the fitted curve at elongation x [m], whether or not the tendon is taut there."""
    return _curve(spring.k, spring.pieces, x, 2)


@compiled
def tension(spring: Spring, x: float) -> float:
    """Force in the tendon [N] at elongation x [m]: never pushes, steep once the spring is solid."""
    if x <= spring.x_slack:
        return 0.0
    if x > spring.x_solid:
        return spring.F_solid + spring.k_solid * (x - spring.x_solid)
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

    Raises ValueError where the curve has no zero-force root below ``x_solid`` or does not rise from there on.
    """
    curve = np.polynomial.Polynomial(coefficients)
    x = np.linspace(-x_solid, x_solid, 4001)
    negative = np.flatnonzero(curve(x) <= 0.0)
    if negative.size == 0 or negative[-1] == x.size - 1:
        raise ValueError(f"the spring polynomial has no zero-force root below x_solid = {x_solid:g} m")
    below = int(negative[-1])
    x_slack = root(lambda value: float(curve(value)), float(x[below]), float(x[below + 1]))
    falling = np.flatnonzero(curve.deriv()(x[below + 1 :]) <= 0.0)
    if falling.size:
        at = x[below + 1 + int(falling[0])]
        raise ValueError(f"the spring polynomial must rise up to x_solid = {x_solid:g} m, but falls at x = {at:.4f} m")
    k = tuple(float(coefficient) for coefficient in coefficients)
    return Spring(k, None, x_slack, x_solid, float(curve(x_solid)), k_solid)


def require_stiffening(spring: Spring) -> None:
    """Raise ValueError unless F' rises all the way from slack to solid: else stiffness could not be set by tension."""
    x = np.linspace(spring.x_slack, spring.x_solid, 2001)[1:-1]
    slopes = np.array([slope(spring, value) for value in x])
    flat = np.flatnonzero(np.diff(slopes) <= 1e-9 * slopes[-1])
    if flat.size:
        raise ValueError(
            f"the spring does not stiffen at x = {x[flat[0]]:.4f} m, so that tension cannot set the joint's stiffness "
            "there: fit a polynomial of order 2, or give fewer and smoother points"
        )


def elongation(spring: Spring, F: float) -> float:
    """Elongation [m] at which the taut spring carries F [N], 0 < F <= force at ``x_solid``; else ValueError."""
    if not 0.0 < F <= spring.F_solid:
        raise ValueError(
            f"tension {F:g} N is outside 0-{spring.F_solid:.1f} N, where the spring is neither slack nor solid"
        )
    return root(lambda x: polynomial(spring, x) - F, spring.x_slack, spring.x_solid)
