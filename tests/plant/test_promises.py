"""How the contract looks at a plant."""

import time

import pytest

from plant.conformance import drive
from plant.interface import ZERO_VOLTS, T_s
from plant.parameters import PlantParameters
from plant.simulator import Simulator


class WithTheClock(Simulator):
    stepped = False


class AtItsOwnPace(Simulator):
    stepped, paces_loop = False, True


@pytest.mark.parametrize(("plant", "waits"), [(Simulator, 0), (AtItsOwnPace, 0), (WithTheClock, 50)])
def test_only_what_moves_with_the_clock_is_waited_for(
    lab: PlantParameters, plant: type[Simulator], waits: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    slept_s: list[float] = []
    monkeypatch.setattr(time, "sleep", slept_s.append)
    drive(plant(lab), ZERO_VOLTS, 50)
    assert len(slept_s) == waits
    assert all(0.0 <= s <= T_s for s in slept_s)
