"""Sides that differ, springs of other kinds: identified as they are, they are controlled as well as the paper's."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backend.tuning.gains import TuningParameters, make_cascade_tuning
from backend.tuning.simulation import simulate_cascade
from plant.parameters import PlantParameters, load_parameters

HOLD = 6000
CUBIC: dict[str, Any] = {"k": (-2.0, 300.0, 7000.0, 40_000.0), "points": ()}
_curve = np.polynomial.Polynomial((-2.498, 331.49, 8543.8))
_x = np.linspace(float(np.max(_curve.roots())), 0.0625, 14)
TABLE: dict[str, Any] = {"k": (), "points": ((float(_x[0]), 0.0), *((float(x), float(_curve(x))) for x in _x[1:]))}
SLOW = {"K_m": 2.5, "T_m": 0.26}


def unlike_sides() -> PlantParameters:
    """The `lab` set with a cubic spring A, a tabulated spring B and a slower motor B, all of it identified."""
    sided = {"spring_A": CUBIC, "identified_A": CUBIC, "spring_B": TABLE, "identified_B": TABLE | SLOW, "motor_B": SLOW}
    return replace(load_parameters("lab"), sided=sided)


def test_steps_of_position_and_stiffness() -> None:
    parameters = unlike_sides()
    tuning = make_cascade_tuning(parameters, TuningParameters())
    q_ref = np.repeat([0.0, np.pi / 3, -np.pi / 3, -np.pi / 3, -np.pi / 3], HOLD)
    S_ref = np.repeat([10.0, 10.0, 10.0, 13.0, 9.0], HOLD)
    trajectory = simulate_cascade(parameters, tuning, q_ref, S_ref)
    assert trajectory.tripped_at == -1
    assert min(trajectory.F_A.min(), trajectory.F_B.min()) > 5.0
    for k in range(1, 5):
        part = slice(k * HOLD, (k + 1) * HOLD)
        for y, r, resolution in ((trajectory.q, q_ref, 2.0 * np.pi / 4000), (trajectory.S, S_ref, 0.01)):
            height = r[k * HOLD] - r[k * HOLD - 1]
            settled = y[(k + 1) * HOLD - 500 : (k + 1) * HOLD]
            assert settled == pytest.approx(r[k * HOLD], abs=2.0 * resolution)
            if height:
                assert ((y[part] - r[part]) / height).max() < 0.01
    # What the motor angles say of the stiffness is what the springs have.
    assert trajectory.S[HOLD - 1] == pytest.approx(trajectory.S_true[HOLD - 1], abs=0.1)
