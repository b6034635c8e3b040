"""The bank's schedule: hysteresis while switching, linear in between while interpolating."""

import numpy as np
import pytest

from backend.control.decoupler import HYSTERESIS, Schedule, interpolate_gains, select_entry
from backend.tuning import simulation
from backend.tuning.gains import TuningParameters, make_cascade_tuning
from plant.parameters import load_parameters

NOMINAL = np.array([8.24, 10.55, 12.43, 14.06])
ENTRIES = np.column_stack([NOMINAL] + [10.0 * column + np.arange(4.0) for column in range(1, 7)])


def test_begins_at_the_nearest_entry() -> None:
    switching = Schedule(ENTRIES, interpolate=False)
    for S in np.linspace(7.0, 15.0, 161):
        assert select_entry(switching, -1.0, S) == np.argmin(np.abs(NOMINAL - S))


@pytest.mark.parametrize("S", [9.3, 9.5, 11.4, 11.6, 13.2, 13.3])
def test_a_cascade_that_takes_over_begins_at_the_nearest_entry(S: float) -> None:
    parameters = load_parameters("ideal")
    tuning = make_cascade_tuning(parameters, TuningParameters())._replace(schedule=Schedule(ENTRIES, interpolate=False))
    _, state = simulation.at_rest(simulation.make_simulated_rig(parameters), tuning, 0.0, S)
    assert state.active == np.argmin(np.abs(NOMINAL - S))


def test_switches_only_beyond_the_hysteresis() -> None:
    switching = Schedule(ENTRIES, interpolate=False)
    border = 0.5 * (8.24 + 10.55)
    assert select_entry(switching, 0.0, border + HYSTERESIS - 1e-6) == 0.0
    assert select_entry(switching, 0.0, border + HYSTERESIS + 1e-6) == 1.0
    assert select_entry(switching, 1.0, border - HYSTERESIS + 1e-6) == 1.0
    assert select_entry(switching, 1.0, border - HYSTERESIS - 1e-6) == 0.0
    assert select_entry(switching, 0.0, 14.9) == 3.0


def test_each_entry_acts_at_its_own_stiffness_from_wherever_the_bank_comes() -> None:
    """The hysteresis is narrower than the way from a border to an entry of the paper's bank."""
    switching = Schedule(ENTRIES, interpolate=False)
    for entry, S in enumerate(NOMINAL):
        assert [select_entry(switching, float(active), S) for active in range(4)] == [entry] * 4


def test_interpolates_linearly_and_ends_at_the_outer_entries() -> None:
    scheduling = Schedule(ENTRIES, interpolate=True)
    for S in np.linspace(7.0, 15.0, 161):
        place = select_entry(scheduling, -1.0, S)
        assert place == pytest.approx(np.interp(S, NOMINAL, np.arange(4.0)))
        gains_q, gains_S = interpolate_gains(scheduling, place)
        expected = [np.interp(S, NOMINAL, ENTRIES[:, column]) for column in range(1, 7)]
        assert [*gains_q[:1], *gains_q[1:], *gains_S] == pytest.approx(expected)


def test_one_entry_serves_everywhere() -> None:
    for interpolate in (False, True):
        single = Schedule(ENTRIES[1:2], interpolate)
        assert select_entry(single, -1.0, 14.0) == 0.0
        assert select_entry(single, 0.0, 8.0) == 0.0
