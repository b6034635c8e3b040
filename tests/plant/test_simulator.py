"""The simulated rig: its sensors, its converters and its safety module."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from plant.dynamics import AT_REST, PlantState, tendon_tension
from plant.interface import ZERO_VOLTS, MotorCommand, PlantError
from plant.parameters import PlantParameters
from plant.simulator import Simulator, quantize
from tests.refusals import refused

# Encoders, load cells and converters of the simulated rig, seen through its interface.

STANDING = PlantState(0.0, 0.0, 3.0, 0.0, 0.0, 3.0, 0.0, 0.0)


def with_sensors(parameters: PlantParameters, **entries: float) -> PlantParameters:
    return replace(parameters, sensors=replace(parameters.sensors, **entries))


@given(st.floats(-10.0, 10.0), st.sampled_from([2.0 * np.pi / 4000, 2.0 * np.pi / 8000, 20.0 / 2**16]))
def test_quantization_is_the_nearest_multiple(value: float, step: float) -> None:
    counts = quantize(value, step) / step
    assert counts == pytest.approx(round(counts), abs=1e-9)
    assert abs(quantize(value, step) - value) <= 0.5 * step * (1.0 + 1e-9)


def test_encoders_read_whole_counts_of_their_own_resolution(ideal: PlantParameters) -> None:
    parameters = with_sensors(ideal, joint_counts=4000, motor_counts=8000)
    x = AT_REST._replace(q=0.12345, theta_A=1.23456, theta_B=-0.98765)
    m = Simulator(parameters, x=x).read()
    for seen, true, counts in ((m.q, x.q, 4000), (m.theta_A, x.theta_A, 8000), (m.theta_B, x.theta_B, 8000)):
        count = seen * counts / (2.0 * np.pi)
        assert count == pytest.approx(round(count), abs=1e-9)
        assert abs(seen - true) <= np.pi / counts
        assert seen != true


def test_ideal_sensors_read_the_state_itself(ideal: PlantParameters) -> None:
    x = AT_REST._replace(q=0.12345, theta_A=4.23456, theta_B=3.98765)
    m = Simulator(ideal, x=x).read()
    assert (m.q, m.theta_A, m.theta_B) == (x.q, x.theta_A, x.theta_B)
    r_m, r_j = ideal.geometry.r_m, ideal.geometry.r_j
    spring = ideal.make_dynamics().spring_A
    assert tendon_tension(spring, r_m * x.theta_A - r_j * x.q) == m.F_A
    assert tendon_tension(spring, r_m * x.theta_B + r_j * x.q) == m.F_B


@pytest.mark.parametrize("delay_ms", [0, 1, 12, 60])
def test_load_cells_lag_by_exactly_their_delay(ideal: PlantParameters, delay_ms: int) -> None:
    late = Simulator(with_sensors(ideal, force_delay=1e-3 * delay_ms), x=STANDING)
    prompt = Simulator(ideal, x=STANDING)
    seen, true = [], []
    for _ in range(200):
        seen.append(late.read().F_A)
        true.append(prompt.read().F_A)
        for simulator in (late, prompt):
            simulator.write(MotorCommand(6.0, 2.0))
    assert len(set(true)) == 200
    assert seen[delay_ms:] == true[: 200 - delay_ms]
    assert seen[: delay_ms + 1] == [true[0]] * (delay_ms + 1)


def test_load_cell_noise_has_its_standard_deviation_and_no_memory(ideal: PlantParameters) -> None:
    simulator = Simulator(with_sensors(ideal, force_noise=0.05), seed=3)
    noise = np.empty((8_000, 2))
    for row in noise:
        m = simulator.read()
        row[:] = m.F_A, m.F_B
        simulator.write(ZERO_VOLTS)
    assert noise.std(axis=0) == pytest.approx(0.05, rel=0.04)
    assert noise.mean(axis=0) == pytest.approx(0.0, abs=5 * 0.05 / np.sqrt(8_000))
    lagged = np.corrcoef(noise[1:, 0], noise[:-1, 0])[0, 1]
    between = np.corrcoef(noise[:, 0], noise[:, 1])[0, 1]
    assert max(abs(lagged), abs(between)) < 5 / np.sqrt(8_000)


def test_load_cells_have_16_bit_steps_over_twice_the_limit_on_either_side(ideal: PlantParameters) -> None:
    """±100 N in 65536 steps: no reading between two steps (a finer cell), and none left out (a coarser one)."""
    step = 200.0 / 2**16
    parameters = with_sensors(ideal, converter_bits=16)
    spring, r_m = ideal.make_dynamics().spring_A, ideal.geometry.r_m
    angles = 3.0 + np.arange(400) * 2e-4
    seen = np.array([Simulator(parameters, x=STANDING._replace(theta_A=angle)).read().F_A for angle in angles])
    true = np.array([tendon_tension(spring, r_m * angle) for angle in angles])
    steps = seen / step
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    assert np.max(np.abs(seen - true)) <= 0.5 * step * (1.0 + 1e-9)
    assert set(np.diff(np.unique(np.round(steps)))) == {1.0}
    assert np.unique(seen).size > 100


def test_a_seed_determines_the_run(lab: PlantParameters) -> None:
    def forces(seed: int) -> list[float]:
        simulator = Simulator(lab, seed=seed, x=STANDING)
        seen = []
        for _ in range(50):
            seen.append(simulator.read().F_A)
            simulator.write(MotorCommand(3.0, 3.0))
        return seen

    assert forces(1) == forces(1)
    assert forces(1) != forces(2)


def test_converters_round_the_voltage_to_16_bits_and_clip_it_to_10_V(ideal: PlantParameters) -> None:
    parameters = with_sensors(ideal, converter_bits=16)
    step = 20.0 / 2**16

    def after(u: float, given: PlantParameters) -> PlantState:
        simulator = Simulator(given, x=STANDING)
        simulator.write(MotorCommand(u, -u))
        return simulator.x

    assert after(1.0003, parameters) == after(round(1.0003 / step) * step, ideal)
    assert after(1.0003, parameters) != after(1.0003, ideal)
    assert after(37.0, ideal) == after(10.0, ideal)


def test_a_push_acts_at_r_j_towards_positive_q_and_is_reported(ideal: PlantParameters) -> None:
    simulator = Simulator(ideal, x=STANDING)
    simulator.push(2.0)
    simulator.write(ZERO_VOLTS)
    # From rest and in balance, J_j q' = r_j F_push t for a time much shorter than J_j/B_j.
    expected = ideal.geometry.r_j * 2.0 * 1e-3 / ideal.geometry.J_j
    assert simulator.x.q_dot == pytest.approx(expected, rel=0.06)
    assert simulator.read().F_push == 2.0


# The independent safety module: cuts at its bounds, by its own sensors, and stays tripped until acknowledged.

FULL = MotorCommand(10.0, 10.0)
STANDING_SAFETY = PlantState(0.0, 0.0, 5.0, 0.0, 0.0, 5.0, 0.0, 0.0)


def drive_until_tripped(simulator: Simulator, command: MotorCommand) -> None:
    for _ in range(3000):
        simulator.write(command)
        if simulator.read().safety_trip:
            return
    pytest.fail("the safety module never tripped")


def test_excessive_tension_disables_the_motors_permanently(ideal: PlantParameters) -> None:
    simulator = Simulator(ideal, x=STANDING_SAFETY)
    drive_until_tripped(simulator, FULL)
    assert 50.0 < simulator.read().F_A < 75.0
    driven, cut = simulator.x, Simulator(ideal, x=simulator.x)
    for _ in range(200):
        simulator.write(FULL)
        cut.write(MotorCommand(0.0, 0.0))
    assert simulator.x == cut.x
    assert simulator.x.theta_A < driven.theta_A + 3.0
    for _ in range(3000):
        simulator.write(FULL)
    assert simulator.read().F_A < 20.0  # far below the bound that tripped it
    assert simulator.read().safety_trip == 1.0


def test_acknowledgement_is_rejected_until_the_cause_is_gone(ideal: PlantParameters) -> None:
    simulator = Simulator(ideal, x=STANDING_SAFETY)
    drive_until_tripped(simulator, FULL)
    with refused(PlantError, "limit_still_exceeded"):
        simulator.acknowledge()
    assert simulator.read().safety_trip == 1.0
    for _ in range(1500):
        simulator.write(FULL)
    simulator.acknowledge()
    assert simulator.read().safety_trip == 0.0
    before = simulator.x.tau_A
    simulator.write(FULL)
    assert simulator.x.tau_A > before


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_joint_beyond_its_range_trips_on_either_side(ideal: PlantParameters, side: float) -> None:
    q_max = ideal.geometry.q_max
    for q, trip in ((side * (q_max - 0.01), 0.0), (side * (q_max + 0.01), 1.0)):
        wound = ideal.geometry.r_j / ideal.geometry.r_m * q
        simulator = Simulator(ideal, x=STANDING_SAFETY._replace(q=q, theta_A=5.0 + wound, theta_B=5.0 - wound))
        simulator.write(MotorCommand(0.0, 0.0))
        assert simulator.read().safety_trip == trip


def test_the_safety_module_uses_its_own_force_sensor_not_the_delayed_load_cell(ideal: PlantParameters) -> None:
    slow = replace(ideal, sensors=replace(ideal.sensors, force_delay=0.060))
    simulator = Simulator(slow, x=STANDING_SAFETY)
    drive_until_tripped(simulator, FULL)
    assert simulator.read().F_A < 50.0
