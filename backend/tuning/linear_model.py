"""The high-order linear model of what the outer loops see: plant linearised at rest, motor loops closed around it.

Four lags of the motor loops, the load on them, the joint's resonance: everything a first-order model hides (erratum
E6). Coulomb friction is left out: smoothed at standstill it would look like a huge viscous friction.
"""

from dataclasses import replace

import control
import numpy as np
from numpy.typing import NDArray

from backend.controllers import decoupler, i_pd
from plant.dynamics import PlantState, derivative
from plant.parameters import PlantParameters
from plant.spring import tension

_STEP = 1e-6


def decoupled_model(parameters: PlantParameters, gains: i_pd.Gains, S: float) -> control.StateSpace:
    """Linear model from (q_c, S_c) to (q, S) at stiffness S [N·m/rad] and q = 0, motor loops with ``gains``.

    By symmetry the cross terms vanish; the diagonal is what the two outer loops control, gain 1 at low frequency.
    """
    plant = _linear_plant(parameters, S)
    system = control.interconnect(
        [plant, _motor_loop(gains, "A"), _motor_loop(gains, "B"), _decoupling(parameters), _outputs(parameters)],
        inputs=["q_c", "S_c"],
        outputs=["q_out", "S_out"],
        check_unused=False,
    )
    return system


def stiffness_tension(parameters: PlantParameters, S: float) -> float:
    """Tension of both tendons [N] when the unloaded joint rests at stiffness S [N·m/rad]."""
    g = parameters.geometry
    theta, _ = decoupler.motor_positions(decoupler.decoupler_for(parameters), 0.0, S)
    return tension(parameters.nominal_spring, g.r_m * theta)


def _linear_plant(parameters: PlantParameters, S: float) -> control.StateSpace:
    symmetric = replace(
        parameters,
        motor=replace(parameters.motor, c0=0.0, c1=0.0),
        asymmetry=replace(parameters.asymmetry, spring_A=1.0, spring_B=1.0, motor_A=1.0, motor_B=1.0),
    )
    plant = symmetric.dynamics()
    theta, _ = decoupler.motor_positions(decoupler.decoupler_for(parameters), 0.0, S)
    load = plant.joint.r_m * tension(plant.spring_A, plant.joint.r_m * theta)
    at = np.array(PlantState(0.0, 0.0, theta, 0.0, load, theta, 0.0, load))
    u = load / plant.motor_A.K_t

    def rate(x: NDArray[np.float64], u_A: float, u_B: float) -> NDArray[np.float64]:
        return np.array(derivative(plant, PlantState(*x), u_A, u_B, 0.0))

    A = np.column_stack([(rate(at + d, u, u) - rate(at - d, u, u)) / (2.0 * _STEP) for d in _STEP * np.eye(8)])
    B = np.column_stack(
        [
            (rate(at, u + _STEP, u) - rate(at, u - _STEP, u)) / (2.0 * _STEP),
            (rate(at, u, u + _STEP) - rate(at, u, u - _STEP)) / (2.0 * _STEP),
        ]
    )
    C = np.zeros((3, 8))
    C[0, 0] = C[1, 2] = C[2, 5] = 1.0
    return control.ss(
        A, B, C, np.zeros((3, 2)), inputs=["u_A", "u_B"], outputs=["q", "theta_A", "theta_B"], name="plant"
    )


def _motor_loop(gains: i_pd.Gains, side: str) -> control.StateSpace:
    """I-PD with its filter in continuous time; states: integral, filtered integral, filtered position."""
    k_p, k_i, k_d, t_f = gains
    A = np.array([[0.0, 0.0, 0.0], [1.0 / t_f, -1.0 / t_f, 0.0], [0.0, 0.0, -1.0 / t_f]])
    B = np.array([[k_i, -k_i], [0.0, 0.0], [0.0, 1.0 / t_f]])
    C = np.array([[0.0, 1.0, k_d / t_f - k_p]])
    D = np.array([[0.0, -k_d / t_f]])
    names = [f"theta_{side}_ref", f"theta_{side}"]
    return control.ss(A, B, C, D, inputs=names, outputs=[f"u_{side}"], name=f"motor_{side}")


def _decoupling(parameters: PlantParameters) -> control.StateSpace:
    d = decoupler.decoupler_for(parameters)
    q_gain = d.r_j / d.r_m
    S_gain = 1.0 / (4.0 * d.k_2 * d.r_j**2 * d.r_m)
    D = np.array([[q_gain, S_gain], [-q_gain, S_gain]])
    return control.ss([], [], [], D, inputs=["q_c", "S_c"], outputs=["theta_A_ref", "theta_B_ref"], name="decoupler")


def _outputs(parameters: PlantParameters) -> control.StateSpace:
    d = decoupler.decoupler_for(parameters)
    S_gain = 2.0 * d.r_j**2 * d.k_2 * d.r_m
    D = np.array([[1.0, 0.0, 0.0], [0.0, S_gain, S_gain]])
    return control.ss([], [], [], D, inputs=["q", "theta_A", "theta_B"], outputs=["q_out", "S_out"], name="outputs")
