"""What must not be in the loop is a trip at zero volts, told and recorded; that loop is not reset."""

import math
from collections.abc import Callable

import pytest

from backend.control import NO_EVENT
from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import Accepted, Refused, Reset, SetMode, SetReferences, Stop, Stopped
from backend.realtime.modes import Mode
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from plant.interface import MotorCommand
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.docs.faults_page import documented_ms
from tests.realtime.bench_top import BenchTop


class Written(Simulator):
    """Keeps what was written last."""

    last = MotorCommand(0.0, 0.0)

    def write(self, command: MotorCommand) -> None:
        self.last = command
        super().write(command)


@pytest.fixture(scope="module")
def lab() -> PlantParameters:
    return load_parameters("lab")


@pytest.fixture
def moving(lab: PlantParameters) -> BenchTop:
    bench = BenchTop(lab, plant=Written(lab))
    bench.run()
    bench.send(SetReferences(0.5, 11.0))
    bench.advance(0.1)
    assert abs(last(bench).u_A) > 0.1
    return bench


def last(bench: BenchTop) -> MotorCommand:
    assert isinstance(bench.plant, Written)
    return bench.plant.last


def decides(u_A: float, u_B: float) -> Callable[[BenchTop], None]:
    return lambda bench: setattr(bench.loop._step, "compute_control", lambda: (NO_EVENT, u_A, u_B))


def raises(bench: BenchTop) -> None:
    def detect(*_: object) -> int:
        raise ZeroDivisionError("a gain of zero")

    bench.loop._step.detect_faults = detect


def forgets_its_motion(bench: BenchTop) -> None:
    bench.loop._mode_manager.motion = None
    bench.loop._inputs_outdated = True


def trips_without_a_fault(bench: BenchTop) -> None:
    bench.loop._mode_manager.mode = Mode.TRIPPED
    bench.loop._inputs_outdated = True


MISTAKES = [
    decides(math.nan, 1.0),
    decides(1.0, math.inf),
    decides(10.001, 0.0),
    decides(0.0, -11.0),
    raises,
    forgets_its_motion,
]


@pytest.mark.parametrize("spoil", MISTAKES, ids=["nan", "inf", "beyond A", "beyond B", "exception", "no motion"])
def test_a_mistake_in_the_step_is_a_trip_before_a_voltage_is_written(
    moving: BenchTop, spoil: Callable[[BenchTop], None]
) -> None:
    spoil(moving)
    rows = len(moving.samples.rows)
    moving.advance(documented_ms(Fault.INTERNAL_ERROR) * 1e-3)
    assert (moving.loop.mode, moving.loop.fault) == (Mode.TRIPPED, Fault.INTERNAL_ERROR)
    assert last(moving) == MotorCommand(0.0, 0.0)
    moving.advance(0.1)
    assert len(moving.samples.rows) == rows + 101  # it goes on recording
    assert set(moving.column("fault", 101)) == {float(FAULT_CODE[Fault.INTERNAL_ERROR])}
    assert set(moving.column("u_A", 101)) == set(moving.column("u_B", 101)) == {0.0}
    (stopped,) = [event for event in moving.events if isinstance(event, Stopped)]
    assert (stopped.fault, stopped.hard) == (Fault.INTERNAL_ERROR, True)
    assert isinstance(moving.send(Reset()), Refused)
    assert isinstance(moving.send(SetMode(Mode.PRETENSION)), Refused)
    assert moving.loop.mode is Mode.TRIPPED


def test_a_loop_that_is_tripped_without_a_fault_is_not_reset(moving: BenchTop) -> None:
    trips_without_a_fault(moving)
    moving.advance(0.001)
    assert (moving.loop.fault, last(moving)) == (Fault.INTERNAL_ERROR, MotorCommand(0.0, 0.0))
    assert isinstance(moving.send(Reset()), Refused)


def test_a_mistake_after_another_trip_takes_its_place_so_that_reset_starts_a_new_loop(moving: BenchTop) -> None:
    moving.send(Stop(Fault.STOP_PRESSED))
    moving.advance(0.01)
    assert moving.loop.fault is Fault.STOP_PRESSED
    raises(moving)
    moving.advance(0.002)
    assert moving.column("fault", 1)[0] == FAULT_CODE[Fault.INTERNAL_ERROR]
    told = [event.fault for event in moving.events if isinstance(event, Stopped)]
    assert told == [Fault.STOP_PRESSED, Fault.INTERNAL_ERROR]


def test_a_command_that_fails_is_refused_and_trips(moving: BenchTop, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise KeyError("S_ref")

    monkeypatch.setattr(moving.loop._mode_manager, "set_references", fail)
    refused = moving.send(SetReferences(0.2, 11.0))
    assert isinstance(refused, Refused)
    assert "KeyError" in refused.reason
    moving.advance(0.001)
    assert (moving.loop.fault, last(moving)) == (Fault.INTERNAL_ERROR, MotorCommand(0.0, 0.0))


def test_a_ring_that_another_process_spoils_is_a_trip(lab: PlantParameters) -> None:
    bench = BenchTop(lab, plant=Written(lab))
    ring = bench.loop._ring = Ring.create(1000)
    bench.run()
    assert abs(last(bench).u_A) > 0.1
    count = ring.count
    ring._header[3] = 0
    bench.advance(documented_ms(Fault.INTERNAL_ERROR) * 1e-3)
    assert (bench.loop.fault, last(bench)) == (Fault.INTERNAL_ERROR, MotorCommand(0.0, 0.0))
    bench.advance(0.1)
    assert ring.count == count + 101
    newest = ring.newest()
    assert newest is not None
    assert newest[INDEX["fault"]] == FAULT_CODE[Fault.INTERNAL_ERROR]
    ring.close()


def test_every_move_between_modes_leaves_a_consistent_machine(lab: PlantParameters) -> None:
    bench = BenchTop(lab)
    bench.run()
    for mode in (Mode.PRETENSION, Mode.RUN, Mode.STOPPING):
        assert isinstance(bench.send(SetMode(mode)), Accepted)
        bench.loop._mode_manager.require_consistent()
        bench.advance(0.5)
        bench.loop._mode_manager.require_consistent()
    assert bench.loop.fault is Fault.NONE
