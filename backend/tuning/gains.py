"""All gains of the cascade from models and λ: table 2 with errata E1 and E3 applied."""

from collections.abc import Sequence

import numpy as np

from backend.controllers import cascade, i_p, motors
from backend.controllers.decoupler import decoupler_for, stiffness_slope
from backend.controllers.limits import bounds_for
from backend.controllers.scheduling import Schedule
from backend.tuning.formulas import motor_gains, outer_gains, position_loop_gain, stiffness_loop_gain
from backend.tuning.models import Lambdas, MotorModel, PointModel, designed_point, motor_model
from plant.parameters import PlantParameters


def position_gains(parameters: PlantParameters, point: PointModel, lambdas: Lambdas) -> i_p.Gains:
    """I-P gains of the position loop at one point. Raises TuningError."""
    return outer_gains(*position_process(parameters, point), lambdas.lam_q, lambdas.b)


def stiffness_gains(parameters: PlantParameters, point: PointModel, lambdas: Lambdas) -> i_p.Gains:
    """I-P gains of the stiffness loop at one point. Raises TuningError."""
    return outer_gains(*stiffness_process(parameters, point), lambdas.lam_S, lambdas.b)


def position_process(parameters: PlantParameters, point: PointModel) -> tuple[float, float]:
    """K [1] and T [s] from q_c to q through the decoupler."""
    g = parameters.geometry
    return position_loop_gain(point.K_q, g.r_m, g.r_j), point.T_q


def stiffness_process(parameters: PlantParameters, point: PointModel) -> tuple[float, float]:
    """K [1] and T [s] from S_c to S through the decoupler."""
    return stiffness_loop_gain(point.K_S, stiffness_slope(decoupler_for(parameters), point.S_nominal)), point.T_S


def motor_loops(parameters: PlantParameters, lam_motor: float, motor: MotorModel | None = None) -> motors.Gains:
    """I-PD gains of both motor loops; without a ``motor`` for both, each side as identified. Raises TuningError."""
    A, B = motor or motor_model(parameters, "A"), motor or motor_model(parameters, "B")
    return motors.Gains(motor_gains(A.K_m, A.T_m, lam_motor), motor_gains(B.K_m, B.T_m, lam_motor))


def cascade_tuning(
    parameters: PlantParameters,
    lambdas: Lambdas,
    points: Sequence[PointModel] = (),
    motor: MotorModel | None = None,
    interpolate: bool = False,
) -> cascade.Tuning:
    """Gains for every point; without points the 20 N point from geometry, without a motor the parameter set's.

    Raises TuningError.
    """
    points = sorted(points or (designed_point(parameters, lambdas.lam_motor),), key=lambda point: point.S_nominal)
    rows = []
    for point in points:
        q, S = position_gains(parameters, point, lambdas), stiffness_gains(parameters, point, lambdas)
        rows.append((point.S_nominal, q.k_p, q.k_i, q.k_r, S.k_p, S.k_i, S.k_r))
    bounds = bounds_for(parameters)
    return cascade.Tuning(
        motor_loops(parameters, lambdas.lam_motor, motor),
        Schedule(np.array(rows), interpolate),
        decoupler_for(parameters),
        bounds.envelope,
        bounds.omega_max,
        bounds.u_max,
    )
