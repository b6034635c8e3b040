"""Changes of mode, law and tuning, at rest and while moving; stops."""

import math
import re
from collections.abc import Iterator
from contextlib import closing

import numpy as np
import pytest

from backend.control.motion_primitives import LARGEST_STEP_V
from backend.faults import FAULT_CODE, Fault
from backend.realtime.commands import Accepted, Refused, Reset, RunProgram, SetMode, SetReferences, Stop, Stopped
from backend.realtime.modes import LEGAL, MODE_CODE, Mode
from backend.realtime.program import Excitation, Law, Program, Segment
from plant.interface import Measurement, MotorCommand, PlantError
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.docs.faults_page import PAGE, documented_ms
from tests.realtime.bench_top import BenchTop
from tests.realtime.changes_at_rest import Moved, Session, changes_at_rest

# Stops and trips of the loop on the simulator: zero volts, latched, braked where there is time.


def test_a_hard_stop_sets_zero_volts_in_the_next_tick_and_latches(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.send(SetReferences(1.0, 12.0))
    bench.advance(0.4)
    assert bench.send(Stop()).tick == len(bench.samples.rows)
    bench.advance(0.01)
    assert bench.column("u_A", last=10).tolist() == [0.0] * 10
    assert bench.column("u_B", last=10).tolist() == [0.0] * 10
    proof = next(event for event in bench.events if isinstance(event, Stopped))
    assert proof.zero_tick - proof.arrived_tick <= 2
    stopped = bench.loop.mode
    assert stopped is Mode.TRIPPED
    assert isinstance(bench.send(SetMode(Mode.PRETENSION)), Refused)
    assert isinstance(bench.send(Reset()), Accepted)
    assert bench.loop.mode is Mode.OFF


@pytest.mark.parametrize("mode", [Mode.OFF, Mode.PRETENSION, Mode.RUN, Mode.STOPPING, Mode.TRIPPED])
def test_hard_stop_works_from_every_mode(ideal: PlantParameters, mode: Mode) -> None:
    bench = BenchTop(ideal)
    if mode is not Mode.OFF:
        bench.run()
    if mode in (Mode.PRETENSION, Mode.STOPPING):
        bench.send(SetMode(mode))
    if mode is Mode.TRIPPED:
        bench.send(Stop())
    bench.advance(0.002)
    bench.events.clear()
    assert isinstance(bench.send(Stop()), Accepted)
    bench.advance(0.002)
    assert bench.loop.mode is Mode.TRIPPED
    assert any(isinstance(event, Stopped) for event in bench.events)
    assert bench.column("u_A")[-1] == bench.column("u_B")[-1] == 0.0


@pytest.mark.parametrize("name", ["ideal", "lab"])
@pytest.mark.parametrize("moving_s", [0.3, 0.6, 0.9])
def test_a_soft_stop_brakes_under_tension_before_it_releases_the_tendons(name: str, moving_s: float) -> None:
    bench = BenchTop(load_parameters(name))
    bench.run()
    bench.send(SetReferences(1.2, 12.0))
    bench.advance(moving_s)
    speed = abs(bench.column("q_dot")[-1])
    bench.send(Stop(Fault.SERVICE_LOST, hard=False))
    bench.advance(3.0)
    modes, q_dot = bench.column("mode", last=3000), bench.column("q_dot", last=3000)
    F = np.minimum(bench.column("F_A", last=3000), bench.column("F_B", last=3000))
    released = int(np.argmax(modes == MODE_CODE[Mode.TRIPPED]))
    assert released > 300
    assert F[:released].min() > 5.0
    # Encoder quantization alone makes the estimate of a standing joint read up to one count in ten ticks.
    noise = 0.16 if name == "lab" else 0.0
    assert np.max(np.abs(q_dot[250:released])) < 0.05 * speed + noise
    assert bench.column("u_A")[-1] == bench.column("u_B")[-1] == 0.0
    assert bench.column("fault")[-1] == FAULT_CODE[Fault.SERVICE_LOST]


def test_push_beyond_the_force_bound_trips_and_stays_tripped(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.plant.push(-80.0)
    bench.advance(1.0)
    assert bench.loop.mode is Mode.TRIPPED
    assert bench.loop.fault in (Fault.FORCE_LIMIT, Fault.SAFETY_MODULE, Fault.SLACK)
    assert bench.column("u_A")[-1] == 0.0
    refused = bench.send(Reset())
    assert isinstance(refused, Refused)
    bench.plant.push(0.0)
    bench.advance(1.0)
    assert isinstance(bench.send(Reset()), Accepted)


def test_plant_error_ends_in_zero_volts(ideal: PlantParameters) -> None:
    class Breaking(Simulator):
        broken = False
        written: MotorCommand | None = None

        def read(self) -> Measurement:
            if self.broken:
                raise PlantError("encoder cable pulled: reconnect it")
            return super().read()

        def write(self, command: MotorCommand) -> None:
            self.written = command
            super().write(command)

    plant = Breaking(ideal)
    bench = BenchTop(ideal, plant=plant)
    bench.run()
    plant.broken = True
    bench.advance(0.001)
    assert plant.written == MotorCommand(0.0, 0.0)
    assert bench.loop.fault is Fault.PLANT_ERROR


def test_a_nan_sensor_reading_trips(ideal: PlantParameters) -> None:
    class Blind(Simulator):
        blind = False

        def read(self) -> Measurement:
            m = super().read()
            return m._replace(F_A=math.nan) if self.blind else m

    plant = Blind(ideal)
    bench = BenchTop(ideal, plant=plant)
    bench.run()
    plant.blind = True
    bench.advance(0.001)
    assert bench.loop.fault is Fault.SENSOR_INVALID
    assert bench.column("u_A")[-1] == 0.0


def test_the_end_of_the_service_is_a_soft_stop_with_its_cause(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.run()
    bench.send(SetReferences(0.9, 11.0))
    bench.advance(0.3)
    arrived = len(bench.samples.rows)
    bench.send(Stop(Fault.SERVICE_ENDED, hard=False, detail="service ended by SIGTERM"))
    bench.advance(2.5)
    latched = int(np.argmax(bench.column("fault") == FAULT_CODE[Fault.SERVICE_ENDED]))
    assert 0 <= latched - arrived < documented_ms(Fault.SERVICE_ENDED)
    (stopped,) = [event for event in bench.events if isinstance(event, Stopped)]
    assert (stopped.fault, stopped.hard, stopped.detail) == (Fault.SERVICE_ENDED, False, "service ended by SIGTERM")


# Changes of mode, law, bank and tuning at rest change neither the voltages nor the joint position.

MOTIONS = {"lambda": (0.0,), "time-optimal": (8.5,), "both": (0.0, 8.5, 3.0)}


def require_still(moved: list[Moved]) -> None:
    """Check that no voltage changes by 0.1 V and the joint by at most one count, in one tick and in 2.5 s."""
    for change in moved:
        assert change.u <= 0.1, change
        assert change.counts <= 1.01, change


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
@pytest.mark.parametrize("motion", list(MOTIONS))
def test_changes_at_rest_cause_no_motion(name: str, motion: str) -> None:
    plant = load_parameters(name)
    require_still(changes_at_rest(plant, 7, number=6, places=2, budgets=MOTIONS[motion]))


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
@pytest.mark.parametrize("motion", list(MOTIONS))
def test_200_changes_at_rest_cause_no_motion(name: str, motion: str) -> None:
    plant = load_parameters(name)
    moved = [
        change
        for seed in range(4)
        for change in changes_at_rest(plant, seed, number=10, places=5, budgets=MOTIONS[motion])
    ]
    assert len(moved) == 200
    require_still(moved)


@pytest.mark.parametrize("u_plan", [0.0, 8.5])
@pytest.mark.parametrize("ticks", [0, 60, 700])
def test_a_soft_stop_changes_the_voltages_gradually(u_plan: float, ticks: int) -> None:
    """At rest it releases them in steps below half a volt; in motion, in steps no larger than those of a motion."""
    session = Session(load_parameters("lab"), 1, (u_plan,))
    session.pretension()
    session.order(SetMode(Mode.RUN))
    session.order(SetReferences(-1.0, 10.0))
    session.run(9000)
    if ticks:
        session.order(SetReferences(1.0, 14.0))
        session.run(ticks)
    session.order(SetMode(Mode.STOPPING))
    session.run(450)
    u = session.voltages(451)
    # The first step counts from the voltage that the loop would have gone on with.
    assert np.max(np.abs(np.diff(u, axis=0))) <= (LARGEST_STEP_V + 0.2 if ticks else 0.3)
    session.close()


# A change of mode while the joint moves changes the voltages from one sample to the next by no more than is stated.

STEPS = Program(
    Law.CASCADE,
    (Segment(duration_s=9.0, q_ref=1.0, S_ref=14.0), Segment(duration_s=5.0, q_ref=-1.0, S_ref=9.0)),
)
SHAKEN = Program(
    Law.FORCE_HOLD,
    tension_N=25.0,
    settle_s=0.5,
    excitation=Excitation(amplitude_rad=1.0, chip_s=0.3, levels="+-" * 6, periods=1),
)
CHANGES = [
    (before, after)
    for before in (Mode.RUN, Mode.COMPLIANCE, Mode.EXPERIMENT, Mode.IDENTIFY, Mode.PRETENSION)
    for after in LEGAL[before]
    if after is not Mode.OFF and not (before is Mode.PRETENSION and after is not Mode.STOPPING)
]
"""Off takes the voltages away at once, and the moves out of pretension wait until it is reached."""
WORST = [(Mode.RUN, Mode.COMPLIANCE), (Mode.COMPLIANCE, Mode.RUN), (Mode.RUN, Mode.STOPPING)]
AFTER_TICKS = 40


def stated_V() -> float:
    found = re.search(r"by at most (\d+(?:\.\d+)?) V from one sample to the next", " ".join(PAGE.split()))
    assert found is not None
    return float(found[1])


def moving_in(session: Session, mode: Mode) -> None:
    """Start a large motion of the joint or the motors in a mode."""
    session.pretension()
    session.run(3000)
    match mode:
        case Mode.RUN:
            session.order(SetMode(Mode.RUN))
            session.order(SetReferences(1.0, 14.0))
        case Mode.COMPLIANCE:
            session.order(SetMode(Mode.COMPLIANCE))
            session.order(SetReferences(0.0, 14.5))
        case Mode.EXPERIMENT:
            session.order(RunProgram(STEPS))
        case Mode.IDENTIFY:
            session.order(RunProgram(SHAKEN))
            session.run(700)
        case _:  # back to pretension from a move
            session.order(SetMode(Mode.RUN))
            session.order(SetReferences(1.0, 14.0))
            session.run(3000)
            session.order(SetMode(Mode.PRETENSION))


def largest_steps(plant: str, before: Mode, after: Mode, moments: range) -> Iterator[float]:
    """Largest step of a voltage [V] in the change, made after so many ticks of the motion, in both motions."""
    for u_plan in (0.0, 8.5):
        for ticks in moments:
            with closing(Session(load_parameters(plant), ticks, (u_plan,))) as session:
                moving_in(session, before)
                session.run(ticks)
                if after in (Mode.EXPERIMENT, Mode.IDENTIFY):
                    session.order(RunProgram(STEPS if after is Mode.EXPERIMENT else SHAKEN))
                else:
                    session.order(SetMode(after))
                session.run(AFTER_TICKS)
                yield float(np.max(np.abs(np.diff(session.voltages(AFTER_TICKS + 2), axis=0))))


def require_bound(plant: str, before: Mode, after: Mode, moments: range) -> None:
    # The tick of a soft stop is counted from the voltage that the loop would have gone on with.
    bound = LARGEST_STEP_V + 0.2 if after is Mode.STOPPING else stated_V()
    assert max(largest_steps(plant, before, after, moments)) <= bound


@pytest.mark.parametrize(("before", "after"), WORST)
def test_the_largest_changes_keep_the_bound(before: Mode, after: Mode) -> None:
    require_bound("lab", before, after, range(90, 500, 205))


@pytest.mark.parametrize("plant", ["ideal", "lab", "lab-stick"])
@pytest.mark.parametrize(("before", "after"), CHANGES)
def test_every_change_keeps_the_bound(plant: str, before: Mode, after: Mode) -> None:
    require_bound(plant, before, after, range(15, 700, 40))


def test_the_bound_is_tight() -> None:
    assert max(largest_steps("ideal", Mode.RUN, Mode.COMPLIANCE, range(490, 520, 10))) > 0.8 * stated_V()
