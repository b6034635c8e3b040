"""The offline closed loop with true states, which resolve motion at rest."""

import math
from typing import NamedTuple

import numpy as np

from backend.control import cascade
from backend.control.trajectory import LoopReferences
from backend.tuning.simulation import (
    Array,
    ClosedLoopInputs,
    SimulatedRig,
    at_rest,
    empty_arrays,
    fill_delay_line,
    make_closed_loop_inputs,
    make_simulated_rig,
)
from plant.compilation import compiled_run
from plant.dynamics import PlantState
from plant.interface import MotorCommand
from plant.parameters import PlantParameters
from plant.simulator import DELAY_SLOTS, actuate_plant, sense_state


class TrueStates(NamedTuple):
    """Columns (ticks,) in rad, N·m/rad and V, none of them quantized."""

    q: Array
    S: Array
    theta_A: Array
    theta_B: Array
    u_A: Array
    u_B: Array


@compiled_run
def _simulate(
    rig: SimulatedRig,
    tuning: cascade.CascadeTuning,
    x: PlantState,
    law: cascade.CascadeState,
    inputs: ClosedLoopInputs,
    line: Array,
    out: Array,
) -> None:
    fill_delay_line(rig, x, line)
    for k in range(inputs.q_ref.shape[0]):
        noise, F_push = inputs.noise[k], inputs.F_push[k]
        m = sense_state(rig.plant, rig.sensors, x, line, k + DELAY_SLOTS, noise[0], noise[1], F_push, 0.0)
        r = LoopReferences(inputs.q_ref[k], inputs.S_ref[k], math.nan, math.nan)
        y, law = cascade.step(tuning, law, r, True, m)
        row = out[k]
        row[0], row[1], row[2], row[3], row[4], row[5] = x.q, m.S_true, x.theta_A, x.theta_B, y.u_A, y.u_B
        x = actuate_plant(rig.plant, rig.sensors, rig.u_max, x, MotorCommand(y.u_A, y.u_B), F_push)


def run(
    parameters: PlantParameters, tuning: cascade.CascadeTuning, q_ref: Array, S_ref: Array, F_push: Array | None = None
) -> TrueStates:
    """Simulate as ``simulate_cascade`` does, but without the safety module."""
    rig = make_simulated_rig(parameters)
    x, law = at_rest(rig, tuning, float(q_ref[0]), float(S_ref[0]))
    line, _ = empty_arrays(0)
    out = np.empty((q_ref.size, len(TrueStates._fields)))
    _simulate(rig, tuning, x, law, make_closed_loop_inputs(parameters, q_ref, S_ref, F_push), line, out)
    return TrueStates(*out.T)
