"""Gains of the two baselines from the plant's constants and the cascade's λ.

All three laws are asked for the same speed: the sums of lags from references to measurements are those of the
cascade's outer loops, 2 λ_q and 2 λ_S. What differs is then the law, not how hard it is driven.
"""

from backend.control import baselines
from backend.control.decoupler import bounds_for, decoupler_for, stiffness_slope
from backend.tuning.formulas import TuningError, motor_gains
from backend.tuning.models import S_NOMINAL_20_N, Lambdas, motor_model
from plant.dynamics import smoothed
from plant.parameters import PlantParameters

ERROR_POLE, OBSERVER_POLE = 60.0, 20.0
"""Poles of the error dynamics and of the observer's correction [rad/s]: of 20, 30, 40, 60, 80 by 20, 30, 60 the pair
that, within 10 V on `lab`, deviates least under steps, pushes, and springs and motors that are a fifth off."""

LARGEST_PER_LAG = 8.0
"""The single loop takes a λ below so many motor lags T_m."""


def single_loop_tuning(parameters: PlantParameters, lambdas: Lambdas) -> baselines.SingleLoopTuning:
    """Table 2, first column, for the mean motor seen at q and, at 20 N, at S: 1/(λ s + 1)^4 with half the cascade's λ.

    Raises TuningError where λ_q or λ_S is not below 8 T_m: half of it is the λ of a motor loop.
    """
    d, bounds = decoupler_for(parameters), bounds_for(parameters)
    A, B = motor_model(parameters, "A"), motor_model(parameters, "B")
    K_m, T_m = 0.5 * (A.K_m + B.K_m), 0.5 * (A.T_m + B.T_m)
    for symbol, lam in (("λ_q", lambdas.lam_q), ("λ_S", lambdas.lam_S)):
        if not lam < LARGEST_PER_LAG * T_m:
            bound = f"{LARGEST_PER_LAG:g} T_m = {LARGEST_PER_LAG * T_m:.4g} s"
            raise TuningError(f"single-loop needs {symbol} below {bound}; it is {lam:g} s: choose a smaller {symbol}")
    q_per_theta, S_per_theta = d.r_m / d.r_j, 2.0 * stiffness_slope(d, S_NOMINAL_20_N)
    gains = baselines.SingleLoopGains(
        motor_gains(K_m * q_per_theta, T_m, lambdas.lam_q / 2.0),
        motor_gains(K_m * S_per_theta, T_m, lambdas.lam_S / 2.0),
    )
    return baselines.SingleLoopTuning(gains, d, bounds.omega_max, bounds.u_max)


def feedback_linearization_tuning(
    parameters: PlantParameters, lambdas: Lambdas
) -> baselines.FeedbackLinearizationTuning:
    """Choose reference filters 1/(λ_q/2 s + 1)^4 and 1/(λ_S s + 1)²; the model is the simulator's, friction and all.

    Friction that sticks is smoothed: how far its bristles are bent no sensor tells, and the law would have to know.
    """
    gains = baselines.FeedbackLinearizationGains(
        lambdas.lam_q / 2.0, lambdas.lam_S, ERROR_POLE, ERROR_POLE, OBSERVER_POLE
    )
    bounds = bounds_for(parameters)
    return baselines.FeedbackLinearizationTuning(
        gains, smoothed(parameters.dynamics()), decoupler_for(parameters), bounds.omega_max, bounds.u_max
    )
