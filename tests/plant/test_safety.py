"""The independent safety module: cuts at its bounds, by its own sensors, and stays tripped until acknowledged."""

from dataclasses import replace

import pytest

from plant.dynamics import PlantState
from plant.interface import MotorCommand, PlantError
from plant.parameters import PlantParameters
from plant.simulator import Simulator

FULL = MotorCommand(10.0, 10.0)
STANDING = PlantState(0.0, 0.0, 5.0, 0.0, 0.0, 5.0, 0.0, 0.0)


def drive_until_tripped(simulator: Simulator, command: MotorCommand) -> None:
    for _ in range(3000):
        simulator.write(command)
        if simulator.read().safety_trip:
            return
    pytest.fail("the safety module never tripped")


def test_too_much_tension_cuts_the_motors_and_stays_cut(ideal: PlantParameters) -> None:
    simulator = Simulator(ideal, x=STANDING)
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


def test_acknowledging_is_refused_until_the_cause_is_gone(ideal: PlantParameters) -> None:
    simulator = Simulator(ideal, x=STANDING)
    drive_until_tripped(simulator, FULL)
    with pytest.raises(PlantError, match="still out of bounds"):
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
def test_joint_beyond_its_range_trips_on_either_side(ideal: PlantParameters, side: float) -> None:
    q_max = ideal.geometry.q_max
    for q, trip in ((side * (q_max - 0.01), 0.0), (side * (q_max + 0.01), 1.0)):
        wound = ideal.geometry.r_j / ideal.geometry.r_m * q
        simulator = Simulator(ideal, x=STANDING._replace(q=q, theta_A=5.0 + wound, theta_B=5.0 - wound))
        simulator.write(MotorCommand(0.0, 0.0))
        assert simulator.read().safety_trip == trip


def test_it_trusts_its_own_force_sensor_not_the_delayed_load_cell(ideal: PlantParameters) -> None:
    slow = replace(ideal, sensors=replace(ideal.sensors, force_delay=0.060))
    simulator = Simulator(slow, x=STANDING)
    drive_until_tripped(simulator, FULL)
    assert simulator.read().F_A < 50.0
