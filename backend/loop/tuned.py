"""From models and λ to the command that tunes the loop."""

from collections.abc import Sequence

from backend.controllers import i_pd
from backend.loop.commands import EntryGains, MotorGains, SetTuning
from backend.tuning.formulas import motor_gains, outer_gains, position_loop_gain, stiffness_loop_gain
from backend.tuning.models import Lambdas, MotorModel, PointModel, designed_point, motor_model
from plant.parameters import PlantParameters


def tuning_for(
    parameters: PlantParameters,
    lambdas: Lambdas,
    points: Sequence[PointModel] = (),
    motor: MotorModel | None = None,
    interpolate: bool = False,
) -> SetTuning:
    """Gains for every point; without points the 20 N point from geometry, without a motor the parameter set's.

    The outer gains are scaled by the factor-two bookkeeping of erratum E3. Raises TuningError.
    """
    motor = motor or motor_model(parameters)
    points = points or (designed_point(parameters, lambdas.lam_motor),)
    inner = _motor_gains(motor_gains(motor.K_m, motor.T_m, lambdas.lam_motor))
    return SetTuning(
        lam_q=lambdas.lam_q,
        lam_S=lambdas.lam_S,
        motor_A=inner,
        motor_B=inner,
        entries=tuple(entry_gains(parameters, point, lambdas) for point in points),
        interpolate=interpolate,
    )


def entry_gains(parameters: PlantParameters, point: PointModel, lambdas: Lambdas) -> EntryGains:
    """Gains of both outer loops at one point (table 2, errata E1 and E3). Raises TuningError."""
    g = parameters.geometry
    K_q = position_loop_gain(point.K_q, g.r_m, g.r_j)
    K_S = stiffness_loop_gain(point.K_S, g.r_m, g.r_j, parameters.spring.k[2])
    q = outer_gains(K_q, point.T_q, lambdas.lam_q, lambdas.b)
    S = outer_gains(K_S, point.T_S, lambdas.lam_S, lambdas.b)
    return EntryGains(point.S_nominal, q.k_p, q.k_i, q.k_r, S.k_p, S.k_i, S.k_r)


def _motor_gains(gains: i_pd.Gains) -> MotorGains:
    return MotorGains(gains.k_p, gains.k_i, gains.k_d, gains.t_f)
