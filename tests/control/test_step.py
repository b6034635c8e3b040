"""A batch of ticks equals single ticks: each number of each row, each event with its tick."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.faults import Fault
from backend.realtime.commands import (
    Accepted,
    ApplyPush,
    Command,
    Event,
    Inject,
    Obstruct,
    Reset,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
    Stopped,
)
from backend.realtime.control_loop import Loop
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import Mode
from backend.realtime.program import ContactDetection, Excitation, Law, Program, Segment, Shape, TensionLeg, VoltageStep
from backend.realtime.ring_buffer import Ring
from backend.tuning.gains import TuningParameters
from plant.dynamics import Obstacle
from plant.interface import ON_SENSORS, InjectedFault, InjectedFaultKind, Sensor
from plant.parameters import load_parameters
from plant.simulator import Simulator

LAB = load_parameters("lab")
TUNING = make_tuning_command(LAB, TuningParameters())
WOUND_UP = 5900
"""Ticks after which both tendons hold the pretension."""

Script = dict[int, Command]
"""What is ordered before which tick."""

RUN: Script = {0: SetMode(Mode.PRETENSION), WOUND_UP: SetMode(Mode.RUN, run=3)}
SEGMENTS = (
    Segment(0.3, 0.2, 11.0),
    Segment(0.4, -0.3, 12.0, F_push=4.0, shape=Shape.RAMP),
    Segment(0.5, 0.1, 10.0, F_push=-2.0, shape=Shape.SINE, period_s=0.2),
    Segment(0.3, 0.0, 10.0, load_A=0.01, load_B=0.02),
    Segment(0.4, 0.1, 10.5, shape=Shape.SWEEP, period_s=0.3, period_end_s=0.05),
    Segment(0.4, 0.1, 10.5, shape=Shape.PRBS, period_s=0.02, count=5),
    Segment(0.4, 0.1, 10.5, shape=Shape.MULTISINE, period_s=0.2, count=6, peak=4.0),
)
RETUNED = (
    Segment(0.3, 0.2, 11.0),
    Segment(0.4, -0.3, 12.0, tuning=1),
    Segment(0.3, 0.1, 10.0),
    Segment(0.3, 0.0, 10.0, tuning=2),
)
WALLED = (Segment(0.3, 0.0, 11.0, wall=1), Segment(0.9, 0.2, 11.0), Segment(0.3, 0.2, 11.0, wall=2))
FELT = (
    Segment(1.5, 0.0, 11.0, wall=1), Segment(0.5, 0.25, 11.0, shape=Shape.RAMP, contact_detection=1),
    Segment(0.3, 0.25, 11.0),
    Segment(0.3, 0.0, 11.0, shape=Shape.RAMP, contact_detection=2), Segment(0.2, 0.0, 11.0),
)  # fmt: skip
RETUNINGS = (
    make_tuning_command(LAB, TuningParameters(0.8, 0.6)),
    make_tuning_command(LAB, TuningParameters(0.6, 0.9), u_plan=8.5),
)
STEPS = (VoltageStep(0.0, 3.0, 0.4, 4.0), VoltageStep(-1.0, 5.0, 0.3, 2.0))
EXCITATION = Excitation(amplitude_rad=0.2, chip_s=0.05, levels="+-++-", periods=2)
PROGRAMS = {
    "cascade": Program(Law.CASCADE, SEGMENTS),
    "compliance": Program(Law.COMPLIANCE, SEGMENTS),
    "cascade with other tunings": Program(Law.CASCADE, RETUNED, tunings=RETUNINGS),
    "walls on the way": Program(Law.CASCADE, WALLED, walls=(Obstacle(1.0, 0.1, 2e4, 1.0), None)),
    "contacts of its own": Program(
        Law.CASCADE,
        FELT,
        walls=(Obstacle(1.0, 0.1, 2e4, 1.0),),
        contact_detections=(ContactDetection(1.0, calibrates_bias=True), ContactDetection()),
    ),
    "single loop": Program(Law.SINGLE_LOOP, SEGMENTS),
    "feedback linearization": Program(Law.FEEDBACK_LINEARIZATION, SEGMENTS),
    "force hold": Program(Law.FORCE_HOLD, tension_N=15.0, settle_s=0.2, excitation=EXCITATION),
    "voltage steps": Program(Law.MOTOR_STEPS, settle_s=0.1, steps=STEPS),
    "tension sweep": Program(
        Law.TENSION_SWEEP, tension_N=8.0, settle_s=0.1, legs=(TensionLeg(20.0, 0.5), TensionLeg(9.0, 0.4))
    ),
}
SCRIPTS: dict[str, Script] = {
    "the operator's references": RUN
    | {
        6000: SetReferences(0.5, 12.0),
        6400: replace(TUNING, lam_q=0.3),
        6800: SetReferences(-0.4, 9.0),
        7300: SetMode(Mode.COMPLIANCE, run=4),
    },
    "a push by hand": RUN | {6000: ApplyPush(8.0, 0.3), 6900: ApplyPush(5.0, 2.0), 7200: SetMode(Mode.PRETENSION)},
    "a wall by hand": RUN
    | {6000: Obstruct(Obstacle(1.0, 0.2, 1e4, 0.0)), 6100: SetReferences(0.25, 9.0), 7300: Obstruct(None)},
    "a soft stop": RUN | {6000: SetReferences(0.8, 12.0), 6200: SetMode(Mode.STOPPING), 7100: SetMode(Mode.PRETENSION)},
    "a latched stop": RUN
    | {6000: SetReferences(0.8, 12.0), 6200: Stop(hard=False), 7000: Reset(), 7100: SetMode(Mode.PRETENSION)},
    "a hard stop while at rest": {0: Stop(), 50: Reset(), 60: SetMode(Mode.PRETENSION)},
    **{name: {0: SetMode(Mode.PRETENSION), WOUND_UP: RunProgram(p, 5)} for name, p in PROGRAMS.items()},
    **{
        f"a program that meets {kind} of {sensor}": {
            0: SetMode(Mode.PRETENSION),
            WOUND_UP: RunProgram(PROGRAMS["cascade"], 5),
            6300: Inject(InjectedFault(kind, sensor)),
            7500: Inject(None),
            7600: Reset(),
            7700: SetMode(Mode.PRETENSION),
        }
        for kind in ON_SENSORS
        for sensor in Sensor
    },
    **{
        f"a program that meets {kind}": {
            0: SetMode(Mode.PRETENSION),
            WOUND_UP: RunProgram(PROGRAMS["feedback linearization"], 5),
            6300: Inject(InjectedFault(kind)),
            7500: Inject(None),
            7600: Reset(),
        }
        for kind in (InjectedFaultKind.SAFETY_TRIP, InjectedFaultKind.READ_ERROR, InjectedFaultKind.WRITE_ERROR)
    },
}
END = 9000


def by_ticks(loop: Loop, ticks: int) -> None:
    for _ in range(ticks):
        loop.tick()


def by_batches_of(most: int) -> Callable[[Loop, int], None]:
    def step(loop: Loop, ticks: int) -> None:
        while ticks > 0:
            ticks -= loop.run(min(ticks, most))

    return step


def played(script: Script, step: Callable[[Loop, int], None]) -> tuple[NDArray[np.float64], list[Event]]:
    ring = Ring.create(1 << 14)
    loop = Loop(Simulator(LAB, seed=5), LAB, ring, TUNING)
    at = 0
    for sequence, (tick, command) in enumerate(sorted(script.items(), key=lambda due: due[0]), start=1):
        step(loop, tick - at)
        at = tick
        loop.handle(sequence, command)
    step(loop, END - at)
    _, rows, missed = ring.read(0, END)
    events = [
        replace(event, milliseconds=0.0) if isinstance(event, Stopped) else event for event in loop.drain_events()
    ]
    loop.close()
    ring.close()
    assert missed == 0
    return rows, events


@pytest.mark.parametrize("name", SCRIPTS)
def test_batches_of_any_length_give_the_rows_and_events_of_single_ticks(name: str) -> None:
    rows, events = played(SCRIPTS[name], by_ticks)
    assert len(rows) == END
    taken = {event.sequence for event in events if isinstance(event, Accepted)}
    assert taken == set(range(1, len(SCRIPTS[name]) + 1)), "what is refused moves nothing"
    for most in (1, 7, 1000):
        in_batches, told = played(SCRIPTS[name], by_batches_of(most))
        np.testing.assert_array_equal(in_batches, rows)
        assert told == events


def test_a_batch_lasts_until_the_next_event() -> None:
    """Otherwise the other tests would compare the loop with itself."""
    ring = Ring.create(1 << 14)
    loop = Loop(Simulator(LAB, seed=5), LAB, ring, TUNING)
    loop.handle(1, SetMode(Mode.PRETENSION))
    lengths: list[int] = []
    while ring.count < WOUND_UP:
        lengths.append(loop.run(1000))
    assert max(lengths) > 900
    assert sum(lengths) == ring.count
    loop.handle(2, Inject(InjectedFault(InjectedFaultKind.STUCK, Sensor.F_A)))
    assert loop.run(1000) == 1
    loop.close()
    ring.close()


def test_a_fault_ends_a_batch_in_its_tick() -> None:
    _, events = played(SCRIPTS[f"a program that meets {InjectedFaultKind.JUMP} of {Sensor.Q}"], by_batches_of(1000))
    (stopped,) = (event for event in events if isinstance(event, Stopped))
    assert stopped.fault is Fault.SENSOR_JUMP
