"""A loop that the card's clock paces: a wiring that asks for hardware timing, a card that offers it, and one that not.

The clock is driven here by those who wait for it, so nothing depends on the machine's own.
"""

from dataclasses import replace

import numpy as np
import pytest

from backend.realtime.channel import Channel, channel_pair
from backend.realtime.control_loop import Loop
from backend.realtime.process import Worker
from backend.realtime.program import SetTuning
from backend.realtime.ring_buffer import Ring
from backend.realtime.timing import Pacer
from backend.sample import INDEX
from plant import virtual_daq
from plant.parameters import PlantParameters
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from plant.wiring import load_wiring

SHIPPED = load_wiring("pcie-6323")
HARDWARE = replace(SHIPPED, card=replace(SHIPPED.card, timing="hardware"))
TICKS, PAUSED_AT, PAUSE_NS = 1000, 500, 3_400_000


class Clock:
    """Stands where nobody waits; ``paused_at`` that wait the whole machine pauses."""

    def __init__(self) -> None:
        self.now_ns = 0
        self.waits = 0

    def monotonic(self) -> float:
        return self.now_ns * 1e-9

    def sleep(self, seconds: float) -> None:
        self.waits += 1
        self.now_ns += round(seconds * 1e9) + (PAUSE_NS if self.waits == PAUSED_AT else 0)


def test_the_cards_clock_paces_the_loop(
    ideal: PlantParameters, tuning: SetTuning, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = Clock()
    monkeypatch.setattr(virtual_daq, "time", clock)
    plant = VirtualRig(HARDWARE, Simulator(ideal, 0), has_clock=True)
    service, theirs = channel_pair()
    ring = Ring.create()
    loop = Loop(plant, ideal, ring, tuning)
    assert plant.paces_loop
    assert plant.description == "virtual card, pcie-6323 as Dev1, timed by the card's clock"
    worker = Worker(plant, loop, Channel(theirs))

    def seen_s() -> float:
        if ring.count == TICKS:
            worker.terminate()
        return clock.monotonic()

    def never(_deadline_ns: int) -> None:
        raise AssertionError("two clocks pace the loop")

    begun_ns = clock.now_ns
    worker.run(Pacer(1e-3, lambda: clock.now_ns, never), seen_s)
    _, rows, _ = ring.read(0, ring.count)
    late_ms, overruns = 1e3 * rows[:, INDEX["lateness_s"]], rows[:, INDEX["overruns"]]
    told = int(np.argmax(late_ms > 0.5))
    # 1 kHz by the card's clock: a tick a millisecond, and those missing that the pause took.
    assert (clock.now_ns - begun_ns) * 1e-6 == pytest.approx(ring.count + overruns[-1], abs=1.5)
    assert late_ms[told] == pytest.approx(PAUSE_NS * 1e-6, abs=1e-3)
    assert PAUSED_AT - 3 <= told <= PAUSED_AT + 3
    assert overruns[told - 1] == 0
    assert overruns[-1] == PAUSE_NS // 1_000_000
    assert np.delete(late_ms, [told]).max() < 1e-3
    loop.close()
    service.close()


def test_without_a_clock_at_the_card_this_machine_keeps_the_time_and_says_so(ideal: PlantParameters) -> None:
    plant = VirtualRig(HARDWARE, Simulator(ideal, 0), has_clock=False)
    plant.open()
    assert not plant.paces_loop
    assert "timed by this machine: the card offers no hardware-timed single point" in plant.description
    plant.close()
    asked_for_less = VirtualRig(SHIPPED, Simulator(ideal, 0), has_clock=True)
    asked_for_less.open()
    assert not asked_for_less.paces_loop
    assert "timed by this machine, on demand" in asked_for_less.description
    asked_for_less.close()
