"""External force that the observer estimates in a simulation, and its bias."""

import numpy as np

from backend.control import disturbance_observer
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import Array, Trajectory, simulate_cascade
from plant.compilation import compiled_run
from plant.interface import Measurement
from plant.parameters import PlantParameters

NO_BIAS = np.zeros((0, 2))
STIFFNESSES = (8.0, 10.0, 12.0, 14.0, 15.0)
"""Stiffnesses at which the bias is measured [N·m/rad], from the lowest reference to the highest."""
WARM = 500
"""Ticks after which the initial state of the observer has no effect."""


@compiled_run
def _each(
    observer: disturbance_observer.Observer,
    q: Array,
    theta_A: Array,
    theta_B: Array,
    S: Array,
    bias: Array,
    out: Array,
) -> None:
    state = disturbance_observer.UNKNOWN
    for k in range(q.size):
        state = disturbance_observer.step_disturbance_observer(
            observer, state, Measurement(q[k], theta_A[k], theta_B[k], 0.0, 0.0, 0.0, 0.0, 0.0)
        )
        out[k] = disturbance_observer.estimate_force(observer, state, bias, S[k])


def estimate_external_force(parameters: PlantParameters, y: Trajectory, bias: Array = NO_BIAS) -> Array:
    """Return the estimated external force [N] of each tick."""
    out = np.empty(y.q.size)
    q, theta_A, theta_B, S = (np.ascontiguousarray(column) for column in (y.q, y.theta_A, y.theta_B, y.S))
    _each(disturbance_observer.build_observer(parameters), q, theta_A, theta_B, S, bias, out)
    return out


def hold_joint(parameters: PlantParameters, S: float, F_push: Array, q: Array | float = 0.0) -> Trajectory:
    ticks = F_push.size
    tuning = make_cascade_tuning(parameters, TuningParameters(0.355, 0.345), u_plan=8.5)
    return simulate_cascade(parameters, tuning, np.broadcast_to(q, ticks).copy(), np.full(ticks, S), F_push)


def measure_bias(parameters: PlantParameters) -> Array:
    """Return the bias (n, 2) over S, from one second at rest at each of STIFFNESSES."""
    at_rest = [
        estimate_external_force(parameters, hold_joint(parameters, S, np.zeros(1500)))[WARM:] for S in STIFFNESSES
    ]
    return np.array([(S, force.mean()) for S, force in zip(STIFFNESSES, at_rest, strict=True)])
