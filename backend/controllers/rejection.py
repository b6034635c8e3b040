"""Feed-forward of the outside force: the equilibrium goes as far against a push as the springs give way to it.

δq_e = −k_ext τ_ext/S (equation 14). The motors follow it behind four lags of λ_motor, and what the joint is off until
then is not the position loop's business: it is told where the joint should be by now, δq = k_ext (τ_ext − τ_f)/S with
τ_f behind the same lags. Else it would turn against a push that is being answered already, and overshoot when the push
is balanced. As the estimate does not depend on motors and loops, no pole of a free joint moves (docs/decisions/0048).
"""

import math
from typing import NamedTuple

from backend.controllers.dead_zone import beyond
from plant.compiled import compiled


class Rejection(NamedTuple):
    """``k_ext`` [1]: share of the push that is answered, 0 for none.

    ``unseen`` [N·m]: torque that is left to the position loop, so that the estimate's noise moves nothing; ``most``
    [N·m]: the largest that is answered. ``kept`` [1]: what one of the four lags keeps of itself over T_s.
    """

    k_ext: float
    unseen: float
    most: float
    kept: float


class State(NamedTuple):
    """``k_ext`` in use, 0 where nothing is answered; torque [N·m] that is, and behind one to four lags."""

    k_ext: float
    tau: float
    lag_1: float
    lag_2: float
    lag_3: float
    tau_f: float


IDLE = State(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
"""Nothing is answered."""


class Answer(NamedTuple):
    """What comes on top of the equilibrium, ``q_e`` [rad], and how far the joint is expected to be off, ``q`` [rad]."""

    q_e: float
    q: float


NONE = Answer(0.0, 0.0)


@compiled
def answer(state: State, S: float) -> Answer:
    """Return what a state says at stiffness S [N·m/rad]."""
    if state.k_ext == 0.0:
        return NONE
    return Answer(-state.k_ext * state.tau / S, state.k_ext * (state.tau - state.tau_f) / S)


@compiled
def changed(r: Rejection, state: State, tau_ext: float) -> State:
    """Return the state for this tick's k_ext, idle for a torque [N·m] of nan.

    What begins takes the push that is there for balanced already.
    """
    k_ext = r.k_ext if math.isfinite(tau_ext) else 0.0
    if k_ext == state.k_ext:
        return state
    if k_ext == 0.0:
        return IDLE
    if state.k_ext == 0.0:
        tau = _answered(r, tau_ext)
        return State(k_ext, tau, tau, tau, tau, tau)
    return State(k_ext, state.tau, state.lag_1, state.lag_2, state.lag_3, state.tau_f)


@compiled
def step(r: Rejection, state: State, tau_ext: float) -> State:
    """Take the torque of a tick [N·m], its bias taken off."""
    if state.k_ext == 0.0:
        return state
    tau, kept = _answered(r, tau_ext), r.kept
    lag_1 = tau + kept * (state.lag_1 - tau)
    lag_2 = lag_1 + kept * (state.lag_2 - lag_1)
    lag_3 = lag_2 + kept * (state.lag_3 - lag_2)
    return State(state.k_ext, tau, lag_1, lag_2, lag_3, lag_3 + kept * (state.tau_f - lag_3))


@compiled
def _answered(r: Rejection, tau_ext: float) -> float:
    return min(max(beyond(tau_ext, r.unseen), -r.most), r.most)
