"""The bound of the motors on a position step, against the figures of the method and an integrated motor."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backend.tuning.preview import least_reach_time
from plant.parameters import load_parameters

PARAMETERS = load_parameters("ideal")


def test_largest_step_of_the_paper() -> None:
    assert least_reach_time(PARAMETERS, 2.0 * math.pi / 3.0) == pytest.approx(0.875, abs=0.002)


def test_without_lag_speed_alone_counts() -> None:
    quick = replace(PARAMETERS, identified=replace(PARAMETERS.identified, T_m=1e-6))
    assert least_reach_time(quick, 2.0 * math.pi / 3.0) == pytest.approx(0.66, abs=0.002)


@pytest.mark.parametrize("step", [-1.0, 0.3])
def test_a_motor_at_full_voltage_gets_there_just_then(step: float) -> None:
    t = least_reach_time(PARAMETERS, step)
    omega = 28.6 * (1.0 - np.exp(-np.linspace(0.0, t, 100_001) / 0.22))
    turned = float(np.trapezoid(omega, dx=t / 100_000))
    assert turned == pytest.approx(0.9 * abs(step) * 10.0, rel=1e-6)


def test_the_slower_motor_counts() -> None:
    slow = replace(PARAMETERS, sided={"identified_B": {"K_m": 1.43}})
    assert least_reach_time(slow, 1.0) > 1.5 * least_reach_time(PARAMETERS, 1.0)


def test_no_step_takes_no_time() -> None:
    assert least_reach_time(PARAMETERS, 0.0) == 0.0
