"""The closed loop offline: the compiled functions of the live tick in one compiled loop over all ticks."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.control import cascade, decoupler, disturbance_observer, pid
from backend.control.trajectory import References
from plant.compiled import compiled, compiled_run
from plant.dynamics import Dynamics, PlantState, elongation_A, elongation_B, tension
from plant.interface import Measurement, MotorCommand
from plant.parameters import PlantParameters
from plant.simulator import DELAY_SLOTS, SafetyBounds, SensorModel, actuate, exceeded, sense, sensor_model

Array = NDArray[np.float64]

COLUMNS = (
    "q", "S", "S_true", "theta_A", "theta_B", "F_A", "F_B", "u_A", "u_B",
    "theta_A_ref", "theta_B_ref", "q_ref_gov", "S_ref_gov",
)  # fmt: skip
"""Columns of the array that ``simulate`` fills; SI units as in backend.sample."""


class Rig(NamedTuple):
    """The simulated plant with its sensors and bounds."""

    plant: Dynamics
    sensors: SensorModel
    bounds: SafetyBounds
    u_max: float


class Inputs(NamedTuple):
    """What acts on the closed loop in each tick.

    ``q_ref`` [rad], ``S_ref`` [N·m/rad], ``F_push`` [N], each (ticks,); ``noise`` of the load cells (ticks, 2) [N].
    """

    q_ref: Array
    S_ref: Array
    F_push: Array
    noise: Array


@compiled
def fill_delay_line(rig: Rig, x: PlantState, line: Array) -> None:
    """Let the load cells have seen the state x for as long as they remember; the first tick is DELAY_SLOTS."""
    for slot in range(DELAY_SLOTS):
        sense(rig.plant, rig.sensors, x, line, slot, 0.0, 0.0, 0.0, 0.0)


@compiled
def record(row: Array, m: Measurement, y: cascade.CascadeOutput) -> None:
    """Put a tick into its row (len(COLUMNS),)."""
    row[0], row[1], row[2] = m.q, y.S, m.S_true
    row[3], row[4] = m.theta_A, m.theta_B
    row[5], row[6] = m.F_A, m.F_B
    row[7], row[8] = y.u_A, y.u_B
    row[9], row[10] = y.theta_A_ref, y.theta_B_ref
    row[11], row[12] = y.q_ref_gov, y.S_ref_gov


@compiled_run
def simulate(
    rig: Rig,
    tuning: cascade.CascadeTuning,
    x: PlantState,
    controller: cascade.CascadeState,
    inputs: Inputs,
    line: Array,
    out: Array,
) -> tuple[PlantState, cascade.CascadeState, int]:
    """Run the cascade on the simulated plant for len(inputs.q_ref) ticks, filling ``out`` (ticks, len(COLUMNS)).

    ``line`` (2, DELAY_SLOTS) is the load cells' memory. Returns the final states and the tick at which the safety
    module tripped (−1: never), where the run ends.
    """
    fill_delay_line(rig, x, line)
    for k in range(inputs.q_ref.shape[0]):
        noise, F_push = inputs.noise[k], inputs.F_push[k]
        m = sense(rig.plant, rig.sensors, x, line, k + DELAY_SLOTS, noise[0], noise[1], F_push, 0.0)
        r = References(inputs.q_ref[k], inputs.S_ref[k], math.nan, math.nan)
        y, controller = cascade.step(tuning, controller, r, True, m)
        record(out[k], m, y)
        x = actuate(rig.plant, rig.sensors, rig.u_max, x, MotorCommand(y.u_A, y.u_B), F_push)
        if exceeded(rig.plant, rig.bounds, x):
            return x, controller, k
    return x, controller, -1


@compiled_run
def simulate_feeling(
    rig: Rig,
    tuning: cascade.CascadeTuning,
    observer: disturbance_observer.Observer,
    learned_at: int,
    x: PlantState,
    controller: cascade.CascadeState,
    inputs: Inputs,
    line: Array,
    out: Array,
) -> int:
    """Run as ``simulate`` with the outside torque of the observer, for the rejection of pushes; return the trip's tick.

    At the tick ``learned_at`` its bias is learned: nothing is answered before.
    """
    fill_delay_line(rig, x, line)
    felt, bias = disturbance_observer.UNKNOWN, math.nan
    for k in range(inputs.q_ref.shape[0]):
        noise, F_push = inputs.noise[k], inputs.F_push[k]
        m = sense(rig.plant, rig.sensors, x, line, k + DELAY_SLOTS, noise[0], noise[1], F_push, 0.0)
        felt = disturbance_observer.step_disturbance_observer(observer, felt, m)
        if k == learned_at:
            bias = felt.mean
        r = References(inputs.q_ref[k], inputs.S_ref[k], math.nan, math.nan)
        y, controller = cascade.step(tuning, controller, r, True, m, felt.tau_ext - bias)
        record(out[k], m, y)
        x = actuate(rig.plant, rig.sensors, rig.u_max, x, MotorCommand(y.u_A, y.u_B), F_push)
        if exceeded(rig.plant, rig.bounds, x):
            return k
    return -1


@dataclass(frozen=True)
class Trajectory:
    """Result of a simulated run: one array (ticks,) per column, SI units; ``tripped_at`` is a tick or −1."""

    q: Array
    S: Array
    S_true: Array
    theta_A: Array
    theta_B: Array
    F_A: Array
    F_B: Array
    u_A: Array
    u_B: Array
    theta_A_ref: Array
    theta_B_ref: Array
    q_ref_gov: Array
    S_ref_gov: Array
    tripped_at: int


def trajectory_of(out: Array, tripped_at: int) -> Trajectory:
    """Columns of a filled array (ticks, len(COLUMNS)) by name."""
    return Trajectory(**dict(zip(COLUMNS, out.T, strict=True)), tripped_at=tripped_at)


def rig_of(parameters: PlantParameters) -> Rig:
    """Compile-ready constants of a parameter set."""
    return Rig(
        parameters.dynamics(),
        sensor_model(parameters.sensors, parameters.safety.F_max, parameters.motor.u_max),
        SafetyBounds(parameters.safety.F_max, parameters.geometry.q_max),
        parameters.motor.u_max,
    )


def rest_state(rig: Rig, theta_A: float, theta_B: float) -> tuple[PlantState, float, float]:
    """Plant standing with the motors at theta_A, theta_B [rad], and the voltages [V] that hold it there."""
    plant = rig.plant
    r_m = plant.joint.r_m

    def forces(q: float) -> tuple[float, float]:
        return (
            tension(plant.spring_A, elongation_A(plant.joint, theta_A, q)),
            tension(plant.spring_B, elongation_B(plant.joint, theta_B, q)),
        )

    low, high = -rig.bounds.q_max, rig.bounds.q_max
    while low < (q := 0.5 * (low + high)) < high:
        F_A, F_B = forces(q)
        low, high = (q, high) if F_A > F_B else (low, q)
    F_A, F_B = forces(q)
    load_A, load_B = r_m * F_A, r_m * F_B
    x = PlantState(q, 0.0, theta_A, 0.0, load_A, theta_B, 0.0, load_B, z_A=0.0, z_B=0.0)
    return x, load_A / plant.motor_A.K_t, load_B / plant.motor_B.K_t


def run(
    parameters: PlantParameters,
    tuning: cascade.CascadeTuning,
    q_ref: Array,
    S_ref: Array,
    F_push: Array | None = None,
    seed: int = 0,
    entry: float = -1.0,
    learned_at: int | None = None,
    rig: Rig | None = None,
) -> Trajectory:
    """Simulate the cascade from rest at (q_ref[0], S_ref[0]) under references (ticks,) [rad, N·m/rad].

    ``F_push`` (ticks,) [N] defaults to none. ``entry``: bank entry in use at the start, −1 for the one nearest to S.
    From the tick ``learned_at`` on the outside force is known and rejected as ``tuning`` says; None: it is not known.
    ``rig``: that of ``parameters``, where it is at hand; making it takes as long as some seconds of simulation.
    The same arguments give the same trajectory to the last bit.
    """
    rig = rig or rig_of(parameters)
    x, controller = at_rest(rig, tuning, float(q_ref[0]), float(S_ref[0]))
    if entry >= 0.0:
        controller = controller._replace(active=float(entry))
    inputs = inputs_of(parameters, q_ref, S_ref, F_push, seed)
    line, out = empty_arrays(q_ref.size)
    if learned_at is not None:
        observer = disturbance_observer.observer_for(parameters)
        return trajectory_of(out, simulate_feeling(rig, tuning, observer, learned_at, x, controller, inputs, line, out))
    _, _, tripped_at = simulate(rig, tuning, x, controller, inputs, line, out)
    return trajectory_of(out, tripped_at)


def at_rest(
    rig: Rig, tuning: cascade.CascadeTuning, q_ref: float, S_ref: float
) -> tuple[PlantState, cascade.CascadeState]:
    """Plant and cascade standing where the decoupler puts (q_ref [rad], S_ref [N·m/rad])."""
    theta_A, theta_B = decoupler.motor_positions(tuning.decoupler, q_ref, S_ref)
    x, u_A, u_B = rest_state(rig, theta_A, theta_B)
    m = Measurement(x.q, x.theta_A, x.theta_B, 0.0, 0.0, 0.0, 0.0, 0.0)
    inner = pid.at_rest_motor_pair(tuning.motors, theta_A, theta_B, u_A, u_B)
    return x, cascade.take_over(tuning, inner, tuning.motors, theta_A, theta_B, m, x.q)


def empty_arrays(ticks: int) -> tuple[Array, Array]:
    """Return the load cells' memory and the rows to fill, nan until they are."""
    return np.zeros((2, DELAY_SLOTS)), np.full((ticks, len(COLUMNS)), np.nan)


def inputs_of(
    parameters: PlantParameters, q_ref: Array, S_ref: Array, F_push: Array | None = None, seed: int = 0
) -> Inputs:
    """Return references and push (ticks,) together with the load cell noise that the seed gives."""
    noise = parameters.sensors.force_noise * np.random.default_rng(seed).standard_normal((q_ref.size, 2))
    return Inputs(q_ref, S_ref, np.zeros(q_ref.size) if F_push is None else F_push, noise)
