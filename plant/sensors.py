"""What the encoders, load cells and converters make of the true state."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from plant.compiled import compiled
from plant.dynamics import Dynamics, PlantState
from plant.interface import Measurement, T_s
from plant.joint import elongation_A, elongation_B, joint_stiffness
from plant.obstacle import NO_OBSTACLE, Obstacle, contact_force
from plant.parameter_sections import Sensors
from plant.spring import tension

DELAY_SLOTS = 64
"""Length of the load cells' delay line [ticks]."""


class SensorModel(NamedTuple):
    """Resolutions (0: exact) and load cell delay.

    ``joint_step``, ``motor_step`` [rad] per count; ``force_step`` [N] and ``voltage_step`` [V] per converter step;
    ``delay_ticks`` of the load cells.
    """

    joint_step: float
    motor_step: float
    force_step: float
    voltage_step: float
    delay_ticks: int


@compiled
def quantise(value: float, step: float) -> float:
    """Round to the nearest multiple of ``step``; exact where step is 0."""
    if step == 0.0:
        return value
    return math.floor(value / step + 0.5) * step


@compiled
def delayed(line: NDArray[np.float64], tick: int, delay_ticks: int, F_A: float, F_B: float) -> tuple[float, float]:
    """Put this tick's forces [N] into the delay line (2, DELAY_SLOTS), return those of ``delay_ticks`` ago."""
    slots = line.shape[1]
    line[0, tick % slots] = F_A
    line[1, tick % slots] = F_B
    past = tick - delay_ticks
    if past < 0:
        past = 0
    return line[0, past % slots], line[1, past % slots]


@compiled
def sense(
    plant: Dynamics,
    sensors: SensorModel,
    x: PlantState,
    line: NDArray[np.float64],
    tick: int,
    noise_A: float,
    noise_B: float,
    F_push: float,
    safety_trip: float,
    obstacle: Obstacle = NO_OBSTACLE,
) -> Measurement:
    """Measurement of the true state x; ``noise_A``, ``noise_B`` [N] are this tick's load cell errors."""
    x_A = elongation_A(plant.joint, x.theta_A, x.q)
    x_B = elongation_B(plant.joint, x.theta_B, x.q)
    F_A, F_B = delayed(line, tick, sensors.delay_ticks, tension(plant.spring_A, x_A), tension(plant.spring_B, x_B))
    return Measurement(
        quantise(x.q, sensors.joint_step),
        quantise(x.theta_A, sensors.motor_step),
        quantise(x.theta_B, sensors.motor_step),
        quantise(F_A + noise_A, sensors.force_step),
        quantise(F_B + noise_B, sensors.force_step),
        joint_stiffness(plant.joint, plant.spring_A, plant.spring_B, x_A, x_B),
        F_push,
        safety_trip,
        contact_force(obstacle, plant.joint, x.q, x.q_dot),
    )


def sensor_model(parameters: Sensors, F_max: float, u_max: float) -> SensorModel:
    """Resolutions from counts per revolution and converter bits over the ranges ±2 F_max and ±u_max."""
    steps = 2.0**parameters.converter_bits
    exact = parameters.converter_bits == 0.0
    return SensorModel(
        joint_step=parameters.joint_step,
        motor_step=parameters.motor_step,
        force_step=0.0 if exact else 4.0 * F_max / steps,
        voltage_step=0.0 if exact else 2.0 * u_max / steps,
        delay_ticks=round(parameters.force_delay / T_s),
    )
