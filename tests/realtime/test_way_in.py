"""A loop that cannot begin leaves nothing on: zero volts, drives off, and the card free for the next one."""

from dataclasses import replace

import numpy as np
import pytest

from backend.realtime.control_loop import Loop
from backend.realtime.program import SetTuning
from plant.interface import InjectedFault, InjectedFaultKind, Measurement, PlantError
from plant.parameters import PlantParameters
from plant.safety_card import Card
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from plant.wiring import load_wiring
from tests.realtime.bench_top import BenchTop, Samples


def rig_and_card(parameters: PlantParameters) -> VirtualRig:
    return VirtualRig(load_wiring("pcie-6323"), Simulator(parameters, 0))


def test_a_rig_whose_first_reading_fails_is_left_with_its_drives_off(ideal: PlantParameters, tuning: SetTuning) -> None:
    rig = rig_and_card(ideal)
    rig.inject(InjectedFault(InjectedFaultKind.BUFFER_OVERRUN))
    with pytest.raises(PlantError, match="-200222"):
        Loop(rig, ideal, Samples(), tuning)
    assert not rig.card_state().drive_enabled
    rig.inject(None)
    loop = Loop(rig, ideal, Samples(), tuning)  # it was let go of
    assert rig.card_state().drive_enabled
    loop.close()
    loop.close()
    assert not rig.card_state().drive_enabled


def test_a_tuning_that_says_nothing_leaves_the_drives_off(ideal: PlantParameters, tuning: SetTuning) -> None:
    rig = rig_and_card(ideal)
    with pytest.raises(ValueError, match="at least one entry"):
        Loop(rig, ideal, Samples(), replace(tuning, entries=()))
    assert not rig.card_state().drive_enabled


def test_a_plant_that_fails_half_way_into_opening_is_closed(ideal: PlantParameters, tuning: SetTuning) -> None:
    """A plant of a package may not do so by itself."""

    class HalfOpen(Simulator):
        def open(self) -> None:
            card.set_drives(on=True)
            raise PlantError("no second amplifier")

    card = Card.create()
    with pytest.raises(PlantError, match="no second amplifier"):
        Loop(HalfOpen(ideal, card=card), ideal, Samples(), tuning)
    assert not card.drives_on


def test_a_first_angle_that_is_no_number_does_not_take_the_velocity_with_it(ideal: PlantParameters) -> None:
    class Late(Simulator):
        first = True

        def read(self) -> Measurement:
            m = super().read()
            m = m._replace(q=float("nan")) if self.first else m
            self.first = False
            return m

    bench = BenchTop(ideal, plant=Late(ideal))
    bench.advance(0.1)
    assert np.isfinite(bench.column("q_dot")).all()
