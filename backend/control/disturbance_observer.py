"""Disturbance observer: external joint torque from encoders and springs.

Includes its feed-forward, the disturbance rejection.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control.fault_detection import Tendons, build_tendons
from backend.control.pid import apply_dead_zone
from plant import Measurement, Mechanism, PlantParameters, T_s, compiled, elastic_torques, tendon_tension

# Push rejection ------------------------------------------------------------------------------------
# Feed-forward of the external force: the equilibrium moves against a push by the deflection of the springs.
#
# δq_e = −k_ext τ_ext/S (equation 14). The motors follow it through four lags of λ_motor. The position loop must not
# react to the error until then, so it receives the position that is expected meanwhile, δq = k_ext (τ_ext − τ_f)/S with
# τ_f after the same lags. Otherwise it would counteract a push that is already compensated, and overshoot when the push
# is balanced. The estimate does not depend on motors and loops, so no pole of a free joint moves (docs/decisions/0048).


class Rejection(NamedTuple):
    """Parameters of the disturbance rejection.

    ``k_ext`` [1]: gain, 0 for no rejection. ``dead_zone`` [N·m]: torque that the position loop handles alone, so that
    the estimate's noise moves nothing; ``tau_max`` [N·m]: largest torque that is compensated. ``lag_decay`` [1]: decay
    of one of the four lags over T_s.
    """

    k_ext: float
    dead_zone: float
    tau_max: float
    lag_decay: float


class DisturbanceFeedforwardState(NamedTuple):
    """Active ``k_ext``, 0 without rejection, and torque [N·m] after 0 to 4 lags."""

    k_ext: float
    tau: float
    lag_1: float
    lag_2: float
    lag_3: float
    tau_f: float


IDLE = DisturbanceFeedforwardState(k_ext=0.0, tau=0.0, lag_1=0.0, lag_2=0.0, lag_3=0.0, tau_f=0.0)
"""No rejection."""


class DisturbanceCompensation(NamedTuple):
    """Increment of the equilibrium ``q_e`` [rad], and expected error ``q`` [rad]."""

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
    """Return the state with this tick's k_ext, IDLE if the torque [N·m] is NaN.

    At its start the current push counts as balanced.
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
    """Advance the state by the torque of a tick [N·m], which has its bias subtracted."""
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


# External torque -----------------------------------------------------------------------------------
# External torque without a sensor: a state of an observer of the joint, from encoders and springs alone.
#
# J_j q'' + B_j q' = r_j (F_A − F_B) + τ_ext (equation 5), with the tensions of the identified springs. An observer of
# q, q' and τ_ext, driven by these tensions and corrected by the joint encoder, has the same three poles everywhere, so
# its estimate is τ_ext filtered by (p/(s + p))³, independent of motors and loops; motor friction has no effect. A
# momentum observer (De Luca and others 2009) would need q', which an encoder does not measure (docs/decisions/0047).


POLE = 300.0
"""Triple pole of the observer [1/s]: 10 ms of mean delay, and one encoder count reads as 0.1 N."""


MEAN_S = 0.3
"""Time constant of the mean of τ_ext [s]: after 2 s of rest a thousandth of the previous value remains."""

_SHARE = T_s / MEAN_S


class Observer(NamedTuple):
    """Joint model over one tick, and gains of the innovation [rad] on its states.

    ``q`` from q' and torque, ``q_dot`` from itself and torque, exact over T_s at constant torque.
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
    """State of the observer: q [rad], q' [rad/s] and τ_ext [N·m], and statistics.

    ``tendon_torque`` [N·m] is that of the last measurement. ``mean`` [N·m] and ``variance`` [N²·m²] of τ_ext are
    exponentially weighted with the time constant MEAN_S.
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
"""State while the positions of joint or motors are unknown."""


@compiled
def step_disturbance_observer(
    observer: Observer, state: DisturbanceObserverState, m: Measurement
) -> DisturbanceObserverState:
    """Advance the observer by a measurement with zeroed motors; NaN is skipped."""
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
    """Return F_ext_hat [N], tangential at r_j, less the bias; NaN if unknown.

    ``bias`` (n, 2) holds S [N·m/rad] and force [N].
    """
    return state.tau_ext / observer.tendons.r_j - interpolate_bias(bias, S)


@compiled
def interpolate_bias(bias: NDArray[np.float64], S: float) -> float:
    """Return the bias [N] at S [N·m/rad] by linear interpolation of points (n, 2).

    The bias is constant beyond the outermost points, and 0 without points.
    """
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
    """Return the torque of both tendons [N·m] at the elongations from the encoders.

    A solid spring counts with the force at which it became solid: beyond it, one encoder count is 12 N. For another
    mechanism the result is its torque at the deflection.
    """
    return _tendon_torque(tendons, tendons.mechanism, m)


@compiled
def _tendon_torque(tendons: Tendons, mechanism: Mechanism | None, m: Measurement) -> float:
    if mechanism is not None:
        tau, _, _, _ = elastic_torques(mechanism, m.q, m.theta_A, m.theta_B)
        return tau
    x_A = tendons.r_m * m.theta_A - tendons.r_j * m.q
    x_B = tendons.r_m * m.theta_B + tendons.r_j * m.q
    F_A = min(tendon_tension(tendons.spring_A, x_A), tendons.spring_A.F_solid)
    F_B = min(tendon_tension(tendons.spring_B, x_B), tendons.spring_B.F_solid)
    return tendons.r_j * (F_A - F_B) if math.isfinite(x_A + x_B) else math.nan


def build_observer(parameters: PlantParameters, pole: float = POLE) -> Observer:
    """Return the observer of a parameter set, all poles at −``pole`` [1/s].

    It uses the identified springs and the joint.
    """
    joint = parameters.make_identified_dynamics().joint
    b = joint.B_j / joint.J_j
    decay = math.exp(-b * T_s)
    q_from_q_dot = -math.expm1(-b * T_s) / b if b > 0.0 else T_s
    q_from_tau = (T_s - q_from_q_dot) / (b * joint.J_j) if b * T_s > 1e-6 else 0.5 * T_s**2 / joint.J_j
    A = np.array([[1.0, q_from_q_dot, q_from_tau], [0.0, decay, q_from_q_dot / joint.J_j], [0.0, 0.0, 1.0]])
    # Ackermann's formula for an observer with correction by the newest measurement: A − L C A has all three poles
    # there.
    C = A[:1]
    observability = np.vstack((C, C @ A, C @ A @ A))
    polynomial = np.linalg.matrix_power(A - math.exp(-pole * T_s) * np.eye(3), 3)
    L = polynomial @ np.linalg.solve(observability, np.array([0.0, 0.0, 1.0]))
    return Observer(
        build_tendons(parameters), q_from_q_dot, q_from_tau, decay, q_from_q_dot / joint.J_j, *map(float, L)
    )
