"""All gains of the cascade from models and λ: table 2 with errata E1 and E3 applied."""

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import cascade, pid, trajectory
from backend.control.cascade import Following
from backend.control.decoupler import Bounds, Decoupler, Schedule, bounds_for, decoupler_for, stiffness_slope
from backend.control.disturbance_observer import Rejection
from backend.errors import require_within
from backend.tuning.formulas import motor_gains, outer_gains, position_loop_gain, stiffness_loop_gain
from backend.tuning.models import Lambdas, MotorModel, PointModel, designed_point, motor_model
from plant.interface import T_s
from plant.parameters import PlantParameters

UNSEEN_COUNTS = 0.501
"""Error of the joint that its integrator leaves alone, in counts of its encoder: whatever the reference, one reading is
within, and with it the joint is within a count."""

UNSEEN_S = 0.01
"""Error of the stiffness that its integrator leaves alone [N·m/rad]: a thousandth of it, some counts of the motors."""

UNSEEN_F, MOST_F = 0.3, 10.0
"""Outside force [N] that the rejection leaves to the position loop, and the largest that it answers: the estimate errs
by 0.3 N at most in fast moves; and against a wall, which does not give way, the answer is pressed on top."""

DEVIATIONS = 6.0
"""The rejection's dead zone has to be so many standard deviations of the estimate: at rest it then does nothing."""


class Knowledge(NamedTuple):
    """What the cascade knows of a plant beside its gains."""

    decoupler: Decoupler
    bounds: Bounds
    model: trajectory.Model
    q_count: float


def knowledge(parameters: PlantParameters) -> Knowledge:
    """Return geometry, bounds, the model that a plan moves, and a count of the joint's encoder [rad]."""
    known = parameters.identified_dynamics()
    A, B = parameters.identified_of("A"), parameters.identified_of("B")
    joint, motor_A, motor_B = known.joint, known.motor_A, known.motor_B
    model = trajectory.Model(
        A.K_m, A.T_m, B.K_m, B.T_m, motor_A.K_t, motor_B.K_t, joint.J_j, joint.B_j, motor_A.tau_e, motor_B.tau_e
    )
    return Knowledge(decoupler_for(parameters), bounds_for(parameters), model, parameters.sensors.joint_step)


def following(known: Knowledge, u_plan: float) -> Following:
    """Plan within ``u_plan`` [V], and errors at rest that the outer integrators leave alone; 0 V: as in the paper.

    The paper's law is linear throughout where the joint's encoder has no counts: nothing rests there.
    """
    unseen_S = UNSEEN_S if u_plan > 0.0 or known.q_count > 0.0 else 0.0
    return Following(u_plan, known.model, UNSEEN_COUNTS * known.q_count, unseen_S)


def rejection(known: Knowledge, inner: pid.MotorPairGains, k_ext: float) -> Rejection:
    """Feed-forward of the share ``k_ext`` of an outside force, behind the lags of motor loops ``inner``."""
    lags = [motor_lag(gains, T) for gains, T in ((inner.A, known.model.T_A), (inner.B, known.model.T_B))]
    r_j = known.decoupler.r_j
    return Rejection(k_ext, UNSEEN_F * r_j, MOST_F * r_j, math.exp(-T_s / (0.5 * sum(lags))))


def require_share(k_ext: float) -> None:
    """Raise OutOfRangeError unless ``k_ext`` [1] is offered."""
    require_within("k_ext", k_ext, 0.0, 1.0, "1", "0 leaves pushes to the position loop, 1 answers them whole")


def motor_lag(gains: pid.IPDGains, T_m: float) -> float:
    """λ_motor [s] that a motor loop was given: its four poles at −1/λ sum up to −1/t_f − 1/T_m (table 2)."""
    return 4.0 / (1.0 / gains.t_f + 1.0 / T_m)


def position_gains(parameters: PlantParameters, point: PointModel, lambdas: Lambdas) -> pid.IPGains:
    """I-P gains of the position loop at one point. Raises TuningError."""
    return outer_gains(*position_process(parameters, point), lambdas.lam_q, lambdas.b)


def stiffness_gains(parameters: PlantParameters, point: PointModel, lambdas: Lambdas) -> pid.IPGains:
    """I-P gains of the stiffness loop at one point. Raises TuningError."""
    return outer_gains(*stiffness_process(parameters, point), lambdas.lam_S, lambdas.b)


def position_process(parameters: PlantParameters, point: PointModel) -> tuple[float, float]:
    """K [1] and T [s] from q_c to q through the decoupler."""
    g = parameters.geometry
    return position_loop_gain(point.K_q, g.r_m, g.r_j), point.T_q


def stiffness_process(parameters: PlantParameters, point: PointModel) -> tuple[float, float]:
    """K [1] and T [s] from S_c to S through the decoupler."""
    return stiffness_loop_gain(point.K_S, stiffness_slope(decoupler_for(parameters), point.S_nominal)), point.T_S


def motor_loops(parameters: PlantParameters, lam_motor: float, motor: MotorModel | None = None) -> pid.MotorPairGains:
    """I-PD gains of both motor loops; without a ``motor`` for both, each side as identified. Raises TuningError."""
    A, B = motor or motor_model(parameters, "A"), motor or motor_model(parameters, "B")
    return pid.MotorPairGains(motor_gains(A.K_m, A.T_m, lam_motor), motor_gains(B.K_m, B.T_m, lam_motor))


def cascade_tuning(
    parameters: PlantParameters,
    lambdas: Lambdas,
    points: Sequence[PointModel] = (),
    motor: MotorModel | None = None,
    interpolate: bool = False,
    u_plan: float = 0.0,
    k_ext: float = 0.0,
) -> cascade.CascadeTuning:
    """Gains for every point; without points the 20 N point from geometry, without a motor the parameter set's.

    ``u_plan`` [V]: budget of the plan, 0 for the paper's governor; ``k_ext`` [1]: share of an outside force that is
    rejected by feed-forward. Raises TuningError.
    """
    points = sorted(points or (designed_point(parameters, lambdas.lam_motor),), key=lambda point: point.S_nominal)
    rows = []
    for point in points:
        q, S = position_gains(parameters, point, lambdas), stiffness_gains(parameters, point, lambdas)
        rows.append((point.S_nominal, q.k_p, q.k_i, q.k_r, S.k_p, S.k_i, S.k_r))
    known = knowledge(parameters)
    inner = motor_loops(parameters, lambdas.lam_motor, motor)
    return tuning_with(known, inner, np.array(rows), interpolate, u_plan, k_ext)


def tuning_with(
    known: Knowledge,
    inner: pid.MotorPairGains,
    entries: NDArray[np.float64],
    interpolate: bool,
    u_plan: float,
    k_ext: float,
) -> cascade.CascadeTuning:
    """Put gains of the motor loops and of a bank (n, 7) together with what is known of the plant."""
    bounds, schedule = known.bounds, Schedule(entries, interpolate)
    return cascade.CascadeTuning(
        inner,
        schedule,
        known.decoupler,
        bounds.envelope,
        bounds.omega_max,
        bounds.u_max,
        following(known, u_plan),
        rejection(known, inner, k_ext),
    )
