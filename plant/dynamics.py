"""The whole plant as one ordinary differential equation, and its integration (classical Runge-Kutta)."""

from typing import NamedTuple

from plant.compiled import compiled
from plant.interface import NO_LOAD, ShaftLoad
from plant.joint import Joint, elongation_A, elongation_B, joint_acceleration
from plant.motor import Motor, motor_acceleration, motor_torque_rate
from plant.spring import Spring, tension

SUBSTEPS = 4
"""Runge-Kutta steps per sampling period: 0.25 ms against a fastest time constant of 2 ms."""

_SUBNORMAL = 1e-200


class Dynamics(NamedTuple):
    """Constants of the plant for the compiled functions."""

    joint: Joint
    motor_A: Motor
    motor_B: Motor
    spring_A: Spring
    spring_B: Spring


class PlantState(NamedTuple):
    """q [rad], q_dot [rad/s]; per motor angle [rad], speed [rad/s] and torque [N·m] at the gearbox outlet."""

    q: float
    q_dot: float
    theta_A: float
    omega_A: float
    tau_A: float
    theta_B: float
    omega_B: float
    tau_B: float


AT_REST = PlantState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@compiled
def derivative(plant: Dynamics, x: PlantState, u_A: float, u_B: float, tau_ext: float, load: ShaftLoad) -> PlantState:
    """dx/dt under motor voltages [V], external joint torque [N·m] and shaft loads [N·m] (equations 1-13)."""
    r_m = plant.joint.r_m
    F_A = tension(plant.spring_A, elongation_A(plant.joint, x.theta_A, x.q))
    F_B = tension(plant.spring_B, elongation_B(plant.joint, x.theta_B, x.q))
    return PlantState(
        x.q_dot,
        joint_acceleration(plant.joint, x.q_dot, F_A, F_B, tau_ext),
        x.omega_A,
        motor_acceleration(plant.motor_A, x.omega_A, x.tau_A, r_m * F_A + load.load_A),
        motor_torque_rate(plant.motor_A, x.tau_A, u_A),
        x.omega_B,
        motor_acceleration(plant.motor_B, x.omega_B, x.tau_B, r_m * F_B + load.load_B),
        motor_torque_rate(plant.motor_B, x.tau_B, u_B),
    )


@compiled
def _axpy(h: float, d: PlantState, x: PlantState) -> PlantState:
    return PlantState(
        x.q + h * d.q,
        x.q_dot + h * d.q_dot,
        x.theta_A + h * d.theta_A,
        x.omega_A + h * d.omega_A,
        x.tau_A + h * d.tau_A,
        x.theta_B + h * d.theta_B,
        x.omega_B + h * d.omega_B,
        x.tau_B + h * d.tau_B,
    )


@compiled
def _flush(value: float) -> float:
    # A state that decays to a subnormal number makes each step many times slower.
    return value if abs(value) > _SUBNORMAL else 0.0


@compiled
def advance(
    plant: Dynamics,
    x: PlantState,
    u_A: float,
    u_B: float,
    tau_ext: float,
    duration_s: float,
    substeps: int,
    load: ShaftLoad = NO_LOAD,
) -> PlantState:
    """State after ``duration_s`` under held inputs, by ``substeps`` classical Runge-Kutta steps."""
    h = duration_s / substeps
    for _ in range(substeps):
        d1 = derivative(plant, x, u_A, u_B, tau_ext, load)
        d2 = derivative(plant, _axpy(0.5 * h, d1, x), u_A, u_B, tau_ext, load)
        d3 = derivative(plant, _axpy(0.5 * h, d2, x), u_A, u_B, tau_ext, load)
        d4 = derivative(plant, _axpy(h, d3, x), u_A, u_B, tau_ext, load)
        x = _axpy(h / 6.0, d1, _axpy(h / 3.0, d2, _axpy(h / 3.0, d3, _axpy(h / 6.0, d4, x))))
    return PlantState(
        x.q,
        _flush(x.q_dot),
        x.theta_A,
        _flush(x.omega_A),
        _flush(x.tau_A),
        x.theta_B,
        _flush(x.omega_B),
        _flush(x.tau_B),
    )
