"""Faults, limits and broken invariants of the loop: reactions and texts."""

import math
import re
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pytest

from backend.control import NO_EVENT
from backend.control.decoupler import F_SLACK
from backend.control.fault_detection import CLEAR, CONTRADICTION_N, TRIPPED, FaultDetectionState
from backend.control.motion_types import make_voltage_limit_flags
from backend.faults import EXPLANATIONS, FAULT_CODE, FAULTS, Fault, Limit, describe_fault
from backend.realtime import messages
from backend.realtime.commands import (
    Accepted,
    ApplyPush,
    Inject,
    ModeChanged,
    PlantAnswers,
    PlantFailing,
    Refused,
    Reset,
    SetMode,
    SetReferences,
    Stop,
    Stopped,
)
from backend.realtime.control_loop import FaultDescriber
from backend.realtime.modes import Mode
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from backend.units import AngleUnit, format_text
from plant.interface import NO_RAW, NOT_MEASURED, InjectedFault, InjectedFaultKind, Measurement, MotorCommand, Sensor
from plant.messages import watchdog_dead, writing_failed_by_injection
from plant.parameters import PlantParameters, load_parameters
from plant.safety_card import Card
from plant.simulator import Simulator
from tests.docs.faults_page import documented_ms
from tests.realtime.bench_top import BenchTop
from tests.reasons import Reason, assert_reason

# Every fault that the loop or its plant finds, injected into the simulator, reacts as in docs/reference/faults.md.
#
# Those that are found elsewhere are tested there: ``service_lost`` in test_worker.py, ``operator_lost`` in
# tests/api/test_control.py, and in test_card_faults.py what only a card has.

ENCODERS, CELLS = (Sensor.Q, Sensor.THETA_A, Sensor.THETA_B), (Sensor.F_A, Sensor.F_B)
FOUND_ELSEWHERE = {
    Fault.NONE,
    Fault.SERVICE_LOST,
    Fault.OPERATOR_LOST,
    Fault.SENSOR_SATURATED,
    Fault.MOTOR_REVERSED,
    Fault.INTERNAL_ERROR,
}


@pytest.fixture(scope="module")
def lab() -> PlantParameters:
    return load_parameters("lab")


@dataclass(frozen=True)
class Case:
    """``broken`` leads to ``fault``; ``began`` finds the tick of the cause in the samples, by default the injection."""

    fault: Fault
    broken: InjectedFault
    began: Callable[[BenchTop, int], int] | None = None


def first(column: str, reached: Callable[[np.ndarray], np.ndarray]) -> Callable[[BenchTop, int], int]:
    return lambda bench, injected: injected + int(np.argmax(reached(bench.column(column)[injected:])))


def contradicted(bench: BenchTop, injected: int) -> int:
    """First tick after the injection in which tendon A contradicts its encoders, by the paper's spring."""
    x = (7.5e-3 * bench.column("theta_A") - 75e-3 * bench.column("q"))[injected:]
    excess = bench.column("F_A")[injected:] - (-2.498 + 331.49 * x + 8543.8 * x**2)
    return injected + int(np.argmax(np.abs(excess) > CONTRADICTION_N))


CASES = [
    *(Case(Fault.SENSOR_INVALID, InjectedFault(InjectedFaultKind.NO_NUMBER, sensor)) for sensor in Sensor),
    *(Case(Fault.SENSOR_STUCK, InjectedFault(InjectedFaultKind.STUCK, sensor)) for sensor in Sensor),
    *(Case(Fault.SENSOR_JUMP, InjectedFault(InjectedFaultKind.JUMP, sensor)) for sensor in Sensor),
    *(
        Case(Fault.FORCE_LIMIT, InjectedFault(InjectedFaultKind.DRIFT_UP, F), first(F, lambda x: x > 50.0))
        for F in CELLS
    ),
    *(
        Case(Fault.SLACK, InjectedFault(InjectedFaultKind.DRIFT_DOWN, F), first(F, lambda x: x < F_SLACK))
        for F in CELLS
    ),
    Case(
        Fault.JOINT_LIMIT,
        InjectedFault(InjectedFaultKind.DRIFT_UP, Sensor.Q),
        first("q", lambda x: np.abs(x) > np.pi / 2),
    ),
    Case(Fault.IMPLAUSIBLE, InjectedFault(InjectedFaultKind.DRIFT_DOWN, Sensor.THETA_A), contradicted),
    Case(Fault.SAFETY_MODULE, InjectedFault(InjectedFaultKind.SAFETY_TRIP)),
    Case(Fault.PLANT_ERROR, InjectedFault(InjectedFaultKind.READ_ERROR)),
    Case(Fault.PLANT_ERROR, InjectedFault(InjectedFaultKind.WRITE_ERROR)),
]
STEPPED_OTHERWISE = {
    Fault.STOP_PRESSED,
    Fault.SERVICE_ENDED,
    Fault.DEADLINES_MISSED,
    Fault.WATCHDOG,
    Fault.WATCHDOG_DEAD,
}


def moving(parameters: PlantParameters, card: Card | None = None) -> BenchTop:
    """A joint in motion over most of its range, a tenth of a second after the step."""
    bench = BenchTop(parameters, plant=Simulator(parameters, card=card))
    bench.run()
    bench.advance(0.2)
    bench.send(SetReferences(0.9, 11.0))
    bench.advance(0.15)
    assert bench.loop.fault is Fault.NONE
    return bench


def until_tripped(bench: BenchTop, ticks: int) -> None:
    for _ in range(ticks):
        if bench.loop.mode is Mode.TRIPPED:
            return
        bench.advance(0.001)
    assert bench.loop.mode is Mode.TRIPPED


def test_every_fault_has_a_case() -> None:
    assert {case.fault for case in CASES} | STEPPED_OTHERWISE | FOUND_ELSEWHERE == set(FAULTS)


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.fault}-{case.broken.kind}-{case.broken.sensor}")
def test_an_injected_fault_stops_the_loop_in_its_documented_time(lab: PlantParameters, case: Case) -> None:
    bench = moving(lab)
    injected = len(bench.samples.rows)
    assert isinstance(bench.send(Inject(case.broken)), Accepted)
    until_tripped(bench, 2000)
    assert bench.loop.fault is case.fault
    fault, u = bench.column("fault"), np.abs([bench.column("u_A"), bench.column("u_B")])
    latched = int(np.argmax(fault == FAULT_CODE[case.fault]))
    began = injected if case.began is None else case.began(bench, injected)
    assert injected <= began <= latched
    assert latched - began + 1 <= documented_ms(case.fault)
    proofs = [event.zero_tick - event.arrived_tick for event in bench.events if isinstance(event, Stopped)]
    if case.broken.kind is InjectedFaultKind.WRITE_ERROR:  # nobody can prove what the outputs do then
        assert not proofs
    else:
        assert u[:, latched:].max() == 0.0
        assert [ticks <= 2 for ticks in proofs] == [True]


@pytest.mark.parametrize(
    "kind", [InjectedFaultKind.READ_ERROR, InjectedFaultKind.WRITE_ERROR, InjectedFaultKind.NO_NUMBER]
)
def test_a_lasting_fault_is_reported_at_its_start_and_end(lab: PlantParameters, kind: InjectedFaultKind) -> None:
    bench = moving(lab)
    bench.events.clear()
    bench.send(Inject(InjectedFault(kind)))
    bench.advance(3.0)
    # A STOP in the middle of it has its proof at once, where the outputs can be written at all.
    before = len(bench.events)
    arrived = bench.send(Stop()).tick
    bench.advance(0.1)
    proofs = [event for event in bench.events[before:] if isinstance(event, Stopped)]
    if kind is InjectedFaultKind.WRITE_ERROR:
        assert not proofs
    else:
        (proof,) = proofs
        assert proof.fault is Fault.STOP_PRESSED
        assert proof.zero_tick - arrived <= 2
    bench.send(Inject(None))
    bench.advance(2.0)
    told = [event for event in bench.events if not isinstance(event, Accepted)]
    stops = [event for event in told if isinstance(event, Stopped)]
    assert len(stops) <= 2
    assert len([event for event in told if isinstance(event, ModeChanged)]) == 1
    always_read = kind is InjectedFaultKind.NO_NUMBER
    expected = [] if always_read else [PlantFailing, PlantAnswers]
    assert [type(event) for event in told if isinstance(event, PlantFailing | PlantAnswers)] == expected


def test_a_write_error_while_tripped_is_reported(lab: PlantParameters) -> None:
    bench = moving(lab)
    bench.send(Stop())
    bench.advance(0.1)
    bench.send(Inject(InjectedFault(InjectedFaultKind.WRITE_ERROR)))
    bench.advance(0.1)
    assert bench.loop.fault is Fault.STOP_PRESSED
    (failing,) = (event for event in bench.events if isinstance(event, PlantFailing))
    assert failing.reason == writing_failed_by_injection()
    assert isinstance(bench.send(Reset()), Refused)


def test_a_hard_stop_replaces_a_soft_stop_while_the_plant_fails(lab: PlantParameters) -> None:
    bench = moving(lab)
    bench.send(Stop(Fault.OPERATOR_LOST, hard=False))
    bench.advance(0.01)
    before = bench.loop.mode
    assert before is Mode.STOPPING
    bench.send(Inject(InjectedFault(InjectedFaultKind.READ_ERROR)))
    bench.advance(0.001)
    assert bench.loop.mode is Mode.TRIPPED
    assert bench.column("u_A")[-1] == bench.column("u_B")[-1] == 0.0


def test_an_intermittent_plant_failure_is_reported_once(lab: PlantParameters) -> None:
    bench = moving(lab)
    for _ in range(200):
        bench.send(Inject(InjectedFault(InjectedFaultKind.READ_ERROR)))
        bench.advance(0.003)
        bench.send(Inject(None))
        bench.advance(0.003)
    assert sum(isinstance(event, PlantFailing | PlantAnswers) for event in bench.events) == 1
    assert sum(isinstance(event, Stopped) for event in bench.events) == 1


def test_a_lasting_injection_keeps_the_fault_until_the_plant_is_repaired(lab: PlantParameters) -> None:
    for kind in (InjectedFaultKind.NO_NUMBER, InjectedFaultKind.READ_ERROR):
        bench = moving(lab)
        bench.send(Inject(InjectedFault(kind)))
        bench.advance(0.3)
        assert isinstance(bench.send(Reset()), Refused)
        assert isinstance(bench.send(Inject(None)), Accepted)
        bench.advance(0.01)
        assert isinstance(bench.send(Reset()), Accepted)
        bench.advance(0.5)
        bench.run(run=2)
        bench.advance(0.5)
        assert bench.loop.mode is Mode.RUN


def test_implausible_encoders_are_zeroed_again(lab: PlantParameters) -> None:
    """After a permanent slip of a tendon, the next pretension finds the new zeros."""
    bench = moving(lab)
    bench.send(Inject(InjectedFault(InjectedFaultKind.DRIFT_DOWN, Sensor.THETA_A)))
    until_tripped(bench, 1000)
    bench.send(Reset())
    bench.run(run=2)
    bench.advance(1.0)
    assert bench.loop.mode is Mode.RUN
    assert bench.column("S")[-1] == pytest.approx(bench.column("S_true")[-1], abs=0.1)


def test_stop_sets_zero_volts_within_two_ticks_from_any_motion(lab: PlantParameters) -> None:
    bench = moving(lab)
    arrived = len(bench.samples.rows)
    bench.send(Stop())
    bench.advance(0.01)
    u = np.abs([bench.column("u_A"), bench.column("u_B")])
    assert u[:, arrived - 1].min() > 0.0
    assert u[:, arrived + documented_ms(Fault.STOP_PRESSED) - 1 :].max() == 0.0


def test_consecutive_missed_deadlines_stop_in_the_next_tick_and_fewer_do_not(lab: PlantParameters) -> None:
    bench = moving(lab)
    allowed = round(Simulator.unattended_max_s * 1000)
    overruns = 0
    for missed in (1, 20, allowed - 1):
        overruns += missed
        bench.loop.tick(overruns=overruns)
        assert bench.loop.fault is Fault.NONE
    bench.loop.tick(overruns=overruns + allowed)
    assert bench.loop.fault is Fault.DEADLINES_MISSED
    assert bench.column("u_A")[-1] == 0.0


@pytest.mark.live  # the card's watchdog is a process of its own, on a clock of its own
def test_an_expired_watchdog_disables_the_drives_until_reset(lab: PlantParameters) -> None:
    moving(lab)  # compiles the step, which takes longer than the watchdog waits
    card = Card.create()
    bench = moving(lab, card)
    assert card.state().u_A == bench.column("u_A")[-1] != 0.0
    card.expire()
    bench.advance(0.001)
    assert bench.loop.fault is Fault.WATCHDOG
    bench.advance(0.5)
    state = card.state()
    assert (state.u_A, state.u_B, state.drive_enabled) == (0.0, 0.0, False)
    assert sum(isinstance(event, Stopped) for event in bench.events) == 1
    assert isinstance(bench.send(SetMode(Mode.PRETENSION)), Refused)
    assert isinstance(bench.send(Reset()), Accepted)
    assert card.state().drive_enabled
    bench.run(run=2)
    bench.loop.close()
    assert not card.state().drive_enabled


@pytest.mark.live  # the card's watchdog is a process of its own, on a clock of its own
def test_a_dead_watchdog_trips_and_the_drives_stay_off(lab: PlantParameters) -> None:
    moving(lab)  # compiles the step, which takes longer than the watchdog waits
    card = Card.create()
    bench = moving(lab, card)
    assert card.state().u_A != 0.0
    looks = card.state().polls
    bench.send(Inject(InjectedFault(InjectedFaultKind.WATCHDOG_DEATH)))
    begun_s = time.monotonic()
    while bench.loop.mode is not Mode.TRIPPED:
        assert time.monotonic() - begun_s < 20.0, "nobody noticed that the watchdog is dead"
        time.sleep(0.001)
        bench.advance(0.001)
    assert card.state().polls <= looks + 100
    assert bench.loop.fault is Fault.WATCHDOG_DEAD
    state = card.state()
    assert (state.u_A, state.u_B, state.drive_enabled) == (0.0, 0.0, False)
    bench.advance(0.5)
    assert sum(isinstance(event, Stopped) for event in bench.events) == 1
    refused = bench.send(Reset())
    assert isinstance(refused, Refused)
    assert watchdog_dead() in refused.reason
    assert isinstance(bench.send(SetMode(Mode.PRETENSION)), Refused)
    bench.loop.close()


def test_samples_are_finite_again_after_a_nan_reading(lab: PlantParameters) -> None:
    bench = moving(lab)
    bench.send(Inject(InjectedFault(InjectedFaultKind.NO_NUMBER, Sensor.Q)))
    bench.advance(0.01)
    bench.send(Inject(None))
    bench.advance(0.01)
    assert np.isfinite(bench.samples.rows[-1][INDEX["q_dot"]])


# Text of a fault: one sentence, the observation after a colon, and no number without its unit.

SENTENCE = re.compile(r"[A-Z][^:]*(: .*[^.])?\.")
WITHOUT_UNIT = re.compile(r"(?<![\w.-])-?\d+(?:\.\d+)?(?![\d.]|:? (?:rad|N|V|s|ms)\b| to -?\d)")


@pytest.mark.parametrize(
    ("broken", "fault", "expected"),
    [
        (
            InjectedFault(InjectedFaultKind.JUMP, Sensor.Q),
            Fault.SENSOR_JUMP,
            Reason("sensor_jumped", sensor="q", unit="rad"),
        ),
        (
            InjectedFault(InjectedFaultKind.JUMP, Sensor.F_A),
            Fault.SENSOR_JUMP,
            Reason("sensor_jumped", sensor="F_A", unit="N"),
        ),
        (
            InjectedFault(InjectedFaultKind.STUCK, Sensor.F_B),
            Fault.SENSOR_STUCK,
            Reason("load_cell_stuck", load_cell="F_B"),
        ),
        (InjectedFault(InjectedFaultKind.DRIFT_UP, Sensor.Q), Fault.JOINT_LIMIT, Reason("joint_out_of_range")),
        (InjectedFault(InjectedFaultKind.DRIFT_UP, Sensor.F_A), Fault.FORCE_LIMIT, Reason("tension_too_high")),
        (InjectedFault(InjectedFaultKind.DRIFT_DOWN, Sensor.F_A), Fault.SLACK, Reason("tendons_slack")),
        (
            InjectedFault(InjectedFaultKind.NO_NUMBER, Sensor.Q),
            Fault.SENSOR_INVALID,
            Reason("sensors_without_reading", sensors=("q",)),
        ),
        (
            InjectedFault(InjectedFaultKind.DRIFT_DOWN, Sensor.THETA_A),
            Fault.IMPLAUSIBLE,
            Reason("tension_unlike_encoders", load_cell="F_A"),
        ),
        (InjectedFault(InjectedFaultKind.SAFETY_TRIP), Fault.SAFETY_MODULE, Reason("readings_at_trip")),
    ],
    ids=lambda value: f"{value.kind}-{value.sensor}" if isinstance(value, InjectedFault) else "",
)
def test_a_fault_is_one_sentence_with_units(
    lab: PlantParameters, broken: InjectedFault, fault: Fault, expected: Reason
) -> None:
    bench = moving(lab)
    bench.send(Inject(broken))
    until_tripped(bench, 2000)
    (stopped,) = (event for event in bench.events if isinstance(event, Stopped))
    assert stopped.fault is fault
    assert stopped.detail == expected
    told = format_text(describe_fault(stopped.fault, stopped.detail), AngleUnit.RADIANS)
    assert told.endswith(f": {format_text(stopped.detail, AngleUnit.RADIANS)}.")
    assert SENTENCE.fullmatch(told)
    assert WITHOUT_UNIT.findall(told) == []


def test_the_message_of_a_pressed_stop_has_no_details(lab: PlantParameters) -> None:
    bench = moving(lab)
    bench.send(Stop())
    bench.advance(0.01)
    (stopped,) = (event for event in bench.events if isinstance(event, Stopped))
    assert describe_fault(stopped.fault, stopped.detail) == EXPLANATIONS[Fault.STOP_PRESSED].message


def test_a_nan_reading_is_reported_without_a_unit(lab: PlantParameters) -> None:
    tripped = CLEAR._replace(kind=TRIPPED)
    seen = FaultDetectionState(*(len(FaultDetectionState._fields) * [None]))  # type: ignore[arg-type]
    m = NOT_MEASURED._replace(F_B=12.0)
    _, detail = FaultDescriber(lab).describe(tripped, seen, m, m, MotorCommand(0.0, 0.0), NO_RAW, 0)
    assert detail == messages.readings_at_trip(F_A=m.F_A, F_B=12.0, q=m.q)
    assert "nan" not in detail


# An internal error trips at zero volts, is reported and recorded; that loop cannot be reset.


class Written(Simulator):
    """Stores the last command written."""

    last = MotorCommand(0.0, 0.0)

    def write(self, command: MotorCommand) -> None:
        self.last = command
        super().write(command)


@pytest.fixture
def moving_invariants(lab: PlantParameters) -> BenchTop:
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
def test_an_exception_in_the_step_trips_before_a_voltage_is_written(
    moving_invariants: BenchTop, spoil: Callable[[BenchTop], None]
) -> None:
    spoil(moving_invariants)
    rows = len(moving_invariants.samples.rows)
    moving_invariants.advance(documented_ms(Fault.INTERNAL_ERROR) * 1e-3)
    assert (moving_invariants.loop.mode, moving_invariants.loop.fault) == (Mode.TRIPPED, Fault.INTERNAL_ERROR)
    assert last(moving_invariants) == MotorCommand(0.0, 0.0)
    moving_invariants.advance(0.1)
    assert len(moving_invariants.samples.rows) == rows + 101  # it goes on recording
    assert set(moving_invariants.column("fault", 101)) == {float(FAULT_CODE[Fault.INTERNAL_ERROR])}
    assert set(moving_invariants.column("u_A", 101)) == set(moving_invariants.column("u_B", 101)) == {0.0}
    (stopped,) = [event for event in moving_invariants.events if isinstance(event, Stopped)]
    assert (stopped.fault, stopped.hard) == (Fault.INTERNAL_ERROR, True)
    assert isinstance(moving_invariants.send(Reset()), Refused)
    assert isinstance(moving_invariants.send(SetMode(Mode.PRETENSION)), Refused)
    assert moving_invariants.loop.mode is Mode.TRIPPED


def test_a_loop_tripped_without_a_fault_rejects_reset(moving_invariants: BenchTop) -> None:
    trips_without_a_fault(moving_invariants)
    moving_invariants.advance(0.001)
    assert (moving_invariants.loop.fault, last(moving_invariants)) == (Fault.INTERNAL_ERROR, MotorCommand(0.0, 0.0))
    assert isinstance(moving_invariants.send(Reset()), Refused)


def test_an_internal_error_replaces_an_earlier_trip_so_reset_starts_a_new_loop(
    moving_invariants: BenchTop,
) -> None:
    moving_invariants.send(Stop(Fault.STOP_PRESSED))
    moving_invariants.advance(0.01)
    assert moving_invariants.loop.fault is Fault.STOP_PRESSED
    raises(moving_invariants)
    moving_invariants.advance(0.002)
    assert moving_invariants.column("fault", 1)[0] == FAULT_CODE[Fault.INTERNAL_ERROR]
    told = [event.fault for event in moving_invariants.events if isinstance(event, Stopped)]
    assert told == [Fault.STOP_PRESSED, Fault.INTERNAL_ERROR]


def test_a_command_that_raises_is_rejected_and_trips(
    moving_invariants: BenchTop, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise KeyError("S_ref")

    monkeypatch.setattr(moving_invariants.loop._mode_manager, "set_references", fail)
    refused = moving_invariants.send(SetReferences(0.2, 11.0))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, "command_failed", command="SetReferences", reason="KeyError: 'S_ref'")
    moving_invariants.advance(0.001)
    assert (moving_invariants.loop.fault, last(moving_invariants)) == (Fault.INTERNAL_ERROR, MotorCommand(0.0, 0.0))


def test_a_ring_buffer_corrupted_by_another_process_trips(lab: PlantParameters) -> None:
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


def test_every_mode_change_keeps_the_invariants(lab: PlantParameters) -> None:
    bench = BenchTop(lab)
    bench.run()
    for mode in (Mode.PRETENSION, Mode.RUN, Mode.STOPPING):
        assert isinstance(bench.send(SetMode(mode)), Accepted)
        bench.loop._mode_manager.require_consistent()
        bench.advance(0.5)
        bench.loop._mode_manager.require_consistent()
    assert bench.loop.fault is Fault.NONE


# The limit flags in the sample say which limit acted, in the tick it acted; a fault tells the limit as it is.


@pytest.fixture(scope="module")
def pushed_bench() -> BenchTop:
    bench = BenchTop(load_parameters("ideal"))
    bench.run()
    bench.send(SetReferences(0.0, 8.0))
    bench.advance(4.0)
    bench.send(ApplyPush(18.0, 3.0))
    bench.advance(3.0)
    bench.advance(3.0)
    return bench


def test_the_tension_floor_is_flagged_while_it_raises_the_stiffness(pushed_bench: BenchTop) -> None:
    flags, S, S_ref = (pushed_bench.column(name, last=6000) for name in ("limits", "S", "S_ref"))
    at_floor = (flags.astype(int) & Limit.TENSION_FLOOR) != 0
    assert np.all(at_floor[1000:3000])
    assert np.all((S - S_ref)[1500:3000] > 0.3)
    assert not np.any(at_floor[-1000:])


def test_the_governor_is_flagged_while_it_changes_the_references(pushed_bench: BenchTop) -> None:
    flags, S_ref, governed = (pushed_bench.column(name, last=10_000) for name in ("limits", "S_ref", "S_ref_gov"))
    held_back = (flags.astype(int) & Limit.GOVERNOR) != 0
    assert np.array_equal(held_back, governed != S_ref)
    assert 0 < np.count_nonzero(held_back) < 1000


def test_a_joint_limit_fault_states_the_exact_limit() -> None:
    """In degrees too: the bound is 90, not a value from three decimals of a radian."""
    checks = FaultDescriber(load_parameters("ideal"))
    fault, seen = checks.find_static_fault(Measurement(math.radians(-91.25), 0.0, 0.0, 20.0, 20.0, 10.0, 0.0, 0.0))
    assert fault is Fault.JOINT_LIMIT
    told, bound = format_text(seen, AngleUnit.DEGREES).split("; ")
    assert " 90° " in bound
    assert float(told.removeprefix("q = ").removesuffix("°")) == pytest.approx(-91.25, abs=5e-4)


def test_a_clipped_voltage_sets_only_the_flag_of_its_motor() -> None:
    flags = [make_voltage_limit_flags(A, B) for A in (False, True) for B in (False, True)]
    assert flags == [0, Limit.VOLTAGE_B, Limit.VOLTAGE_A, Limit.VOLTAGE_A | Limit.VOLTAGE_B]
