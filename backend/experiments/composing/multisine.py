"""The sum of harmonics that a multisine is. Pure."""


def peak_of(lines: int) -> float:
    """Return the largest value of the sum of so many cosines with Schroeder's phases, of over its period."""
    import numpy as np

    t = np.arange(0.0, 1.0, 1.0 / (64 * lines))
    k = np.arange(1, lines + 1)
    total = np.cos(2.0 * np.pi * np.outer(t, k) - np.pi * k * (k - 1) / lines).sum(axis=1)
    return float(np.abs(total).max()) * 1.01  # between the points it may be a little more
