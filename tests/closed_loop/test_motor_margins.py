"""M_s and margins of the motor loop as they are shown, against what the product's own I-PD does on the simulator."""

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.control import pid
from backend.tuning.gains import make_motor_loops, motor_model
from backend.tuning.robustness import motor_robustness
from plant.interface import MotorCommand, T_s
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator

SINES = np.geomspace(12.0, 160.0, 18).reshape(-1, 2)
"""Frequencies [rad/s] at which motor A and motor B are tried; slack tendons keep them strangers."""

AMPLITUDE = 0.02 / len(SINES)


@pytest.fixture(scope="module")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


def readings(
    parameters: PlantParameters, gains: pid.MotorPairGains, errors: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What the encoders say (ticks, 2) [rad] while ``errors`` (ticks, 2) are added; slack tendons, reference 0."""
    simulator, state = Simulator(parameters), pid.at_rest_motor_pair(gains, 0.0, 0.0, 0.0, 0.0)
    read = np.empty_like(errors)
    for k, (error_A, error_B) in enumerate(errors):
        m = simulator.read()
        read[k] = m.theta_A + error_A, m.theta_B + error_B
        y, state = pid.step_motor_pair(gains, state, 0.0, 0.0, read[k, 0], read[k, 1], parameters.motor.u_max)
        assert y.excess_A == y.excess_B == 0.0, "a clipped voltage measures nothing"
        simulator.write(MotorCommand(y.u_A, y.u_B))
    return read


@pytest.mark.parametrize("lam", [0.05, 0.065, 0.0854, 0.11, 0.15])
def test_M_s_is_how_much_of_a_sine_on_the_encoder_stays(ideal: PlantParameters, lam: float) -> None:
    gains, settled = make_motor_loops(ideal, lam), round(12.0 * lam / T_s)
    t = np.arange(settled + 1600) * T_s
    sines = np.sin(SINES[:, :, np.newaxis] * t)
    read = readings(ideal, gains, AMPLITUDE * sines.sum(axis=0).T)[settled:]
    measured = 0.0
    for motor in (0, 1):
        angle = np.outer(t[settled:], SINES[:, motor])
        waves = np.linalg.lstsq(np.hstack([np.sin(angle), np.cos(angle)]), read[:, motor])[0].reshape(2, -1)
        measured = max(measured, float(np.max(np.hypot(*waves))) / AMPLITUDE)
    assert motor_robustness(motor_model(ideal, "A"), gains.A).M_s == pytest.approx(measured, rel=0.01)


@pytest.mark.parametrize("lam", [0.05, 0.0854, 0.15])
def test_the_loop_bears_as_much_gain_as_is_shown_and_no_more(ideal: PlantParameters, lam: float) -> None:
    law = make_motor_loops(ideal, lam).A
    margin = motor_robustness(motor_model(ideal, "A"), law).gain_margin
    assert grows(ideal, times(law, 1.05 * margin), 0.9)
    assert not grows(ideal, times(law, 0.95 * margin), 0.9)


def test_a_conditionally_stable_loop_bears_as_little_gain_as_is_shown_and_no_less(ideal: PlantParameters) -> None:
    law = make_motor_loops(ideal, 0.05).A
    least = motor_robustness(motor_model(ideal, "A"), law).gain_reduction
    assert grows(ideal, times(law, 0.7 * least), 7.5)
    assert not grows(ideal, times(law, 1.4 * least), 7.5)
    assert motor_robustness(motor_model(ideal, "A"), make_motor_loops(ideal, 0.0854).A).gain_reduction == 0.0


def times(law: pid.IPDGains, factor: float) -> pid.IPDGains:
    return pid.IPDGains(factor * law.k_p, factor * law.k_i, factor * law.k_d, law.t_f)


def grows(parameters: PlantParameters, law: pid.IPDGains, duration_s: float) -> bool:
    """Whether what an error of 1e-9 rad in the first reading sets off has grown by the last third."""
    errors = np.zeros((3 * round(duration_s / 3.0 / T_s), 2))
    errors[0] = 1e-9
    _, middle, last = np.split(np.abs(readings(parameters, pid.MotorPairGains(law, law), errors)), 3)
    return float(last.max()) > float(middle.max())
