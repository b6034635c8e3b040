"""Gains from models and λ (table 2 with errata E1 and E3), and of the baselines."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import (
    Bounds,
    Decoupler,
    ReferenceTracking,
    Rejection,
    Schedule,
    baselines,
    build_decoupler,
    cascade,
    compute_bounds,
    pid,
    stiffness_slope,
    trajectory,
)
from backend.errors import check_range
from backend.tuning import messages
from plant import (
    ErrorCode,
    PlantParameters,
    Side,
    SinewError,
    T_s,
    smooth_friction,
)

# Formulas ------------------------------------------------------------------------------------------
# Gains from a model and λ: table 2, with erratum E1 corrected.
#
# The closed loop of each formula is exact for its model: 1/(λ s + 1)^4 for the motor, 1/(λ s + 1)² for the outer loops.


class TuningError(SinewError, ValueError):
    """A tuning parameter or model is out of bounds.

    The message names quantity, value, bound and unit.
    """

    category = ErrorCode.BAD_VALUE


def _positive(symbol: str, value: float, unit: str) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise TuningError(messages.not_positive(symbol=symbol, value=value, unit=unit))


def motor_gains(K_m: float, T_m: float, lam: float) -> pid.IPDGains:
    """Return I-PD gains for K_m/(s (T_m s + 1)), 0 < λ < 4 T_m.

    Table 2, first column. Raises TuningError.
    """
    _positive("K_m", K_m, "rad/(V·s)")
    _positive("T_m", T_m, "s")
    _positive("λ_motor", lam, "s")
    D = 4.0 * T_m - lam
    if D <= 0.0:
        raise TuningError(messages.motor_loop_too_slow(lam_motor=lam, maximum_s=4.0 * T_m))
    return pid.IPDGains(
        k_p=4.0 * T_m**2 / (K_m * lam**2 * D),
        k_i=T_m**2 / (K_m * lam**3 * D),
        k_d=(6.0 * T_m**2 - lam * D) / (K_m * lam * D),
        t_f=T_m * lam / D,
    )


def outer_gains(K: float, T: float, lam: float, b: float = 0.0) -> pid.IPGains:
    """Return I-P gains for K/(T s + 1).

    ``b`` in 0..1 weighs the reference in the proportional part. Up to λ = 2T both poles are at −1/λ. Beyond this λ, the
    formula would need a negative k_p: the loop becomes purely integral with k_i = 1/(2 K λ), continuous at λ = 2T, with
    the same sum of lags 2λ. Raises TuningError.
    """
    _positive("K", K, "1")
    _positive("T", T, "s")
    _positive("λ", lam, "s")
    if not 0.0 <= b <= 1.0:
        raise TuningError(messages.weight_out_of_range(b=b))
    if lam > 2.0 * T:
        return pid.IPGains(k_p=0.0, k_i=1.0 / (2.0 * K * lam), k_r=0.0)
    k_p = (2.0 * T - lam) / (K * lam)
    return pid.IPGains(k_p=k_p, k_i=T / (K * lam**2), k_r=b * k_p)


def printed_outer_gains(K: float, T: float, lam: float) -> pid.IPGains:
    """Return I-P gains as printed in table 2, k_p = 2/(K λ): wrong (erratum E1).

    For comparison only. Raises TuningError.
    """
    outer_gains(K, T, lam)  # raises TuningError for invalid values
    return pid.IPGains(k_p=2.0 / (K * lam), k_i=T / (K * lam**2), k_r=0.0)


def position_loop_gain(K_q: float, r_m: float, r_j: float) -> float:
    """Return the static gain from q_c to q through the decoupler: 2 K_q r_j/r_m.

    The gain is about 1 (erratum E3).
    """
    return 2.0 * K_q * r_j / r_m


def stiffness_loop_gain(K_S: float, slope: float) -> float:
    """Return the static gain from S_c to S through the decoupler.

    The gain, 2 K_S/(4 k2 r_j² r_m), is about 1 (erratum E3). ``slope`` [N·m/rad per rad] is the decoupler's dS/dθ of
    one motor, 2 r_j² k2 r_m for quadratic springs.
    """
    return K_S / slope


# Models --------------------------------------------------------------------------------------------
# Inputs of the tuning: first-order models of the outer loops at a nominal point, the motor's model, and λ.


LAM_MOTOR = 0.0854
LAM_Q = 0.5
LAM_S = 0.42
"""Defaults of λ [s] (method section 5)."""

LAM_MAX = 3.0
"""Upper end of the permitted range of lam_q and lam_S [s]."""

S_NOMINAL_20_N = 10.55
"""Stiffness at 20 N tendon tension [N·m/rad], the nominal point of the paper's experiments."""


@dataclass(frozen=True)
class PointModel:
    """Models with one motor excited: theta_A_ref to q and to S, as K/(T s + 1).

    For an actuator without tendons they are those from q_c to q, and from the preset of the motors to S.
    At one operating point: ``S_nominal`` [N·m/rad], ``K_q`` [1], ``T_q`` [s], ``K_S`` [N·m/rad per rad], ``T_S`` [s].
    """

    S_nominal: float
    K_q: float
    T_q: float
    K_S: float
    T_S: float


@dataclass(frozen=True)
class MotorModel:
    """Motor model K_m/(s (T_m s + 1)): ``K_m`` [rad/(V·s)], ``T_m`` [s].

    ``tau_e`` [s] is the electrical lag, which the model neglects.
    """

    K_m: float
    T_m: float
    tau_e: float


@dataclass(frozen=True)
class TuningParameters:
    """Tuning parameters [s], and the weight ``b`` of the reference.

    ``b`` applies to the proportional part of the outer loops.
    """

    lam_q: float = LAM_Q
    lam_S: float = LAM_S
    lam_motor: float = LAM_MOTOR
    b: float = 0.0


def designed_point(parameters: PlantParameters, lam_motor: float = LAM_MOTOR) -> PointModel:
    """Return the model at 20 N from geometry alone, before any identification.

    It has the gains of section 4 and four lags of λ_motor. For another mechanism the point is in the middle of its
    range of stiffness.
    """
    g = parameters.geometry
    if parameters.mechanism is not None:
        S = 0.5 * (parameters.mechanism.S_min + parameters.mechanism.S_max)
        return PointModel(
            S_nominal=S,
            K_q=1.0,
            T_q=4.0 * lam_motor,
            K_S=stiffness_slope(build_decoupler(parameters), S),
            T_S=4.0 * lam_motor,
        )
    return PointModel(
        S_nominal=S_NOMINAL_20_N,
        K_q=g.r_m / (2.0 * g.r_j),
        T_q=4.0 * lam_motor,
        K_S=stiffness_slope(build_decoupler(parameters), S_NOMINAL_20_N),
        T_S=4.0 * lam_motor,
    )


def motor_model(parameters: PlantParameters, side: Side) -> MotorModel:
    """Return the identified model of one side's motor (equation 17).

    Its electrical lag L/R is that of the data sheet.
    """
    identified = parameters.select_identified(side)
    return MotorModel(identified.K_m, identified.T_m, parameters.select_motor(side).tau_e)


def true_motor_model(parameters: PlantParameters, side: Side) -> MotorModel:
    """Return the true model of one side's motor, with its asymmetry factor."""
    own = parameters.select_motor(side)
    factor: float = getattr(parameters.asymmetry, f"motor_{side}")
    return MotorModel(factor * own.K_m, own.T_m, own.tau_e)


# Baselines -----------------------------------------------------------------------------------------
# Gains of the two baselines from the plant's constants and the cascade's λ.
#
# All three laws have the same speed: the sums of lags from references to measurements are those of the cascade's outer
# loops, 2 λ_q and 2 λ_S. They thus differ in the law, not in their speed.


ERROR_POLE, OBSERVER_POLE = 60.0, 20.0
"""Poles of the error dynamics and of the observer's correction [rad/s]: of all pairs from 20, 30, 40, 60, 80 and 20,
30, 60, the pair with the least deviation, within 10 V on `lab`, under steps, pushes, and springs and motors that are
off by 20 %."""

LARGEST_PER_LAG = 8.0
"""Limit of λ for the single loop, in motor lags T_m."""


def make_single_loop_tuning(parameters: PlantParameters, lambdas: TuningParameters) -> baselines.SingleLoopTuning:
    """Return table 2, first column, for the mean motor seen at q and, at 20 N, at S.

    Each loop is 1/(λ s + 1)^4 with half the cascade's λ. Raises TuningError unless λ_q and λ_S are below 8 T_m: half of
    it is the λ of a motor loop.
    """
    d, bounds = build_decoupler(parameters), compute_bounds(parameters)
    A, B = motor_model(parameters, "A"), motor_model(parameters, "B")
    K_m, T_m = 0.5 * (A.K_m + B.K_m), 0.5 * (A.T_m + B.T_m)
    for symbol, lam in (("λ_q", lambdas.lam_q), ("λ_S", lambdas.lam_S)):
        if not lam < LARGEST_PER_LAG * T_m:
            raise TuningError(
                messages.single_loop_too_slow(
                    symbol=symbol, lam=lam, motor_lags=LARGEST_PER_LAG, maximum_s=LARGEST_PER_LAG * T_m
                )
            )
    q_per_theta, S_per_theta = d.r_m / d.r_j, 2.0 * stiffness_slope(d, S_NOMINAL_20_N)
    gains = baselines.SingleLoopGains(
        motor_gains(K_m * q_per_theta, T_m, lambdas.lam_q / 2.0),
        motor_gains(K_m * S_per_theta, T_m, lambdas.lam_S / 2.0),
    )
    return baselines.SingleLoopTuning(gains, d, bounds.omega_max, bounds.u_max)


def make_feedback_linearization_tuning(
    parameters: PlantParameters, lambdas: TuningParameters
) -> baselines.FeedbackLinearizationTuning:
    """Return reference filters 1/(λ_q/2 s + 1)^4 and 1/(λ_S s + 1)², and a full model.

    The model is the simulator's with its friction. Static friction is smoothed, as no sensor measures the deflection of
    the bristles, which the law would need.
    """
    gains = baselines.FeedbackLinearizationGains(
        lambdas.lam_q / 2.0, lambdas.lam_S, ERROR_POLE, ERROR_POLE, OBSERVER_POLE
    )
    bounds = compute_bounds(parameters)
    return baselines.FeedbackLinearizationTuning(
        gains, smooth_friction(parameters.make_dynamics()), build_decoupler(parameters), bounds.omega_max, bounds.u_max
    )


# Gains ---------------------------------------------------------------------------------------------
# All gains of the cascade from models and λ: table 2 with errata E1 and E3 applied.


UNSEEN_COUNTS = 0.501
"""Dead zone of the position integrator [encoder counts]: for any reference one reading is within it, and the joint is
then within a count."""

UNSEEN_S = 0.01
"""Dead zone of the stiffness integrator [N·m/rad]: a thousandth of the stiffness, some counts of the motors."""

UNSEEN_SHARE = 1e-3
"""The same for another mechanism, as a fraction of its largest stiffness reference."""

UNSEEN_F, MOST_F = 0.3, 10.0
"""External force [N] that the disturbance rejection leaves to the position loop, and the largest that it compensates:
the estimate's error in fast moves is at most 0.3 N, and the compensation increases the force on a rigid obstacle."""

DEVIATIONS = 6.0
"""Least dead zone of the rejection in standard deviations of the estimate, so that it does nothing at rest."""


class PlantModel(NamedTuple):
    """Properties of a plant that the cascade uses besides its gains.

    ``q_count`` [rad] is one count of the joint encoder, ``r_j`` [m] the lever arm of external forces, and ``S_unseen``
    [N·m/rad] the dead zone of the stiffness integrator.
    """

    decoupler: Decoupler
    bounds: Bounds
    model: trajectory.TrajectoryModel
    q_count: float
    r_j: float
    S_unseen: float


def collect_plant_knowledge(parameters: PlantParameters) -> PlantModel:
    """Return geometry, bounds, trajectory model and joint encoder count [rad]."""
    dynamics = parameters.make_identified_dynamics()
    A, B = parameters.select_identified("A"), parameters.select_identified("B")
    joint, motor_A, motor_B = dynamics.joint, dynamics.motor_A, dynamics.motor_B
    model = trajectory.TrajectoryModel(
        K_A=A.K_m,
        T_A=A.T_m,
        K_B=B.K_m,
        T_B=B.T_m,
        K_t_A=motor_A.K_t,
        K_t_B=motor_B.K_t,
        J_j=joint.J_j,
        B_j=joint.B_j,
        tau_e_A=motor_A.tau_e,
        tau_e_B=motor_B.tau_e,
    )
    bounds = compute_bounds(parameters)
    return PlantModel(
        decoupler=build_decoupler(parameters),
        bounds=bounds,
        model=model,
        q_count=parameters.sensors.joint_step,
        r_j=joint.r_j,
        S_unseen=UNSEEN_S if parameters.mechanism is None else UNSEEN_SHARE * bounds.S_max,
    )


def build_reference_tracking(plant_model: PlantModel, u_plan: float) -> ReferenceTracking:
    """Return the trajectory within ``u_plan`` [V] and the dead zones of the outer integrators.

    0 V selects the paper's law, which is fully linear, without dead zones, if the joint encoder has no counts.
    """
    unseen_S = plant_model.S_unseen if u_plan > 0.0 or plant_model.q_count > 0.0 else 0.0
    return ReferenceTracking(u_plan, plant_model.model, UNSEEN_COUNTS * plant_model.q_count, unseen_S)


def rejection(plant_model: PlantModel, inner: pid.MotorPairGains, k_ext: float) -> Rejection:
    """Return the disturbance rejection with gain ``k_ext``.

    It follows the lags of the motor loops ``inner``.
    """
    lags = [motor_lag(gains, T) for gains, T in ((inner.A, plant_model.model.T_A), (inner.B, plant_model.model.T_B))]
    r_j = plant_model.r_j
    return Rejection(k_ext, UNSEEN_F * r_j, MOST_F * r_j, math.exp(-T_s / (0.5 * sum(lags))))


def require_share(k_ext: float) -> None:
    """Raise OutOfRangeError unless ``k_ext`` [1] is in its range."""
    check_range(
        "k_ext",
        k_ext,
        minimum=0.0,
        maximum=1.0,
        unit="1",
        remedy=messages.remedy_for_k_ext(),
    )


def motor_lag(gains: pid.IPDGains, T_m: float) -> float:
    """Return λ_motor [s] of a motor loop from its gains.

    Its four poles at −1/λ have the sum −1/t_f − 1/T_m (table 2).
    """
    return 4.0 / (1.0 / gains.t_f + 1.0 / T_m)


def position_gains(parameters: PlantParameters, point: PointModel, lambdas: TuningParameters) -> pid.IPGains:
    """Return the I-P gains of the position loop at one point. Raises TuningError."""
    return outer_gains(*position_process(parameters, point), lambdas.lam_q, lambdas.b)


def stiffness_gains(parameters: PlantParameters, point: PointModel, lambdas: TuningParameters) -> pid.IPGains:
    """Return the I-P gains of the stiffness loop at one point. Raises TuningError."""
    return outer_gains(*stiffness_process(parameters, point), lambdas.lam_S, lambdas.b)


def position_process(parameters: PlantParameters, point: PointModel) -> tuple[float, float]:
    """Return K [1] and T [s] from q_c to q through the decoupler."""
    if parameters.mechanism is not None:
        return point.K_q, point.T_q
    g = parameters.geometry
    return position_loop_gain(point.K_q, g.r_m, g.r_j), point.T_q


def stiffness_process(parameters: PlantParameters, point: PointModel) -> tuple[float, float]:
    """Return K [1] and T [s] from S_c to S through the decoupler."""
    return stiffness_loop_gain(point.K_S, stiffness_slope(build_decoupler(parameters), point.S_nominal)), point.T_S


def make_motor_loops(
    parameters: PlantParameters, lam_motor: float, motor: MotorModel | None = None
) -> pid.MotorPairGains:
    """Return the I-PD gains of both motor loops. Raises TuningError.

    ``motor`` is the model of both motors; without it each side's identified one is used.
    """
    A, B = motor or motor_model(parameters, "A"), motor or motor_model(parameters, "B")
    return pid.MotorPairGains(motor_gains(A.K_m, A.T_m, lam_motor), motor_gains(B.K_m, B.T_m, lam_motor))


def make_cascade_tuning(
    parameters: PlantParameters,
    lambdas: TuningParameters,
    points: Sequence[PointModel] = (),
    motor: MotorModel | None = None,
    interpolate: bool = False,
    u_plan: float = 0.0,
    k_ext: float = 0.0,
) -> cascade.CascadeTuning:
    """Return the cascade's gains for every point. Raises TuningError.

    Without points the gains are for the 20 N point from geometry, without a motor for that of the parameter set.
    ``u_plan`` [V]: voltage limit of the trajectory, 0 for the paper's governor; ``k_ext`` [1]: gain of the disturbance
    rejection.
    """
    points = sorted(points or (designed_point(parameters, lambdas.lam_motor),), key=lambda point: point.S_nominal)
    rows = []
    for point in points:
        q, S = position_gains(parameters, point, lambdas), stiffness_gains(parameters, point, lambdas)
        rows.append((point.S_nominal, q.k_p, q.k_i, q.k_r, S.k_p, S.k_i, S.k_r))
    plant_model = collect_plant_knowledge(parameters)
    inner = make_motor_loops(parameters, lambdas.lam_motor, motor)
    return combine_tuning(
        plant_model=plant_model,
        inner=inner,
        entries=np.array(rows),
        interpolate=interpolate,
        u_plan=u_plan,
        k_ext=k_ext,
    )


def combine_tuning(
    plant_model: PlantModel,
    inner: pid.MotorPairGains,
    entries: NDArray[np.float64],
    interpolate: bool,
    u_plan: float,
    k_ext: float,
) -> cascade.CascadeTuning:
    """Combine motor loop gains, gains of a bank (n, 7) and the plant's properties."""
    bounds, schedule = plant_model.bounds, Schedule(entries, interpolate)
    return cascade.CascadeTuning(
        motors=inner,
        schedule=schedule,
        decoupler=plant_model.decoupler,
        envelope=bounds.envelope,
        omega_max=bounds.omega_max,
        u_max=bounds.u_max,
        reference_tracking=build_reference_tracking(plant_model, u_plan),
        disturbance_feedforward=rejection(plant_model, inner, k_ext),
    )
