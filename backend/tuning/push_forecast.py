"""What a held push does to the joint, and how hard the joint feels.

Deflection and recovery are those of the compiled closed loop on the expected plant, with friction, encoder counts, dead
zones and rejection; the stiffness that one feels is that of the linear sampled loop. The spring gives way before any
motor has moved, so the first deflection is r_j F/S whatever the loops do; they decide how long it lasts.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backend.control import cascade, disturbance_observer
from backend.control.disturbance_observer import Rejection
from backend.tuning import closed_loop
from backend.tuning.expected_plant import expected_plant
from backend.tuning.sampled_loop import INPUTS, OUTPUTS, Sampled, sampled_loop
from backend.tuning.step_forecast import HELD_S, shown_ticks
from plant.interface import T_s
from plant.parameters import PlantParameters

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_LASTS = 9.0
"""Of λ_q: how long a push is simulated, beside 2 s."""

PUSH_N = 5.0
"""The push of the forecast [N], held."""

FELT_HZ = (0.1, 1.0)
"""Where the stiffness that one feels is told [Hz]: to a hand that leans on the joint, and to one that shakes it."""

NEAR_RAD = float(np.radians(0.3))
"""The joint is back when it stays so near to its reference [rad]: 3.3 counts of the paper's encoder.

One count is no measure of it: friction and the dead zone of the integrators may leave the joint a count off, and a
reference between two counts shifts the band by half of one.
"""

LEARNED_S = 2.0
"""How long the loop is at rest before the push where the outside force has to be learned first [s]."""


@dataclass(frozen=True)
class PushForecast:
    """Under a held push of PUSH_N, and a sine of force beyond the dead zone.

    ``give`` [rad]: largest deviation. ``back_s`` [s]: from when on it stays within NEAR_RAD, nan where it does not.
    ``felt_slow``, ``felt_fast`` [N·m/rad]: outside torque over deviation, at FELT_HZ. ``off`` (n,): deviation [rad]
    over ``t`` (n,) [s].
    """

    give: float
    back_s: float
    felt_slow: float
    felt_fast: float
    t: Array
    off: Array


def push_forecast(
    parameters: PlantParameters,
    tuning: cascade.CascadeTuning,
    S: float,
    lam_q: float,
    F_push: float = PUSH_N,
    q: float = 0.0,
    entry: float = -1.0,
    *,
    rig: closed_loop.Rig | None = None,
    held: Sampled | None = None,
) -> PushForecast:
    """Return what a held push of ``F_push`` [N] does at ``q`` [rad] and S [N·m/rad].

    ``entry``: bank entry in use before it, −1 for the one nearest to S. ``lam_q`` [s] says for how long it is
    simulated: the deviation has fallen to a hundredth by then. Where they are at hand, ``rig`` is that of the expected
    plant, and ``held`` is ``held_plant`` at S.
    """
    rejects = tuning.rejection.k_ext > 0.0
    rest, pushed = round((LEARNED_S if rejects else HELD_S) / T_s), round((2.0 + _LASTS * lam_q) / T_s)
    force = np.repeat((0.0, F_push), (rest, pushed))
    trajectory = closed_loop.run(
        expected_plant(parameters),
        tuning,
        np.full(force.size, q),
        np.full(force.size, S),
        force,
        entry=entry,
        learned_at=rest - 1 if rejects else None,
        rig=rig,
    )
    off = trajectory.q[rest:] - q
    away = np.flatnonzero(~(np.abs(off) <= NEAR_RAD + 1e-9))
    back = int(away[-1]) + 1 if away.size else 0
    back_s = back * T_s if back < off.size else np.nan
    shown = shown_ticks(off.size, back_s)
    closed = sampled_loop(parameters, tuning, S, plant=held).closed
    felt_slow, felt_fast = map(float, np.abs(felt_stiffness(closed, tuning.rejection, S, np.array(FELT_HZ))))
    give = float(np.nanmax(np.abs(off)))
    return PushForecast(give, back_s, felt_slow, felt_fast, np.asarray(shown * T_s, dtype=np.float64), off[shown])


def answered(r: Rejection, tau: Array, S: float) -> tuple[Array, Array]:
    """Return what the rejection adds under a torque (n,) [N·m]: the loop's inputs ``q_e`` and ``q_off``, each (n,).

    The torque is the observer's, three lags of its pole behind; what it sees comes at once, as in the tick.
    """
    q_e, q_off = np.zeros(tau.size), np.zeros(tau.size)
    if r.k_ext == 0.0:
        return q_e, q_off
    state, estimate = disturbance_observer.changed(r, disturbance_observer.IDLE, 0.0), estimated(tau)
    for k, seen in enumerate(estimate):
        state = disturbance_observer.step_disturbance_feedforward(r, state, float(seen))
        q_e[k], q_off[k] = disturbance_observer.answer(state, S)
    return q_e, q_off


def estimated(tau: Array) -> Array:
    """Estimate (n,) of a torque (n,) [N·m]: that of a tick has what acted before it."""
    from scipy.signal import lfilter

    kept = np.exp(-disturbance_observer.POLE * T_s)
    estimate = np.append(0.0, tau[:-1])
    for _ in range(3):
        estimate = lfilter([1.0 - kept], [1.0, -kept], estimate)
    return np.asarray(estimate)


def felt_stiffness(closed: Sampled, r: Rejection, S: float, f: Array) -> Complex:
    """Outside torque over the deviation of q [N·m/rad] at ``f`` (n,) [Hz], of a push beyond the rejection's dead zone.

    ``closed`` is the loop at S [N·m/rad].
    """
    z = np.exp(2j * np.pi * np.asarray(f) * T_s)
    kept = np.exp(-disturbance_observer.POLE * T_s)
    estimate = ((1.0 - kept) / (1.0 - kept / z)) ** 3 / z
    behind = ((1.0 - r.kept) / (1.0 - r.kept / z)) ** 4
    H = closed.response(f)[:, OUTPUTS.q, :]
    share = r.k_ext * estimate / S
    return np.asarray(
        1.0 / (H[:, INPUTS.tau_ext] - share * H[:, INPUTS.q_e] + share * (1.0 - behind) * H[:, INPUTS.q_off])
    )
