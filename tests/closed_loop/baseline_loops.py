"""Offline closed loops of the baselines, with the plant model of the cascade."""

from backend.control import baselines, decoupler
from backend.control.decoupler import Decoupler
from backend.tuning.simulation import (
    Array,
    ClosedLoopInputs,
    SimulatedRig,
    Trajectory,
    empty_arrays,
    fill_delay_line,
    make_closed_loop_inputs,
    make_simulated_rig,
    make_trajectory,
    record,
    rest_state,
)
from plant.compilation import compiled_run
from plant.dynamics import PlantState
from plant.interface import Measurement, MotorCommand
from plant.parameters import PlantParameters
from plant.simulator import DELAY_SLOTS, actuate_plant, is_limit_exceeded, sense_state


@compiled_run
def _single_loop(
    rig: SimulatedRig,
    tuning: baselines.SingleLoopTuning,
    x: PlantState,
    controller: baselines.SingleLoopState,
    inputs: ClosedLoopInputs,
    line: Array,
    out: Array,
) -> int:
    fill_delay_line(rig, x, line)
    for k in range(inputs.q_ref.shape[0]):
        noise, F_push = inputs.noise[k], inputs.F_push[k]
        m = sense_state(rig.plant, rig.sensors, x, line, k + DELAY_SLOTS, noise[0], noise[1], F_push, 0.0)
        y, controller = baselines.step_single_loop(tuning, controller, inputs.q_ref[k], inputs.S_ref[k], m)
        record(out[k], m, y)
        x = actuate_plant(rig.plant, rig.sensors, rig.u_max, x, MotorCommand(y.u_A, y.u_B), F_push)
        if is_limit_exceeded(rig.plant, rig.bounds, x):
            return k
    return -1


# numba caches per function: a law passed as an argument would be compiled again in every process.
@compiled_run
def _feedback_linearization(
    rig: SimulatedRig,
    tuning: baselines.FeedbackLinearizationTuning,
    x: PlantState,
    controller: baselines.FeedbackLinearizationState,
    inputs: ClosedLoopInputs,
    line: Array,
    out: Array,
) -> int:
    fill_delay_line(rig, x, line)
    for k in range(inputs.q_ref.shape[0]):
        noise, F_push = inputs.noise[k], inputs.F_push[k]
        m = sense_state(rig.plant, rig.sensors, x, line, k + DELAY_SLOTS, noise[0], noise[1], F_push, 0.0)
        y, controller = baselines.step_feedback_linearization(tuning, controller, inputs.q_ref[k], inputs.S_ref[k], m)
        record(out[k], m, y)
        x = actuate_plant(rig.plant, rig.sensors, rig.u_max, x, MotorCommand(y.u_A, y.u_B), F_push)
        if is_limit_exceeded(rig.plant, rig.bounds, x):
            return k
    return -1


def run_single_loop(
    parameters: PlantParameters,
    tuning: baselines.SingleLoopTuning,
    q_ref: Array,
    S_ref: Array,
    F_push: Array | None = None,
    seed: int = 0,
) -> Trajectory:
    """Simulate as ``simulate_cascade`` does, with the single loop."""
    rig, x, u_A, u_B, m = _at_rest(parameters, tuning.decoupler, float(q_ref[0]), float(S_ref[0]))
    controller = baselines.initialize_single_loop(tuning, u_A, u_B, m)
    line, out = empty_arrays(q_ref.size)
    inputs = make_closed_loop_inputs(parameters, q_ref, S_ref, F_push, seed)
    return make_trajectory(out, _single_loop(rig, tuning, x, controller, inputs, line, out))


def run_feedback_linearization(
    parameters: PlantParameters,
    tuning: baselines.FeedbackLinearizationTuning,
    q_ref: Array,
    S_ref: Array,
    F_push: Array | None = None,
    seed: int = 0,
) -> Trajectory:
    """Simulate as ``simulate_cascade`` does, with feedback linearization."""
    rig, x, u_A, u_B, m = _at_rest(parameters, tuning.decoupler, float(q_ref[0]), float(S_ref[0]))
    controller = baselines.initialize_feedback_linearization(tuning, u_A, u_B, m)
    line, out = empty_arrays(q_ref.size)
    inputs = make_closed_loop_inputs(parameters, q_ref, S_ref, F_push, seed)
    return make_trajectory(out, _feedback_linearization(rig, tuning, x, controller, inputs, line, out))


def _at_rest(
    parameters: PlantParameters, d: Decoupler, q_ref: float, S_ref: float
) -> tuple[SimulatedRig, PlantState, float, float, Measurement]:
    rig = make_simulated_rig(parameters)
    x, u_A, u_B = rest_state(rig, *decoupler.motor_positions(d, q_ref, S_ref))
    return rig, x, u_A, u_B, Measurement(x.q, x.theta_A, x.theta_B, 0.0, 0.0, 0.0, 0.0, 0.0)
