"""Roots of rising functions, without SciPy: the tick may not need it, and loading it takes longer than most runs."""

from collections.abc import Callable


def root(function: Callable[[float], float], low: float, high: float) -> float:
    """Root of a function that rises between low and high, by bisection to the last bit."""
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if function(middle) < 0.0 else (low, middle)
    return high
