"""The loop on a card: faults, its clock and its watchdog."""

import asyncio
import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from backend.control.decoupler import compute_bounds
from backend.faults import FAULT_CODE, Fault
from backend.realtime.channel import Channel, channel_pair
from backend.realtime.commands import (
    Accepted,
    ApplyPush,
    Inject,
    PlantFailing,
    PretensionReached,
    Reset,
    SetMode,
    SetReferences,
    Stopped,
)
from backend.realtime.control_loop import Loop
from backend.realtime.gains import make_tuning_command
from backend.realtime.headless import SimulatedLoop
from backend.realtime.heartbeat import POLL_S, WatchdogMonitor
from backend.realtime.modes import MODE_CODE, Mode
from backend.realtime.process import Worker
from backend.realtime.program import SetTuning
from backend.realtime.ring_buffer import Ring
from backend.realtime.timing import Pacer
from backend.recording.reader import read_samples
from backend.recording.recorder import Recorder
from backend.sample import INDEX
from backend.storage import recordings
from backend.storage.database import Database, open_database
from backend.storage.runs import EndState
from backend.tuning.gains import TuningParameters
from plant import messages, virtual_daq
from plant.interface import ONLY_OF_A_CARD, InjectedFault, InjectedFaultKind, Sensor
from plant.parameters import PlantParameters, load_parameters
from plant.safety_card import WATCHDOG_S, Card, CardState
from plant.simulator import Simulator
from plant.virtual_daq import VirtualRig
from plant.wiring import load_wiring
from tests.docs.faults_page import documented_ms
from tests.reasons import Reason, TextWith
from tests.recording.stand_in import new_run, stored_run

# Whatever breaks of a card or its wires in run ends in zero volts, drives off, a named fault and a whole recording.
#
# The real client of NI-DAQmx talks to the virtual card, stepped as fast as it goes.

LAB = load_parameters("lab")
AT_ONCE = 2
"""Ticks from what breaks to a reaction that needs no motion."""

AFTER_TICKS = 600
"""What follows is looked at for so long: more than the card's watchdog waits."""

CASES = [
    (InjectedFault(InjectedFaultKind.DEVICE_GONE), Fault.PLANT_ERROR, TextWith("-201003"), AT_ONCE),
    (InjectedFault(InjectedFaultKind.BUFFER_OVERRUN), Fault.PLANT_ERROR, TextWith("-200222"), AT_ONCE),
    (InjectedFault(InjectedFaultKind.LOST_SAMPLE), Fault.PLANT_ERROR, TextWith("-200279"), AT_ONCE),
    (
        InjectedFault(InjectedFaultKind.STUCK, Sensor.F_A),
        Fault.SENSOR_STUCK,
        Reason("load_cell_stuck", load_cell="F_A"),
        1000,
    ),
    (
        InjectedFault(InjectedFaultKind.STUCK, Sensor.THETA_B),
        Fault.SENSOR_STUCK,
        Reason("motor_encoder_stuck", encoder="theta_B"),
        1000,
    ),
    (
        InjectedFault(InjectedFaultKind.NO_NUMBER, Sensor.F_B),
        Fault.SENSOR_INVALID,
        Reason("sensors_without_reading", sensors=("F_B",)),
        AT_ONCE,
    ),
    (
        InjectedFault(InjectedFaultKind.NO_NUMBER, Sensor.THETA_A),
        Fault.SENSOR_INVALID,
        Reason("sensors_without_reading", sensors=("theta_A",)),
        AT_ONCE,
    ),
    (
        InjectedFault(InjectedFaultKind.SATURATION, Sensor.F_A),
        Fault.SENSOR_SATURATED,
        Reason("load_cells_saturated", voltages={"F_A": pytest.approx(10.0, abs=0.005)}),
        AT_ONCE,
    ),
    (
        InjectedFault(InjectedFaultKind.LOST_COUNTS, Sensor.Q),
        Fault.IMPLAUSIBLE,
        Reason("tension_unlike_encoders"),
        1500,
    ),
    (
        InjectedFault(InjectedFaultKind.LOST_COUNTS, Sensor.THETA_A),
        Fault.IMPLAUSIBLE,
        Reason("tension_unlike_encoders"),
        1500,
    ),
    (
        InjectedFault(InjectedFaultKind.SWAPPED_LOAD_CELLS),
        Fault.IMPLAUSIBLE,
        Reason("tension_unlike_encoders", load_cell="F_B"),
        2000,
    ),
    (
        InjectedFault(InjectedFaultKind.SWAPPED_ENCODERS),
        Fault.MOTOR_REVERSED,
        Reason("motor_reversed"),
        1000,
    ),
    (InjectedFault(InjectedFaultKind.SWAPPED_MOTORS), Fault.MOTOR_REVERSED, Reason("motor_reversed"), 400),
]


class Session:
    """A recorded run on the virtual card, in motion over most of the range."""

    def __init__(self, database: Database) -> None:
        self.simulator = Simulator(LAB, seed=3)
        self.rig = VirtualRig(load_wiring("pcie-6323"), self.simulator)
        self.loop = SimulatedLoop(self.rig, LAB, make_tuning_command(LAB, TuningParameters()), self._record)
        self.recorder = Recorder(database, self.loop.ring)
        self.loop.listen(self.recorder.on_event)
        self.stops: list[Stopped] = []
        self.failing: list[PlantFailing] = []
        self.reached: list[object] = []
        self.loop.listen(self._hear)
        self.run = new_run(database).id

    def _record(self, _ring: Ring) -> None:
        if hasattr(self, "recorder"):
            self.recorder.drain()

    def _hear(self, event: object) -> None:
        if isinstance(event, Stopped):
            self.stops.append(event)
        if isinstance(event, PlantFailing):
            self.failing.append(event)
        if isinstance(event, PretensionReached):
            self.reached.append(event)

    async def begin(self) -> None:
        await self.loop.send(SetMode(Mode.PRETENSION))
        await self.loop.advance_until(lambda: bool(self.reached), timeout_s=20.0)
        assert isinstance(await self.loop.send(SetMode(Mode.RUN, run=self.run)), Accepted)
        await self.loop.advance(0.2)
        await self.loop.send(SetReferences(0.9, 11.0))
        await self.loop.advance(0.15)

    def newest(self, name: str) -> float:
        row = self.loop.ring.newest()
        assert row is not None
        return float(row[INDEX[name]])

    def tripped(self) -> bool:
        return self.newest("mode") == MODE_CODE[Mode.TRIPPED]

    def close(self) -> None:
        self.loop.close()
        self.recorder.close()


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    opened = open_database(tmp_path)
    yield opened
    opened.close()


def test_every_card_fault_has_a_case() -> None:
    assert {case[0].kind for case in CASES} >= set(ONLY_OF_A_CARD)


@pytest.mark.parametrize(("broken", "fault", "says", "within"), CASES, ids=lambda value: getattr(value, "words", None))
def test_a_broken_card_ends_in_a_fault_and_zero_volts(
    database: Database, broken: InjectedFault, fault: Fault, says: Reason | TextWith, within: int
) -> None:
    async def session() -> None:
        bench = Session(database)
        await bench.begin()
        injected = bench.loop.ring.count
        assert isinstance(await bench.loop.send(Inject(broken)), Accepted)
        if broken.kind is InjectedFaultKind.SWAPPED_LOAD_CELLS:  # seen once the tendons pull with different force
            assert isinstance(await bench.loop.send(ApplyPush(20.0, 1.0)), Accepted)
        await bench.loop.advance_until(bench.tripped, timeout_s=within * 1e-3)
        latched = bench.loop.ring.count - 1
        assert bench.newest("fault") == FAULT_CODE[fault]
        # Where nothing can be written the card's own watchdog is what ends it.
        await bench.loop.advance(AFTER_TICKS * 1e-3)
        card = bench.rig.card_state()
        assert (card.u_A, card.u_B) == (0.0, 0.0)
        assert card.drive_enabled == (broken.kind is not InjectedFaultKind.DEVICE_GONE)
        # No stop is proven at a card that takes no word: what fails is told instead.
        gone = broken.kind is InjectedFaultKind.DEVICE_GONE
        (told,) = [event.reason for event in bench.failing] if gone else [event.detail for event in bench.stops]
        assert told == says
        assert len(bench.stops) == (not gone)
        assert abs(bench.simulator.x.q) < compute_bounds(LAB).q_trip

        _, rows, _ = bench.loop.ring.read(injected, latched + AFTER_TICKS - injected)
        at_outputs = rows[latched - injected :, [INDEX["u_A"], INDEX["u_B"]]]
        if broken.kind is InjectedFaultKind.DEVICE_GONE:  # it took no zero volts: what it had is shown
            assert np.all(at_outputs == rows[0, [INDEX["u_A"], INDEX["u_B"]]])
            assert np.all(at_outputs != 0.0)
        else:
            assert np.all(at_outputs == 0.0)
        bench.close()
        assert not bench.rig.card_state().drive_enabled
        ended = stored_run(database, bench.run)
        assert (ended.end_state, ended.end_detail.split(":")[0]) == (EndState.TRIPPED, str(fault))
        with database.reading() as reading:
            kept = read_samples(reading, bench.run)
            assert recordings.get(reading, bench.run).missed == 0
        assert kept.first_tick + len(kept.t) >= latched
        assert np.array_equal(np.diff(kept.t) > 0.0, np.ones(len(kept.t) - 1, bool))

    asyncio.run(session())


def test_swapped_motors_are_stopped_before_the_joint_runs_away(database: Database) -> None:
    async def session() -> None:
        bench = Session(database)
        await bench.begin()
        injected = bench.loop.ring.count
        await bench.loop.send(Inject(InjectedFault(InjectedFaultKind.SWAPPED_MOTORS)))
        await bench.loop.advance_until(bench.tripped, timeout_s=2.0)
        _, rows, _ = bench.loop.ring.read(injected, bench.loop.ring.count - injected)
        driven = np.abs(rows[:, INDEX["u_A"]]) > 2.8
        assert len(rows) - int(np.argmax(driven)) <= documented_ms(Fault.MOTOR_REVERSED)
        assert abs(bench.simulator.x.q) < 0.1
        bench.close()

    asyncio.run(session())


def test_a_repaired_card_works_again_after_reset(database: Database) -> None:
    """Also after the watchdog has disabled the drives in the meantime."""

    async def session() -> None:
        bench = Session(database)
        await bench.begin()
        await bench.loop.send(Inject(InjectedFault(InjectedFaultKind.DEVICE_GONE)))
        await bench.loop.advance(AFTER_TICKS * 1e-3)
        assert bench.rig.card_state().expired
        await bench.loop.send(Inject(None))
        await bench.loop.advance(0.01)
        assert isinstance(await bench.loop.send(Reset()), Accepted)
        assert bench.newest("u_A") == 0.0
        assert bench.rig.card_state().drive_enabled
        bench.reached.clear()
        await bench.loop.send(SetMode(Mode.PRETENSION))
        await bench.loop.advance_until(lambda: bool(bench.reached), timeout_s=20.0)
        bench.close()

    asyncio.run(session())


# A loop that the card's clock paces: a wiring that asks for hardware timing, a card that offers it, and one that not.
#
# The clock is driven here by those who wait for it, so nothing depends on the machine's own.

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
    card = messages.wired_card(wiring="pcie-6323", device="Dev1", address="", timing=messages.timed_by_card())
    assert plant.description == messages.virtual_card(card=card)
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


def test_the_system_clock_paces_a_card_without_a_clock_and_is_reported(ideal: PlantParameters) -> None:
    plant = VirtualRig(HARDWARE, Simulator(ideal, 0), has_clock=False)
    plant.open()
    assert not plant.paces_loop
    assert messages.timed_by_machine() in plant.description
    plant.close()
    asked_for_less = VirtualRig(SHIPPED, Simulator(ideal, 0), has_clock=True)
    asked_for_less.open()
    assert not asked_for_less.paces_loop
    assert messages.timed_on_demand() in asked_for_less.description
    asked_for_less.close()


# What the service sees of a card beside the loop: when nobody would take the drives away any more.


class Shown(Card):
    """A card with these registers; its watchdog never looks again."""

    def __init__(self, armed: bool, drive_enabled: bool) -> None:
        self._shown = CardState(1, 7, armed, drive_enabled, False, False, False, False, WATCHDOG_S, 0.0, 0.0)

    def state(self) -> CardState:
        return self._shown


@pytest.mark.parametrize(("armed", "drive_enabled"), [*itertools.product((True, False), repeat=2)])
def test_a_stalled_watchdog_is_lost_only_while_armed_with_enabled_drives(
    armed: bool, drive_enabled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [100.0]
    monkeypatch.setattr("plant.safety_card.time.monotonic", lambda: now_s[0])
    guard = WatchdogMonitor(Shown(armed, drive_enabled))
    looks = 0
    while guard.watchdog_silent_s <= WATCHDOG_S:
        assert not guard.is_watchdog_lost
        guard.poll(loop_ended=False)
        now_s[0] += POLL_S
        looks += 1
        assert looks < 1000
    assert guard.is_watchdog_lost is (armed and drive_enabled)
