"""The C twin that the bench measures against still computes what the offline closed loop computes."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from backend.control.decoupler import Envelope
from backend.tuning import simulation
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from plant.parameters import load_parameters
from tests.bench.c_twin import CTwin


@pytest.mark.skipif(shutil.which("gcc") is None, reason="the twin is compiled by gcc")
@pytest.mark.parametrize("name", ["ideal", "lab"])
@pytest.mark.parametrize("pushed_N", [5.0, 30.0])
def test_same_trajectory(name: str, pushed_N: float, tmp_path: Path) -> None:
    parameters = load_parameters(name)
    tuning = make_cascade_tuning(parameters, TuningParameters())._replace(u_max=4.0)
    # The twin has the paper's law alone: no dead zones at rest (decision 0053).
    tuning = tuning._replace(reference_tracking=tuning.reference_tracking._replace(dead_zone_q=0.0, dead_zone_S=0.0))
    q_ref, S_ref = np.repeat([-1.0, 1.0, 1.0], 800), np.repeat([10.0, 10.0, 14.0], 800)
    rig = simulation.make_simulated_rig(parameters)
    x, controller = simulation.at_rest(rig, tuning, -1.0, 10.0)
    inputs = simulation.make_closed_loop_inputs(
        parameters, q_ref, S_ref, F_push=np.linspace(0.0, pushed_N, q_ref.size), seed=7
    )
    line, mine = simulation.empty_arrays(q_ref.size)
    other, unlimited = np.full_like(mine, np.nan), np.full_like(mine, np.nan)
    simulation.simulate(rig, tuning, x, controller, inputs, line, mine)
    CTwin(tmp_path, ["-O2"]).simulate(rig, tuning, x, controller, inputs, other)
    u_A = mine[:, simulation.COLUMNS.index("u_A")]
    assert np.max(np.abs(u_A)) == 4.0, "the anti-windup has to act for this to mean anything"
    without = tuning._replace(envelope=Envelope(-1e3, 1e3, 1e3))
    simulation.simulate(rig, without, x, controller, inputs, line, unlimited)
    assert np.array_equal(mine, unlimited) == (pushed_N < 10.0), "only the strong push has to reach the envelope"
    assert other == pytest.approx(mine, abs=1e-9)
