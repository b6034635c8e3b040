"""Records whose truth is known: a linear plant inside a PI loop, a binary sequence at its input, noise in the loop.

Simulated sample by sample through scipy's own discretization, independent of the package's filters.
"""

from typing import TypedDict

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, dlsim, lfilter, max_len_seq, tf2ss

Array = NDArray[np.float64]

PERIOD_S = 1e-3
K_P, K_I = 200.0, 256.0
FIRST = {"K": 0.0484, "T": 0.78}
THIRD = {"K": 0.0484, "T": 0.78, "a2": 4.919e-5, "a1": 4.688e-3}
ONE_HERTZ = float(np.exp(-2.0 * np.pi * PERIOD_S))


def denominator(truth: dict[str, float]) -> Array:
    """Coefficients of T s + 1 or (T s + 1)(a2 s² + a1 s + 1), highest power first."""
    lag = np.array([truth["T"], 1.0])
    return np.convolve(lag, [truth["a2"], truth["a1"], 1.0]) if "a2" in truth else lag


def held_response(truth: dict[str, float], u: Array) -> Array:
    """Response from rest to an input held between samples, shape of ``u``."""
    system = cont2discrete(tf2ss([truth["K"]], denominator(truth)), PERIOD_S)
    return np.asarray(dlsim(system, u)[1][:, 0])


class Disturbed(TypedDict, total=False):
    """Disturbances of a closed-loop record beyond white noise."""

    pole: float
    offset: float
    drift: float
    cut: int


def closed_loop_record(
    truth: dict[str, float],
    snr_dB: float,
    seed: int,
    *,
    samples: int = 20_000,
    pole: float = 0.0,
    offset: float = 0.0,
    drift: float = 0.0,
    cut: int = 0,
) -> tuple[Array, Array, Array]:
    """Return input u, output y and excitation of the bench configuration, shape (samples,) each.

    ``pole`` colours the noise (AR(1)); ``offset`` and ``drift`` over the record are in standard deviations of the
    noise-free output; ``cut`` samples are dropped from the front. 8 bits and 50 ms chips for first order, 10 bits and
    10 ms for third.
    """
    count = samples + cut
    bits, chip = (10, 10) if "a2" in truth else (8, 50)
    excitation = np.resize(np.repeat(2.0 * max_len_seq(bits)[0] - 1.0, chip), count)
    A, B, C, _, _ = cont2discrete(tf2ss([truth["K"]], denominator(truth)), PERIOD_S)
    clean, _ = _loop(A, B[:, 0], C[0], excitation, np.zeros(count))
    random = np.random.default_rng(seed)
    noise = lfilter([np.sqrt(1.0 - pole**2)], [1.0, -pole], random.standard_normal(count))
    disturbance = 10.0 ** (-snr_dB / 20.0) * noise + offset + drift * np.arange(count) / count
    y, u = _loop(A, B[:, 0], C[0], excitation, np.std(clean) * disturbance)
    return u[cut:], y[cut:], excitation[cut:]


@numba.njit(cache=True)
def _loop(A: Array, B: Array, C: Array, excitation: Array, disturbance: Array) -> tuple[Array, Array]:
    count, order = excitation.size, B.size
    x, following = np.zeros(order), np.zeros(order)
    y, u = np.empty(count), np.empty(count)
    integral = 0.0
    for k in range(count):
        y[k] = disturbance[k]
        for i in range(order):
            y[k] += C[i] * x[i]
        integral -= K_I * PERIOD_S * y[k]
        u[k] = -K_P * y[k] + integral + excitation[k]
        for i in range(order):
            following[i] = B[i] * u[k]
            for j in range(order):
                following[i] += A[i, j] * x[j]
        x[:] = following
    return y, u
