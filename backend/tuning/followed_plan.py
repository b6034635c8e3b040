"""What small motions of the references become under a plan: its model, its voltages, and the loops on what is left.

The model answers by its landing, its averaging, the motors' electrical lag and the swing of its joint: 1 but for some
hundredths of a second, and neither λ nor gains are in it. They act on what motors and joint have beside the model. All
of it holds while the voltage that the references ask for is within the budget (docs/decisions/0046).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import cascade, trajectory
from backend.control.decoupler import tension_under
from backend.control.trajectory import LANDING_S
from backend.tuning.sampled_loop import SampledLoop, sampled_loop
from plant.interface import T_s
from plant.parameters import PlantParameters

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_STEP = 1e-6


class AxisResponse(NamedTuple):
    """Of an axis to its goal, each (n,): angle and speed [1/s] behind averaging and electrical lag.

    ``driven`` and ``lagged`` [1/s] are K times the mean voltage before and behind the lag.
    """

    theta: Complex
    omega: Complex
    driven: Complex
    lagged: Complex


def axis_response(model: trajectory.Model, f: Array) -> AxisResponse:
    """Response to a moving goal at ``f`` (n,) [Hz], in the last stretch before it (``axis.toward``).

    ω⁺ = rate + (goal − θ − T_s (ω − rate))/LANDING_S, and θ⁺ as the motor turns; its voltage, averaged over some ticks
    and behind the electrical lag, moves the model's motors (``axis.turned_lagged``).
    """
    z = np.exp(2j * np.pi * np.asarray(f) * T_s)
    T = max(model.T_A, model.T_B)
    kept = np.exp(-T_s / T)
    lost = T * (1.0 - kept)
    turning = (T_s - lost) * (z - kept) / (1.0 - kept) + lost  # θ (z − 1) = ω turning
    ahead = T_s / LANDING_S
    asked = (1.0 - 1.0 / z) / T_s * (1.0 + ahead) + 1.0 / LANDING_S
    reached = (z - 1.0) * (z + ahead) / turning + 1.0 / LANDING_S
    averaged = sum(z**-ticks for ticks in range(trajectory.SMOOTHED)) / trajectory.SMOOTHED
    driven = asked / reached * (z - 1.0) / turning * (z - kept) / (1.0 - kept) * averaged
    tau_e = max(model.tau_e_A, model.tau_e_B)
    behind = np.exp(-T_s / tau_e)
    lagged = driven * (1.0 - behind) / (z - behind)
    left = (lagged - driven) * tau_e / (tau_e - T)
    omega = (driven * (1.0 - kept) + left * (behind - kept)) / (z - kept)
    over = omega - driven - left
    theta = (driven * T_s + left * tau_e * (1.0 - behind) + over * lost) / (z - 1.0)
    return AxisResponse(theta, omega, driven, lagged)


def joint_response(model: trajectory.Model, S: float, f: Array) -> Complex:
    """Response of the model's joint to its equilibrium: J_j q'' + B_j q' + S q = S q_e, at S [N·m/rad]."""
    s = 2j * np.pi * np.asarray(f)
    return np.asarray(S / (model.J_j * s**2 + model.B_j * s + S))


def planned_response(
    parameters: PlantParameters, tuning: cascade.CascadeTuning, S: float, f: Array, *, position_loop: bool = True
) -> Complex:
    """Response from (q_ref, S_ref) to (q, S) at ``f`` (n,) [Hz] about S [N·m/rad], shape (n, 2, 2)."""
    model = tuning.following.model
    loop = sampled_loop(parameters, tuning, S, position_loop=position_loop)
    axis, joint = axis_response(model, f), joint_response(model, S, f)
    modelled = np.empty((axis.theta.size, 3, 2), dtype=np.complex128)
    modelled[:, 0, :] = (axis.theta * joint)[:, None] * np.array([1.0, 0.0])
    modelled[:, 1:, :] = axis.theta[:, None, None] * loop.split
    forward = _forward(tuning, loop, S, f, axis, joint)

    plant, law = loop.plant.response(f)[:, :, :2], loop.law.response(f)
    # The loops see y − y_m alone, so y − y_m = P (u_m + L (y − y_m)) − y_m.
    beside = np.linalg.solve(np.eye(3) - plant @ law[:, :, 2:5], plant @ forward - modelled)
    seen = np.array([[1.0, 0.0, 0.0], [0.0, loop.slope, loop.slope]])
    return np.asarray(seen @ (modelled + beside))


def _forward(
    tuning: cascade.CascadeTuning, loop: SampledLoop, S: float, f: Array, axis: AxisResponse, joint: Complex
) -> Complex:
    """Voltages of the model per (q_ref, S_ref), shape (n, 2, 2), as ``plan.voltages`` computes them."""
    model, d = tuning.following.model, tuning.decoupler
    T, tau_e = max(model.T_A, model.T_B), max(model.tau_e_A, model.tau_e_B)
    turning = (axis.lagged - axis.omega) / T
    jerk = ((axis.driven - axis.lagged) / tau_e - turning) / T
    stiffer = (tension_under(d, S + _STEP) - tension_under(d, S - _STEP)) / (2.0 * _STEP)
    pull = 0.5 * S / d.r_j * axis.theta * (1.0 - joint)
    tendon = 0.5 * S / d.r_j**2
    swing = 2j * np.pi * np.asarray(f) * axis.theta * joint
    forward = np.empty((axis.theta.size, 2, 2), dtype=np.complex128)
    for motor, (K, T_own, tau_own, K_t, side) in enumerate(
        (
            (model.K_A, model.T_A, model.tau_e_A, model.K_t_A, 1.0),
            (model.K_B, model.T_B, model.tau_e_B, model.K_t_B, -1.0),
        )
    ):
        driven = (axis.omega + (T_own + tau_own) * turning + T_own * tau_own * jerk) / K
        driven += d.r_m / K_t * tau_own * tendon * d.r_m * axis.omega
        forward[:, motor, :] = driven[:, None] * loop.split[motor]
        forward[:, motor, 0] += d.r_m / K_t * side * (pull - tau_own * tendon * d.r_j * swing)
        forward[:, motor, 1] += d.r_m / K_t * stiffer * axis.theta
    return forward
