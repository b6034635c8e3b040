"""What a virtual card has on its terminals, against numpy and against where the joint stands."""

import math
from dataclasses import replace

import numpy as np
import pytest

from plant.dynamics import PlantState
from plant.interface import ZERO_VOLTS, InjectedFault, InjectedFaultKind, MotorCommand, PlantError, T_s
from plant.parameters import load_parameters
from plant.safety_card import WATCHDOG_S
from plant.simulator import Simulator
from plant.terminals import LoadCellScaling, compute_volts, quantise_volts
from plant.virtual_daq import VirtualRig
from plant.wiring import load_wiring

PARAMETERS = load_parameters("lab")
WIRING = load_wiring("pcie-6323")


def test_a_bent_table_gives_the_volts_of_the_line_between_its_points() -> None:
    """Where the card gives the volts of its own table, against numpy's line through the same points."""
    F, V = (0.0, 5.0, 20.0, 60.0), (0.1, 1.0, 2.0, 9.0)
    cell = LoadCellScaling(math.nan, 0.0, np.column_stack((F, V)))
    for force in np.linspace(0.0, 60.0, 241):
        assert compute_volts(cell, float(force)) == pytest.approx(np.interp(force, F, V), rel=1e-12)
    assert compute_volts(cell, 70.0) == pytest.approx(9.0 + 10.0 * 7.0 / 40.0)
    assert compute_volts(cell, -1.0) == pytest.approx(0.1 - 0.9 / 5.0)


@pytest.mark.parametrize("active", ["high", "low"])
@pytest.mark.parametrize("q", [-0.9, 0.0, 1.1])
def test_the_end_switch_is_read_whichever_level_it_holds(active: str, q: float) -> None:
    wiring = replace(WIRING, end_switch=replace(WIRING.end_switch, active=active, position=1.0))
    slack = -abs(q) * PARAMETERS.geometry.r_j / PARAMETERS.geometry.r_m
    start = PlantState(*Simulator(PARAMETERS).x)._replace(q=q, theta_A=slack, theta_B=slack)
    rig = VirtualRig(wiring, Simulator(PARAMETERS, 0, start))
    rig.open()
    rig.read()
    assert rig.at_end is (q > 1.0)
    rig.close()


def test_a_converter_ends_at_its_first_and_last_code() -> None:
    step = 20.0 / 2**16
    assert (quantise_volts(25.0), quantise_volts(-25.0)) == (10.0 - step, -10.0)
    assert (quantise_volts(10.0), quantise_volts(10.0 - step)) == (10.0 - step, 10.0 - step)
    assert quantise_volts(1.2345) == pytest.approx(1.2345, abs=step / 2)
    assert math.isnan(quantise_volts(math.nan))


def test_a_card_in_stepped_time_that_is_gone_goes_on_with_its_last_volts_until_its_watchdog_expires() -> None:
    rig = VirtualRig(WIRING, Simulator(PARAMETERS, 0))
    rig.open()
    rig.read()
    rig.write(MotorCommand(2.0, 0.0))
    rig.inject(InjectedFault(InjectedFaultKind.DEVICE_GONE))
    driven = 0
    while rig.card_state().drive_enabled and driven < 1000:
        with pytest.raises(PlantError):
            rig.write(ZERO_VOLTS)
        driven += 1
    assert driven * T_s == pytest.approx(WATCHDOG_S, abs=1.5 * T_s)
    rig.close()
