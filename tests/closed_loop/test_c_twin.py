"""The C twin that the bench measures against still computes what the offline closed loop computes."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from backend.control.decoupler import Envelope
from backend.tuning import closed_loop
from backend.tuning.gains import cascade_tuning
from backend.tuning.models import Lambdas
from plant.parameters import load_parameters
from tests.bench.c_twin import CTwin


@pytest.mark.skipif(shutil.which("gcc") is None, reason="the twin is compiled by gcc")
@pytest.mark.parametrize("name", ["ideal", "lab"])
@pytest.mark.parametrize("pushed_N", [5.0, 30.0])
def test_same_trajectory(name: str, pushed_N: float, tmp_path: Path) -> None:
    parameters = load_parameters(name)
    tuning = cascade_tuning(parameters, Lambdas())._replace(u_max=4.0)
    # The twin has the paper's law alone: no dead zones at rest (decision 0053).
    tuning = tuning._replace(following=tuning.following._replace(unseen_q=0.0, unseen_S=0.0))
    q_ref, S_ref = np.repeat([-1.0, 1.0, 1.0], 800), np.repeat([10.0, 10.0, 14.0], 800)
    rig = closed_loop.rig_of(parameters)
    x, controller = closed_loop.at_rest(rig, tuning, -1.0, 10.0)
    inputs = closed_loop.inputs_of(parameters, q_ref, S_ref, F_push=np.linspace(0.0, pushed_N, q_ref.size), seed=7)
    line, mine = closed_loop.empty_arrays(q_ref.size)
    other, unlimited = np.full_like(mine, np.nan), np.full_like(mine, np.nan)
    closed_loop.simulate(rig, tuning, x, controller, inputs, line, mine)
    CTwin(tmp_path, ["-O2"]).simulate(rig, tuning, x, controller, inputs, other)
    u_A = mine[:, closed_loop.COLUMNS.index("u_A")]
    assert np.max(np.abs(u_A)) == 4.0, "the anti-windup has to act for this to mean anything"
    without = tuning._replace(envelope=Envelope(-1e3, 1e3, 1e3))
    closed_loop.simulate(rig, without, x, controller, inputs, line, unlimited)
    assert np.array_equal(mine, unlimited) == (pushed_N < 10.0), "only the strong push has to reach the envelope"
    assert other == pytest.approx(mine, abs=1e-9)
