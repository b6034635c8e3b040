"""A motor with known parameters, driven by a voltage: selectable Coulomb friction, dead time and noise.

Integrated with 200 midpoint steps per sample and static friction, independent of the exact solution of the
package.
"""

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

PERIOD_S = 1e-3
K_M, T_M = 2.86, 0.22
_STEPS = 200


def voltages(kind: str, count: int = 12_000, seed: int = 0) -> Array:
    """Return voltages [V] within ±5 V, shape (count,): "binary", "levels" or "sines"."""
    random, t = np.random.default_rng(seed), np.arange(count) * PERIOD_S
    match kind:
        case "binary":
            return np.repeat(random.choice([-5.0, 5.0], -(-count // 200)), 200)[:count]
        case "levels":
            return np.repeat(random.uniform(-5.0, 5.0, -(-count // 400)), 400)[:count]
        case _:
            return np.asarray(4.0 * np.sin(2.0 * np.pi * 0.5 * t) + np.sin(2.0 * np.pi * 1.3 * t))


def motor(u: Array, u_c: float = 0.0, delay_s: float = 0.0) -> tuple[Array, Array]:
    """Speed [rad/s] and angle [rad] at each sample from rest for a voltage held between samples; dead times to 5 µs."""
    return _motor(u, u_c, round(_STEPS * delay_s / PERIOD_S))


def noisy(clean: Array, share: float, seed: int = 1) -> Array:
    """Add white noise with this share of the standard deviation of the signal."""
    return np.asarray(clean + share * np.std(clean) * np.random.default_rng(seed).standard_normal(clean.size))


@numba.njit(cache=True)
def _motor(u: Array, u_c: float, late: int) -> tuple[Array, Array]:
    speed, angle = np.empty(u.size), np.empty(u.size)
    w = theta = 0.0
    step = PERIOD_S / _STEPS
    for k in range(u.size):
        speed[k], angle[k] = w, theta
        for part in range(_STEPS):
            past = k * _STEPS + part - late
            voltage = u[past // _STEPS] if past >= 0 else 0.0
            if w == 0.0 and abs(voltage) <= u_c:
                continue
            sign = np.sign(w) if w != 0.0 else np.sign(voltage)
            drive = K_M * (voltage - u_c * sign)
            middle = w + step / 2.0 / T_M * (drive - w)
            moved = w + step / T_M * (drive - middle)
            if w * moved >= 0.0:
                theta += step * middle
                w = moved
                continue
            # The motor passes rest within the step; it continues if the voltage overcomes the friction.
            until = step * w / (w - moved)
            theta += until * w / 2.0
            w = 0.0
            if abs(voltage) > u_c:
                w = (step - until) * K_M * (voltage - u_c * np.sign(voltage)) / T_M
                theta += (step - until) * w / 2.0
    return speed, angle
