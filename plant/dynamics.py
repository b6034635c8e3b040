"""The whole plant as one ordinary differential equation, and its integration (classical Runge-Kutta)."""

from typing import NamedTuple

from plant.compiled import compiled
from plant.friction import bristle_after, bristle_rate
from plant.interface import NO_LOAD, ShaftLoad
from plant.joint import Joint, elongation_A, elongation_B, joint_acceleration
from plant.motor import Motor, motor_acceleration, motor_torque_rate
from plant.obstacle import NO_OBSTACLE, Obstacle, beside
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
    """q [rad], q_dot [rad/s]; per motor angle [rad], speed [rad/s] and torque [N·m] at the gearbox outlet.

    ``z_A``, ``z_B`` [rad]: deflection of the friction's bristles, 0 and unused where friction is smoothed.
    """

    q: float
    q_dot: float
    theta_A: float
    omega_A: float
    tau_A: float
    theta_B: float
    omega_B: float
    tau_B: float
    z_A: float = 0.0
    z_B: float = 0.0


def smoothed(plant: Dynamics) -> Dynamics:
    """Return the plant with Coulomb friction that is smoothed where its own sticks."""
    A, B = (motor._replace(friction=motor.friction._replace(lugre=None)) for motor in (plant.motor_A, plant.motor_B))
    return plant._replace(motor_A=A, motor_B=B)


AT_REST = PlantState(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


@compiled
def derivative(
    plant: Dynamics,
    x: PlantState,
    u_A: float,
    u_B: float,
    tau_ext: float,
    load: ShaftLoad,
    obstacle: Obstacle = NO_OBSTACLE,
) -> PlantState:
    """dx/dt under motor voltages [V], external joint torque [N·m], shaft loads [N·m] and a wall (equations 1-13)."""
    r_m = plant.joint.r_m
    F_A = tension(plant.spring_A, elongation_A(plant.joint, x.theta_A, x.q))
    F_B = tension(plant.spring_B, elongation_B(plant.joint, x.theta_B, x.q))
    load_A, load_B = r_m * F_A + load.load_A, r_m * F_B + load.load_B
    return PlantState(
        x.q_dot,
        joint_acceleration(plant.joint, x.q_dot, F_A, F_B, beside(obstacle, plant.joint, x.q, x.q_dot, tau_ext)),
        x.omega_A,
        motor_acceleration(plant.motor_A, x.omega_A, x.tau_A, load_A, x.z_A),
        motor_torque_rate(plant.motor_A, x.tau_A, u_A),
        x.omega_B,
        motor_acceleration(plant.motor_B, x.omega_B, x.tau_B, load_B, x.z_B),
        motor_torque_rate(plant.motor_B, x.tau_B, u_B),
        bristle_rate(plant.motor_A.friction, x.omega_A, load_A, x.z_A),
        bristle_rate(plant.motor_B.friction, x.omega_B, load_B, x.z_B),
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
        x.z_A,
        x.z_B,
    )


@compiled
def _loads(plant: Dynamics, x: PlantState, load: ShaftLoad) -> tuple[float, float]:
    """Load torques [N·m] at both outlets."""
    F_A = tension(plant.spring_A, elongation_A(plant.joint, x.theta_A, x.q))
    F_B = tension(plant.spring_B, elongation_B(plant.joint, x.theta_B, x.q))
    return plant.joint.r_m * F_A + load.load_A, plant.joint.r_m * F_B + load.load_B


@compiled
def _bent(plant: Dynamics, x: PlantState, y: PlantState, h: float, load: ShaftLoad) -> PlantState:
    """State y, reached from x in h [s], with its bristles.

    Where a motor turns fast they slip within less than a Runge-Kutta step: the exact solution takes them there.
    """
    A, B = plant.motor_A.friction, plant.motor_B.friction
    if A.lugre is None and B.lugre is None:
        return y
    before_A, before_B = _loads(plant, x, load)
    load_A, load_B = _loads(plant, y, load)
    return PlantState(
        y.q,
        y.q_dot,
        y.theta_A,
        y.omega_A,
        y.tau_A,
        y.theta_B,
        y.omega_B,
        y.tau_B,
        bristle_after(A, x.z_A, y.theta_A - x.theta_A, h, before_A, load_A),
        bristle_after(B, x.z_B, y.theta_B - x.theta_B, h, before_B, load_B),
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
    obstacle: Obstacle = NO_OBSTACLE,
) -> PlantState:
    """State after ``duration_s`` under held inputs, by ``substeps`` classical Runge-Kutta steps."""
    h = duration_s / substeps
    for _ in range(substeps):
        d1 = derivative(plant, x, u_A, u_B, tau_ext, load, obstacle)
        x2 = _bent(plant, x, _axpy(0.5 * h, d1, x), 0.5 * h, load)
        d2 = derivative(plant, x2, u_A, u_B, tau_ext, load, obstacle)
        x3 = _bent(plant, x, _axpy(0.5 * h, d2, x), 0.5 * h, load)
        d3 = derivative(plant, x3, u_A, u_B, tau_ext, load, obstacle)
        x4 = _bent(plant, x, _axpy(h, d3, x), h, load)
        d4 = derivative(plant, x4, u_A, u_B, tau_ext, load, obstacle)
        end = _axpy(h / 6.0, d1, _axpy(h / 3.0, d2, _axpy(h / 3.0, d3, _axpy(h / 6.0, d4, x))))
        x = _bent(plant, x, end, h, load)
    return PlantState(
        x.q,
        _flush(x.q_dot),
        x.theta_A,
        _flush(x.omega_A),
        _flush(x.tau_A),
        x.theta_B,
        _flush(x.omega_B),
        _flush(x.tau_B),
        x.z_A,
        x.z_B,
    )
