"""Disturbance observer: the outside torque on the joint from encoders and springs, and its feed-forward."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control.fault_detection import Tendons, build_tendons
from backend.control.pid import apply_dead_zone
from plant import Measurement, PlantParameters, T_s, compiled, tendon_tension

# Rejection -----------------------------------------------------------------------------------------
#
# Feed-forward of the outside force: the equilibrium goes as far against a push as the springs give
# way to it.
#
# δq_e = −k_ext τ_ext/S (equation 14). The motors follow it behind four lags of λ_motor, and what
# the joint is off until then is not the position loop's business: it is told where the joint should
# be by now, δq = k_ext (τ_ext − τ_f)/S with τ_f behind the same lags. Else it would turn against a
# push that is being answered already, and overshoot when the push is balanced. As the estimate does
# not depend on motors and loops, no pole of a free joint moves (docs/decisions/0048).


class Rejection(NamedTuple):
    """``k_ext`` [1]: share of the push that is answered, 0 for none.

    ``dead_zone`` [N·m]: torque that is left to the position loop, so that the estimate's noise moves nothing;
    ``tau_max`` [N·m]: the largest that is answered. ``kept`` [1]: what one of the four lags keeps of itself over T_s.
    """

    k_ext: float
    dead_zone: float
    tau_max: float
    lag_decay: float


class DisturbanceFeedforwardState(NamedTuple):
    """``k_ext`` in use, 0 where nothing is answered; torque [N·m] that is, and behind one to four lags."""

    k_ext: float
    tau: float
    lag_1: float
    lag_2: float
    lag_3: float
    tau_f: float


IDLE = DisturbanceFeedforwardState(k_ext=0.0, tau=0.0, lag_1=0.0, lag_2=0.0, lag_3=0.0, tau_f=0.0)
"""Nothing is answered."""


class DisturbanceCompensation(NamedTuple):
    """What comes on top of the equilibrium, ``q_e`` [rad], and how far the joint is expected to be off, ``q`` [rad]."""

    q_e: float
    q: float


NO_COMPENSATION = DisturbanceCompensation(0.0, 0.0)


@compiled
def compute_compensation(state: DisturbanceFeedforwardState, S: float) -> DisturbanceCompensation:
    """Return the compensation at stiffness S [N·m/rad]."""
    if state.k_ext == 0.0:
        return NO_COMPENSATION
    return DisturbanceCompensation(-state.k_ext * state.tau / S, state.k_ext * (state.tau - state.tau_f) / S)


@compiled
def update_gain(r: Rejection, state: DisturbanceFeedforwardState, tau_ext: float) -> DisturbanceFeedforwardState:
    """Return the state for this tick's k_ext, idle for a torque [N·m] of nan.

    What begins takes the push that is there for balanced already.
    """
    k_ext = r.k_ext if math.isfinite(tau_ext) else 0.0
    if k_ext == state.k_ext:
        return state
    if k_ext == 0.0:
        return IDLE
    if state.k_ext == 0.0:
        tau = _limit_torque(r, tau_ext)
        return DisturbanceFeedforwardState(k_ext=k_ext, tau=tau, lag_1=tau, lag_2=tau, lag_3=tau, tau_f=tau)
    return DisturbanceFeedforwardState(
        k_ext=k_ext, tau=state.tau, lag_1=state.lag_1, lag_2=state.lag_2, lag_3=state.lag_3, tau_f=state.tau_f
    )


@compiled
def step_disturbance_feedforward(
    r: Rejection, state: DisturbanceFeedforwardState, tau_ext: float
) -> DisturbanceFeedforwardState:
    """Take the torque of a tick [N·m], its bias taken off."""
    if state.k_ext == 0.0:
        return state
    tau, decay = _limit_torque(r, tau_ext), r.lag_decay
    lag_1 = tau + decay * (state.lag_1 - tau)
    lag_2 = lag_1 + decay * (state.lag_2 - lag_1)
    lag_3 = lag_2 + decay * (state.lag_3 - lag_2)
    return DisturbanceFeedforwardState(
        k_ext=state.k_ext, tau=tau, lag_1=lag_1, lag_2=lag_2, lag_3=lag_3, tau_f=lag_3 + decay * (state.tau_f - lag_3)
    )


@compiled
def _limit_torque(r: Rejection, tau_ext: float) -> float:
    return min(max(apply_dead_zone(tau_ext, r.dead_zone), -r.tau_max), r.tau_max)


# Touch ---------------------------------------------------------------------------------------------
#
# Touch without a sensor: the outside torque as a state of an observer of the joint, from encoders
# and springs alone.
#
# J_j q'' + B_j q' = r_j (F_A − F_B) + τ_ext (equation 5), with the tensions of the identified
# springs. An observer of q, q' and τ_ext that is driven by them and corrected by the joint's
# encoder has the same three poles everywhere, so that what it says is τ_ext behind (p/(s + p))³,
# whatever motors and loops do; motor friction does not enter. A momentum observer (De Luca and
# others 2009) would need q', which an encoder does not give (docs/decisions/0047).


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


class DisturbanceObserverState(NamedTuple):
    """q [rad], q' [rad/s] and τ_ext [N·m] of the observer, and the tendons' torque [N·m] at the last reading.

    ``mean`` [N·m] and ``variance`` [N²·m²] of τ_ext over the last MEAN_S, older readings counting less and less.
    """

    q: float
    q_dot: float
    tau_ext: float
    tendon_torque: float
    mean: float
    variance: float


UNKNOWN = DisturbanceObserverState(
    q=math.nan, q_dot=math.nan, tau_ext=math.nan, tendon_torque=math.nan, mean=math.nan, variance=math.nan
)
"""Where joint or motors stand is not known."""


@compiled
def step_disturbance_observer(
    observer: Observer, state: DisturbanceObserverState, m: Measurement
) -> DisturbanceObserverState:
    """Take the reading of a tick, motors from their zeros; one that is no number is passed over."""
    tendon_torque = _compute_tendon_torque(observer.tendons, m)
    if not math.isfinite(tendon_torque):
        return state
    if not math.isfinite(state.q):
        return DisturbanceObserverState(
            q=m.q, q_dot=0.0, tau_ext=0.0, tendon_torque=tendon_torque, mean=0.0, variance=0.0
        )
    tau = 0.5 * (state.tendon_torque + tendon_torque) + state.tau_ext
    q = state.q + observer.q_of_q_dot * state.q_dot + observer.q_of_tau * tau
    q_dot = observer.q_dot_of_q_dot * state.q_dot + observer.q_dot_of_tau * tau
    innovation = m.q - q
    tau_ext = state.tau_ext + observer.L_tau * innovation
    mean = state.mean + _SHARE * (tau_ext - state.mean)
    variance = state.variance + _SHARE * ((tau_ext - mean) ** 2 - state.variance)
    return DisturbanceObserverState(
        q=q + observer.L_q * innovation,
        q_dot=q_dot + observer.L_q_dot * innovation,
        tau_ext=tau_ext,
        tendon_torque=tendon_torque,
        mean=mean,
        variance=variance,
    )


@compiled
def estimate_force(observer: Observer, state: DisturbanceObserverState, bias: NDArray[np.float64], S: float) -> float:
    """F_ext_hat [N], tangential at r_j, with the bias (n, 2) of S [N·m/rad] and force [N] taken off; nan: not known."""
    return state.tau_ext / observer.tendons.r_j - interpolate_bias(bias, S)


@compiled
def interpolate_bias(bias: NDArray[np.float64], S: float) -> float:
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
def _compute_tendon_torque(tendons: Tendons, m: Measurement) -> float:
    """Torque of both tendons [N·m] at the elongations that the encoders give.

    A spring that is solid counts with the force at which it became so: beyond it, one encoder count is 12 N.
    """
    x_A = tendons.r_m * m.theta_A - tendons.r_j * m.q
    x_B = tendons.r_m * m.theta_B + tendons.r_j * m.q
    F_A = min(tendon_tension(tendons.spring_A, x_A), tendons.spring_A.F_solid)
    F_B = min(tendon_tension(tendons.spring_B, x_B), tendons.spring_B.F_solid)
    return tendons.r_j * (F_A - F_B) if math.isfinite(x_A + x_B) else math.nan


def build_observer(parameters: PlantParameters, pole: float = POLE) -> Observer:
    """Return the observer of a parameter set's identified springs and joint, its poles all at −``pole`` [1/s]."""
    joint = parameters.make_identified_dynamics().joint
    b = joint.B_j / joint.J_j
    decay = math.exp(-b * T_s)
    q_from_q_dot = -math.expm1(-b * T_s) / b if b > 0.0 else T_s
    q_from_tau = (T_s - q_from_q_dot) / (b * joint.J_j) if b * T_s > 1e-6 else 0.5 * T_s**2 / joint.J_j
    A = np.array([[1.0, q_from_q_dot, q_from_tau], [0.0, decay, q_from_q_dot / joint.J_j], [0.0, 0.0, 1.0]])
    # Ackermann's formula for an observer that corrects by the newest reading: A − L C A has all three poles there.
    C = A[:1]
    observability = np.vstack((C, C @ A, C @ A @ A))
    polynomial = np.linalg.matrix_power(A - math.exp(-pole * T_s) * np.eye(3), 3)
    L = polynomial @ np.linalg.solve(observability, np.array([0.0, 0.0, 1.0]))
    return Observer(
        build_tendons(parameters), q_from_q_dot, q_from_tau, decay, q_from_q_dot / joint.J_j, *map(float, L)
    )
