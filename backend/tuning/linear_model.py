"""The high-order linear model of what the outer loops see: plant linearised at rest, motor loops closed around it.

Four lags of the motor loops, the load on them, the joint's resonance: everything a first-order model hides (erratum
E6). Coulomb friction is left out: smoothed at standstill it would look like a huge viscous friction.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from backend.control import decoupler, pid
from backend.control.decoupler import Decoupler
from backend.tuning.models import PointModel
from plant.dynamics import Dynamics, Motor, PlantState, derivative, tension
from plant.interface import NO_LOAD
from plant.parameters import PlantParameters

if TYPE_CHECKING:
    import control

_STEP = 1e-6
_STATES = 8
"""Of a plant without friction: the bristles, which come last in ``PlantState``, are none of its states."""


def decoupled_model(
    parameters: PlantParameters, gains: pid.MotorPairGains, S: float, *, true_plant: bool = False
) -> "control.StateSpace":
    """Linear model from (q_c, S_c) to (q, S) at stiffness S [N·m/rad] and q = 0, motor loops with ``gains``.

    The diagonal is what the two outer loops control, gain 1 at low frequency; the cross terms have gain 0 there, and
    vanish altogether where both sides are alike. With ``true_plant`` motors and springs are those of the plant itself,
    and the decoupler is still the one of the identified springs.
    """
    import control

    d = decoupler.decoupler_for(parameters)
    system = control.interconnect(
        [
            linear_plant(parameters, d, S, true_plant=true_plant),
            _motor_loop(gains.A, "A"),
            _motor_loop(gains.B, "B"),
            _decoupler(d, S),
            _outputs(d, S),
        ],
        inputs=["q_c", "S_c"],
        outputs=["q_out", "S_out"],
        check_unused=False,
    )
    return system


def one_motor_point(parameters: PlantParameters, gains: pid.MotorPairGains, S: float) -> PointModel:
    """Return what geometry, springs and motor loops say of theta_A_ref to q and to S at S [N·m/rad], motor B held.

    Static gain, and the sum of lags: minus the slope of the phase at zero frequency, of the linear plant without
    friction.
    """
    import control

    d = decoupler.decoupler_for(parameters)
    system = control.interconnect(
        [linear_plant(parameters, d, S), _motor_loop(gains.A, "A"), _motor_loop(gains.B, "B"), _outputs(d, S)],
        inputs=["theta_A_ref"],
        outputs=["q_out", "S_out"],
        check_unused=False,
    )
    A, B, C = (np.asarray(part) for part in (system.A, system.B, system.C))
    once = np.linalg.solve(A, B)
    K, slope = -(C @ once)[:, 0], -(C @ np.linalg.solve(A, once))[:, 0]
    T = -slope / K
    return PointModel(S, float(K[0]), float(T[0]), float(K[1]), float(T[1]))


def linear_plant(
    parameters: PlantParameters, d: Decoupler, S: float, *, true_plant: bool = False
) -> "control.StateSpace":
    """From voltages [V] and a torque on the joint [N·m] to q, θ_A, θ_B [rad], about rest at S [N·m/rad] and q = 0.

    Motors and springs are the identified ones, or with ``true_plant`` those of the plant itself. S is always what the
    controller estimates.
    """
    import control

    theta_A, theta_B = decoupler.motor_positions(d, 0.0, S)
    if true_plant:
        plant = _without_friction(parameters.dynamics())
        theta_A, theta_B = _at_rest(plant, theta_A + theta_B)
    else:
        plant = parameters.identified_dynamics()
    load_A = d.r_m * tension(plant.spring_A, d.r_m * theta_A)
    load_B = d.r_m * tension(plant.spring_B, d.r_m * theta_B)
    at = np.array(PlantState(0.0, 0.0, theta_A, 0.0, load_A, theta_B, 0.0, load_B))[:_STATES]
    u_A, u_B = load_A / plant.motor_A.K_t, load_B / plant.motor_B.K_t

    def rate(x: NDArray[np.float64], u_A: float, u_B: float, tau_ext: float = 0.0) -> NDArray[np.float64]:
        return np.array(derivative(plant, PlantState(*x), u_A, u_B, tau_ext, NO_LOAD))[:_STATES]

    A = np.column_stack(
        [(rate(at + dx, u_A, u_B) - rate(at - dx, u_A, u_B)) / (2.0 * _STEP) for dx in _STEP * np.eye(_STATES)]
    )
    B = np.column_stack(
        [
            (rate(at, u_A + _STEP, u_B) - rate(at, u_A - _STEP, u_B)) / (2.0 * _STEP),
            (rate(at, u_A, u_B + _STEP) - rate(at, u_A, u_B - _STEP)) / (2.0 * _STEP),
            (rate(at, u_A, u_B, _STEP) - rate(at, u_A, u_B, -_STEP)) / (2.0 * _STEP),
        ]
    )
    C = np.zeros((3, _STATES))
    C[0, 0] = C[1, 2] = C[2, 5] = 1.0
    inputs = ["u_A", "u_B", "tau_ext"]
    return control.ss(A, B, C, np.zeros((3, 3)), inputs=inputs, outputs=["q", "theta_A", "theta_B"], name="plant")


def _without_friction(plant: Dynamics) -> Dynamics:
    def free(motor: Motor) -> Motor:
        return motor._replace(friction=motor.friction._replace(c0=0.0, c1=0.0, lugre=None))

    return plant._replace(motor_A=free(plant.motor_A), motor_B=free(plant.motor_B))


def _at_rest(plant: Dynamics, turned: float) -> tuple[float, float]:
    """θ_A, θ_B [rad] whose sum is ``turned``, with the same tension in both tendons at q = 0.

    The stiffness loop fixes the sum, the position loop the difference.
    """
    from scipy.optimize import brentq

    r_m, half = plant.joint.r_m, 0.5 * turned

    def excess(offset: float) -> float:
        tension_A = tension(plant.spring_A, r_m * (half + offset))
        return float(tension_A - tension(plant.spring_B, r_m * (half - offset)))

    offset = float(brentq(excess, -half, half, xtol=1e-12))
    return half + offset, half - offset


def _motor_loop(gains: pid.IPDGains, side: str) -> "control.StateSpace":
    """I-PD with its filter in continuous time; states: integral, filtered integral, filtered position."""
    import control

    k_p, k_i, k_d, t_f = gains
    A = np.array([[0.0, 0.0, 0.0], [1.0 / t_f, -1.0 / t_f, 0.0], [0.0, 0.0, -1.0 / t_f]])
    B = np.array([[k_i, -k_i], [0.0, 0.0], [0.0, 1.0 / t_f]])
    C = np.array([[0.0, 1.0, k_d / t_f - k_p]])
    D = np.array([[0.0, -k_d / t_f]])
    names = [f"theta_{side}_ref", f"theta_{side}"]
    return control.ss(A, B, C, D, inputs=names, outputs=[f"u_{side}"], name=f"motor_{side}")


def decoupling(d: Decoupler, S: float) -> NDArray[np.float64]:
    """Motor references per q_c and S_c, shape (2, 2), about q = 0 and S [N·m/rad]."""

    def positions(q_c: float, S_c: float) -> NDArray[np.float64]:
        return np.array(decoupler.motor_positions(d, q_c, S_c))

    return np.column_stack(
        [
            (positions(_STEP, S) - positions(-_STEP, S)) / (2.0 * _STEP),
            (positions(0.0, S + _STEP) - positions(0.0, S - _STEP)) / (2.0 * _STEP),
        ]
    )


def _decoupler(d: Decoupler, S: float) -> "control.StateSpace":
    import control

    D, names = decoupling(d, S), ["theta_A_ref", "theta_B_ref"]
    return control.ss([], [], [], D, inputs=["q_c", "S_c"], outputs=names, name="decoupler")


def _outputs(d: Decoupler, S: float) -> "control.StateSpace":
    import control

    S_gain = decoupler.stiffness_slope(d, S)
    D = np.array([[1.0, 0.0, 0.0], [0.0, S_gain, S_gain]])
    return control.ss([], [], [], D, inputs=["q", "theta_A", "theta_B"], outputs=["q_out", "S_out"], name="outputs")
