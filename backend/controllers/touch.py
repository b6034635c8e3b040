"""Touch without a sensor: the outside torque as a state of an observer of the joint, from encoders and springs alone.

J_j q'' + B_j q' = r_j (F_A − F_B) + τ_ext (equation 5), with the tensions of the identified springs. An observer of q,
q' and τ_ext that is driven by them and corrected by the joint's encoder has the same three poles everywhere, so that
what it says is τ_ext behind (p/(s + p))³, whatever motors and loops do; motor friction does not enter. A momentum
observer (De Luca and others 2009) would need q', which an encoder does not give (docs/decisions/0047).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.controllers.plausibility import Tendons, tendons_for
from plant.compiled import compiled
from plant.dynamics import tension
from plant.interface import Measurement, T_s
from plant.parameters import PlantParameters

POLE = 300.0
"""Of the observer [1/s], three times: 10 ms of mean delay, a count of the encoder reads as 0.1 N."""


MEAN_S = 0.3
"""Time constant [s] of the mean of τ_ext: 2 s of rest leave a thousandth of what was before."""

_SHARE = T_s / MEAN_S


class Observer(NamedTuple):
    """The joint over one tick and how far a surprise of 1 rad moves each of its states.

    ``q`` from q' and torque, ``q_dot`` from itself and torque, exactly over T_s under a held torque.
    """

    tendons: Tendons
    q_of_q_dot: float
    q_of_tau: float
    q_dot_of_q_dot: float
    q_dot_of_tau: float
    L_q: float
    L_q_dot: float
    L_tau: float


class State(NamedTuple):
    """q [rad], q' [rad/s] and τ_ext [N·m] of the observer, and the tendons' torque [N·m] at the last reading.

    ``mean`` [N·m] and ``variance`` [N²·m²] of τ_ext over the last MEAN_S, older readings counting less and less.
    """

    q: float
    q_dot: float
    tau_ext: float
    pull: float
    mean: float
    variance: float


UNKNOWN = State(math.nan, math.nan, math.nan, math.nan, math.nan, math.nan)
"""Where joint or motors stand is not known."""


@compiled
def step(observer: Observer, state: State, m: Measurement) -> State:
    """Take the reading of a tick, motors from their zeros; one that is no number is passed over."""
    pull = _pull(observer.tendons, m)
    if not math.isfinite(pull):
        return state
    if not math.isfinite(state.q):
        return State(m.q, 0.0, 0.0, pull, 0.0, 0.0)
    tau = 0.5 * (state.pull + pull) + state.tau_ext
    q = state.q + observer.q_of_q_dot * state.q_dot + observer.q_of_tau * tau
    q_dot = observer.q_dot_of_q_dot * state.q_dot + observer.q_dot_of_tau * tau
    surprise = m.q - q
    tau_ext = state.tau_ext + observer.L_tau * surprise
    mean = state.mean + _SHARE * (tau_ext - state.mean)
    variance = state.variance + _SHARE * ((tau_ext - mean) ** 2 - state.variance)
    return State(q + observer.L_q * surprise, q_dot + observer.L_q_dot * surprise, tau_ext, pull, mean, variance)


@compiled
def force(observer: Observer, state: State, bias: NDArray[np.float64], S: float) -> float:
    """F_ext_hat [N], tangential at r_j, with the bias (n, 2) of S [N·m/rad] and force [N] taken off; nan: not known."""
    return state.tau_ext / observer.tendons.r_j - bias_at(bias, S)


@compiled
def bias_at(bias: NDArray[np.float64], S: float) -> float:
    """Bias [N] at S [N·m/rad] by points (n, 2): straight lines between them, the outermost beyond, 0 for none."""
    last = bias.shape[0] - 1
    if last < 0:
        return 0.0
    if bias[0, 0] >= S:
        return float(bias[0, 1])
    for row in range(last):
        if bias[row + 1, 0] > S:
            share = (S - bias[row, 0]) / (bias[row + 1, 0] - bias[row, 0])
            return float(bias[row, 1] + share * (bias[row + 1, 1] - bias[row, 1]))
    return float(bias[last, 1])


@compiled
def _pull(tendons: Tendons, m: Measurement) -> float:
    """Torque of both tendons [N·m] at the elongations that the encoders give.

    A spring that is solid counts with the force at which it became so: beyond it, one encoder count is 12 N.
    """
    x_A = tendons.r_m * m.theta_A - tendons.r_j * m.q
    x_B = tendons.r_m * m.theta_B + tendons.r_j * m.q
    F_A = min(tension(tendons.spring_A, x_A), tendons.spring_A.F_solid)
    F_B = min(tension(tendons.spring_B, x_B), tendons.spring_B.F_solid)
    return tendons.r_j * (F_A - F_B) if math.isfinite(x_A + x_B) else math.nan


def observer_for(parameters: PlantParameters, pole: float = POLE) -> Observer:
    """Return the observer of a parameter set's identified springs and joint, its poles all at −``pole`` [1/s]."""
    joint = parameters.identified_dynamics().joint
    b = joint.B_j / joint.J_j
    kept = math.exp(-b * T_s)
    moved = -math.expm1(-b * T_s) / b if b > 0.0 else T_s
    pushed = (T_s - moved) / (b * joint.J_j) if b * T_s > 1e-6 else 0.5 * T_s**2 / joint.J_j
    A = np.array([[1.0, moved, pushed], [0.0, kept, moved / joint.J_j], [0.0, 0.0, 1.0]])
    # Ackermann's formula for an observer that corrects by the newest reading: A − L C A has all three poles there.
    C = A[:1]
    seen = np.vstack((C, C @ A, C @ A @ A))
    wanted = np.linalg.matrix_power(A - math.exp(-pole * T_s) * np.eye(3), 3)
    L = wanted @ np.linalg.solve(seen, np.array([0.0, 0.0, 1.0]))
    return Observer(tendons_for(parameters), moved, pushed, kept, moved / joint.J_j, *map(float, L))
