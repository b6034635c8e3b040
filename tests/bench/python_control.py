"""The same closed loop in python-control: cascade and plant as two connected nonlinear systems in continuous time.

The code follows typical use, with plain floats in the derivative functions. The governed references are inputs; `ideal`
has no sensor models. The envelope, which the step does not reach, is omitted.
"""

import math
from typing import Any

import control
import numpy as np

from backend.control import cascade, pid
from backend.tuning.simulation import Array, SimulatedRig
from plant.dynamics import Motor, PlantState, Spring

_PLANT_STATES = ["q", "q_dot", "theta_A", "omega_A", "tau_A", "theta_B", "omega_B", "tau_B"]


def closed_loop(rig: SimulatedRig, tuning: cascade.CascadeTuning) -> control.InterconnectedSystem:
    """Return the system from (q_ref, S_ref) to (q, S)."""
    systems = [_plant(rig), _cascade(rig, tuning)]
    return control.interconnect(systems, inputs=["q_ref", "S_ref"], outputs=["q", "S"])


def initial_state(x: PlantState, controller: cascade.CascadeState) -> Array:
    """Return the state of ``closed_loop`` from the states of the offline loop, without bristles."""
    outer = [controller.position.integral, controller.stiffness.integral]
    return np.array([*x[:8], *outer, *controller.motors.A, *controller.motors.B])


def response(system: control.InterconnectedSystem, t: Array, references: Array, start: Array) -> Array:
    """Return (q, S) over t, shape (2, len(t)); ``references`` (2, len(t))."""
    return np.asarray(control.input_output_response(system, t, references, start).outputs)


def _plant(rig: SimulatedRig) -> control.NonlinearIOSystem:
    joint, motor_A, motor_B, spring_A, spring_B, _ = rig.plant

    def tension(spring: Spring, elongation: float) -> float:
        if elongation <= spring.x_slack:
            return 0.0
        if elongation > spring.x_solid:
            return spring.F_solid + spring.k_solid * (elongation - spring.x_solid)
        k_0, k_1, k_2 = spring.k
        return k_0 + k_1 * elongation + k_2 * elongation**2

    def motor_rates(motor: Motor, omega: float, tau: float, force: float, u: float) -> tuple[float, float, float]:
        load = joint.r_m * force
        friction = (motor.friction.c0 + motor.friction.c1 * load) * math.tanh(omega / motor.friction.omega_smooth)
        acceleration = (tau - motor.B_m * omega - load - friction) / motor.J_m
        return omega, acceleration, (motor.K_t * u - tau) / motor.tau_e

    def update(t: float, x: Array, u: Array, params: dict[str, Any]) -> list[float]:
        q, q_dot, theta_A, omega_A, tau_A, theta_B, omega_B, tau_B = x
        F_A = tension(spring_A, joint.r_m * theta_A - joint.r_j * q)
        F_B = tension(spring_B, joint.r_m * theta_B + joint.r_j * q)
        q_dot_dot = (joint.r_j * (F_A - F_B) - joint.B_j * q_dot) / joint.J_j
        rates_A = motor_rates(motor_A, omega_A, tau_A, F_A, u[0])
        rates_B = motor_rates(motor_B, omega_B, tau_B, F_B, u[1])
        return [q_dot, q_dot_dot, *rates_A, *rates_B]

    def outputs(t: float, x: Array, u: Array, params: dict[str, Any]) -> list[float]:
        return [x[0], x[2], x[5]]

    return control.nlsys(
        update, outputs, inputs=["u_A", "u_B"], outputs=["q", "theta_A", "theta_B"], states=_PLANT_STATES, name="plant"
    )


def _cascade(rig: SimulatedRig, tuning: cascade.CascadeTuning) -> control.NonlinearIOSystem:
    d, u_max = tuning.decoupler, rig.u_max
    gains_q, gains_S = tuning.schedule.entries[0, 1:4], tuning.schedule.entries[0, 4:7]

    def stiffness(theta_A: float, theta_B: float) -> float:
        return 2.0 * d.r_j**2 * (d.k_1 + d.k_2 * d.r_m * (theta_A + theta_B))

    def motor_loop(gains: pid.IPDGains, theta: float, integral_f: float, theta_f: float) -> tuple[float, float]:
        wanted = integral_f - gains.k_p * theta_f - gains.k_d / gains.t_f * (theta - theta_f)
        return wanted, min(max(wanted, -u_max), u_max)

    def motor_rates(
        gains: pid.IPDGains, reference: float, theta: float, integral: float, integral_f: float, theta_f: float
    ) -> tuple[float, float, float]:
        wanted, u = motor_loop(gains, theta, integral_f, theta_f)
        return (
            gains.k_i * (reference - theta) + (u - wanted) / 0.030,
            (integral - integral_f) / gains.t_f,
            (theta - theta_f) / gains.t_f,
        )

    def update(t: float, x: Array, u: Array, params: dict[str, Any]) -> list[float]:
        q_ref, S_ref, q, theta_A, theta_B = u
        S = stiffness(theta_A, theta_B)
        q_c = x[0] + gains_q[2] * q_ref - gains_q[0] * q
        S_c = x[1] + gains_S[2] * S_ref - gains_S[0] * S
        common = (S_c - 2.0 * d.k_1 * d.r_j**2) / (4.0 * d.k_2 * d.r_j**2 * d.r_m)
        difference = d.r_j / d.r_m * q_c
        return [
            gains_q[1] * (q_ref - q),
            gains_S[1] * (S_ref - S),
            *motor_rates(tuning.motors.A, common + difference, theta_A, *x[2:5]),
            *motor_rates(tuning.motors.B, common - difference, theta_B, *x[5:8]),
        ]

    def outputs(t: float, x: Array, u: Array, params: dict[str, Any]) -> list[float]:
        theta_A, theta_B = u[3], u[4]
        u_A = motor_loop(tuning.motors.A, theta_A, x[3], x[4])[1]
        u_B = motor_loop(tuning.motors.B, theta_B, x[6], x[7])[1]
        return [u_A, u_B, stiffness(theta_A, theta_B)]

    return control.nlsys(
        update,
        outputs,
        inputs=["q_ref", "S_ref", "q", "theta_A", "theta_B"],
        outputs=["u_A", "u_B", "S"],
        states=8,
        name="cascade",
    )
