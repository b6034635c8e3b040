"""What tuning starts from: first-order models of the outer loops at a nominal point, the motor's model, and λ."""

from dataclasses import dataclass

from backend.control.decoupler import decoupler_for, stiffness_slope
from plant.parameters import PlantParameters, Side

LAM_MOTOR = 0.0854
LAM_Q = 0.5
LAM_S = 0.42
"""Defaults of λ [s] (method section 5)."""

LAM_MAX = 3.0
"""Upper end of the offered range of lam_q and lam_S [s]."""

S_NOMINAL_20_N = 10.55
"""Stiffness at 20 N tendon tension [N·m/rad], the paper's nominal point of its experiments."""


@dataclass(frozen=True)
class PointModel:
    """Models with one motor excited: theta_A_ref to q and to S, reduced to K/(T s + 1) at one nominal point.

    ``S_nominal`` [N·m/rad], ``K_q`` [1], ``T_q`` [s], ``K_S`` [N·m/rad per rad], ``T_S`` [s].
    """

    S_nominal: float
    K_q: float
    T_q: float
    K_S: float
    T_S: float


@dataclass(frozen=True)
class MotorModel:
    """``K_m`` [rad/(V·s)] and ``T_m`` [s] of K_m/(s (T_m s + 1)); ``tau_e`` [s], the electrical lag it leaves out."""

    K_m: float
    T_m: float
    tau_e: float


@dataclass(frozen=True)
class Lambdas:
    """The tuning parameters [s], and the weight ``b`` of the reference in the outer loops' proportional part."""

    lam_q: float = LAM_Q
    lam_S: float = LAM_S
    lam_motor: float = LAM_MOTOR
    b: float = 0.0


def designed_point(parameters: PlantParameters, lam_motor: float = LAM_MOTOR) -> PointModel:
    """Model at 20 N from geometry alone, before anything is identified: gains of section 4, four lags of λ_motor."""
    g = parameters.geometry
    return PointModel(
        S_nominal=S_NOMINAL_20_N,
        K_q=g.r_m / (2.0 * g.r_j),
        T_q=4.0 * lam_motor,
        K_S=stiffness_slope(decoupler_for(parameters), S_NOMINAL_20_N),
        T_S=4.0 * lam_motor,
    )


def motor_model(parameters: PlantParameters, side: Side) -> MotorModel:
    """Model of the motor of one side, as identified (equation 17); its L/R is the data sheet's."""
    known = parameters.identified_of(side)
    return MotorModel(known.K_m, known.T_m, parameters.motor_of(side).tau_e)


def true_motor_model(parameters: PlantParameters, side: Side) -> MotorModel:
    """Model of the motor of one side as the plant has it, with the asymmetry of its torque constant."""
    own = parameters.motor_of(side)
    factor: float = getattr(parameters.asymmetry, f"motor_{side}")
    return MotorModel(factor * own.K_m, own.T_m, own.tau_e)
