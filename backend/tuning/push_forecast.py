"""What a held push does to the joint, and how hard the joint feels: by the linear sampled loop, with its rejection.

Dead zone and bound of the rejection are in it. The spring gives way before any motor has moved, so the first give is
r_j F/S whatever loops do; what they decide is for how long.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.controllers import cascade, rejection, touch
from backend.controllers.rejection import Rejection
from backend.tuning.remembered import remembered
from backend.tuning.sampled_loop import INPUTS, OUTPUTS, Sampled, sampled_loop
from plant.interface import T_s
from plant.parameters import PlantParameters

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

PUSH_N = 5.0
"""The push of the forecast [N], held."""

FELT_HZ = (0.1, 1.0)
"""Where the stiffness that one feels is told [Hz]: to a hand that leans on the joint, and to one that shakes it."""

NEAR_RAD = 2.0 * np.pi / 4000.0
"""The joint is back when it stays so near to its reference [rad]: a count of the paper's encoder."""

_LASTS = 14.0
"""Of λ_q: so long is looked at; at the slowest loop the deviation has fallen to a thousandth."""

_NEVER = -1.0
"""In place of a time [s] that is not reached: only what is finite is remembered."""


class PushForecast(NamedTuple):
    """Under a held push of PUSH_N, and a sine of force beyond the dead zone.

    ``give`` [rad]: largest deviation. ``back_s`` [s]: from when on it stays within NEAR_RAD, nan where it does not.
    ``felt_slow``, ``felt_fast`` [N·m/rad]: outside torque over deviation, at FELT_HZ.
    """

    give: float
    back_s: float
    felt_slow: float
    felt_fast: float


def push_forecast(parameters: PlantParameters, tuning: cascade.Tuning, S: float, lam_q: float) -> PushForecast:
    """Return what a held push does at S [N·m/rad]; ``lam_q`` [s] says for how long it is looked at."""
    asked = ("held push", parameters, tuning.motors, tuning.rejection, tuning.schedule.entries.tolist(), S, lam_q)
    give, back_s, *felt = remembered(asked, 4, partial(_forecast, parameters, tuning, S, lam_q))
    return PushForecast(give, back_s if back_s != _NEVER else np.nan, *felt)


def answered(r: Rejection, tau: Array, S: float) -> tuple[Array, Array]:
    """Return what the rejection adds under a torque (n,) [N·m]: the loop's inputs ``q_e`` and ``q_off``, each (n,).

    The torque is the observer's, three lags of its pole behind; what it sees comes at once, as in the tick.
    """
    q_e, q_off = np.zeros(tau.size), np.zeros(tau.size)
    if r.k_ext == 0.0:
        return q_e, q_off
    state, estimate = rejection.changed(r, rejection.IDLE, 0.0), estimated(tau)
    for k, seen in enumerate(estimate):
        state = rejection.step(r, state, float(seen))
        q_e[k], q_off[k] = rejection.answer(state, S)
    return q_e, q_off


def estimated(tau: Array) -> Array:
    """Estimate (n,) of a torque (n,) [N·m]: that of a tick has what acted before it."""
    from scipy.signal import lfilter

    kept = np.exp(-touch.POLE * T_s)
    estimate = np.append(0.0, tau[:-1])
    for _ in range(3):
        estimate = lfilter([1.0 - kept], [1.0, -kept], estimate)
    return np.asarray(estimate)


def felt_stiffness(closed: Sampled, r: Rejection, S: float, f: Array) -> Complex:
    """Outside torque over the deviation of q [N·m/rad] at ``f`` (n,) [Hz], of a push beyond the rejection's dead zone.

    ``closed`` is the loop at S [N·m/rad].
    """
    z = np.exp(2j * np.pi * np.asarray(f) * T_s)
    kept = np.exp(-touch.POLE * T_s)
    estimate = ((1.0 - kept) / (1.0 - kept / z)) ** 3 / z
    behind = ((1.0 - r.kept) / (1.0 - r.kept / z)) ** 4
    H = closed.response(f)[:, OUTPUTS.q, :]
    share = r.k_ext * estimate / S
    return np.asarray(
        1.0 / (H[:, INPUTS.tau_ext] - share * H[:, INPUTS.q_e] + share * (1.0 - behind) * H[:, INPUTS.q_off])
    )


def _forecast(parameters: PlantParameters, tuning: cascade.Tuning, S: float, lam_q: float) -> tuple[float, ...]:
    closed, r = sampled_loop(parameters, tuning, S).closed, tuning.rejection
    w = np.zeros((round((2.0 + _LASTS * lam_q) / T_s), len(INPUTS)))
    w[:, INPUTS.tau_ext] = parameters.geometry.r_j * PUSH_N
    w[:, INPUTS.q_e], w[:, INPUTS.q_off] = answered(r, w[:, INPUTS.tau_ext], S)
    off = np.abs(closed.played(w)[:, OUTPUTS.q])
    away = np.flatnonzero(off > NEAR_RAD)
    last = int(away[-1]) + 1 if away.size else 0
    back_s = last * T_s if last < off.size else _NEVER
    return float(off.max()), back_s, *map(float, np.abs(felt_stiffness(closed, r, S, np.array(FELT_HZ))))
