"""Simulated pushes and obstacles in the loop."""

import math
import re

import numpy as np
import pytest

from backend.faults import Fault
from backend.realtime import messages
from backend.realtime.commands import (
    Accepted,
    ApplyPush,
    Obstruct,
    PushReleased,
    Refused,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
    Stopped,
)
from backend.realtime.modes import Mode
from backend.realtime.program import MAX_WALLS, Law, Program, Segment, Shape, TensionLeg
from plant.dynamics import Obstacle
from plant.messages import joint_inside_obstacle
from plant.parameters import PlantParameters, load_parameters
from plant.quantity import Angle
from plant.simulator import Simulator
from tests.realtime.bench_top import BenchTop
from tests.reasons import Reason, TextWith, assert_reason

# A push by an operator: the response of the joint, and the guaranteed end of the push.

R_J = 0.075
S_REF = 10.0


@pytest.fixture(scope="module")
def ideal() -> PlantParameters:
    return load_parameters("ideal")


def controlled(parameters: PlantParameters, mode: Mode, q_ref: float = 0.0) -> BenchTop:
    bench = BenchTop(parameters)
    bench.run()
    bench.send(SetReferences(q_ref, S_REF))
    bench.advance(3.0)
    if mode is Mode.COMPLIANCE:
        bench.send(SetMode(mode))
        bench.send(SetReferences(q_ref, S_REF))
        bench.advance(0.5)
    return bench


def test_geometry_alone_moves_the_joint_to_q_ref_with_an_open_joint_loop(ideal: PlantParameters) -> None:
    bench = controlled(ideal, Mode.COMPLIANCE)
    bench.send(SetReferences(0.4, S_REF))
    bench.advance(2.0)
    assert bench.column("q", last=1)[0] == pytest.approx(0.4, abs=2e-3)


def test_a_push_moves_the_joint_by_statics_and_only_a_closed_loop_returns_it(ideal: PlantParameters) -> None:
    """At rest the springs bear the push: τ = r_j F = S (q − q_ref), for every q_ref (equation 14)."""
    for F_push in (6.0, -9.0):
        bench = controlled(ideal, Mode.COMPLIANCE, q_ref=0.3)
        bench.send(ApplyPush(F_push, 4.0))
        bench.advance(3.0)
        assert bench.column("F_push", last=1)[0] == F_push
        q, S = (bench.column(name, last=1)[0] for name in ("q", "S"))
        assert pytest.approx(S_REF, abs=0.02) == S
        assert q - 0.3 == pytest.approx(R_J * F_push / S, rel=0.02)
        F_A, F_B = (bench.column(name, last=1)[0] for name in ("F_A", "F_B"))
        assert pytest.approx(-F_push, abs=0.05) == F_A - F_B
        bench.send(SetMode(Mode.RUN))
        bench.send(SetReferences(0.3, S_REF))
        bench.send(ApplyPush(F_push, 8.0))
        bench.advance(5.0)
        assert bench.column("q", last=1)[0] == pytest.approx(0.3, abs=2e-3)
        assert bench.column("F_push", last=1)[0] == F_push


def test_a_push_ends_after_its_duration(ideal: PlantParameters) -> None:
    bench = controlled(ideal, Mode.COMPLIANCE)
    bench.send(ApplyPush(5.0, 0.7))
    bench.advance(2.0)
    pushed = np.flatnonzero(bench.column("F_push", last=2000) == 5.0)
    assert pushed.size == 700
    assert np.all(np.diff(pushed) == 1)
    assert bench.column("q", last=1)[0] == pytest.approx(0.0, abs=2e-3)
    assert [event.why for event in bench.events if isinstance(event, PushReleased)] == [
        messages.push_duration_elapsed()
    ]


@pytest.mark.parametrize(
    "leave",
    [Stop(), Stop(hard=False), SetMode(Mode.PRETENSION), SetMode(Mode.STOPPING)],
    ids=["stop", "lost", "pretension", "soft stop"],
)
def test_a_push_ends_with_its_mode(ideal: PlantParameters, leave: Stop | SetMode) -> None:
    bench = controlled(ideal, Mode.COMPLIANCE)
    bench.send(ApplyPush(5.0, 9.0))
    bench.advance(0.2)
    bench.send(leave)
    bench.advance(0.005)
    assert bench.column("F_push", last=1)[0] == 0.0
    assert [event.why for event in bench.events if isinstance(event, PushReleased)] == [
        messages.push_ended_by_mode(mode=bench.loop.mode)
    ]


def test_a_push_of_zero_ends_the_push_and_a_new_push_replaces_the_old_one(ideal: PlantParameters) -> None:
    bench = controlled(ideal, Mode.COMPLIANCE)
    bench.send(ApplyPush(5.0, 9.0))
    bench.advance(0.1)
    bench.send(ApplyPush(-4.0, 0.1))
    bench.advance(0.05)
    assert bench.column("F_push", last=1)[0] == -4.0
    bench.advance(0.1)
    assert bench.column("F_push", last=1)[0] == 0.0
    bench.send(ApplyPush(5.0, 9.0))
    bench.advance(0.1)
    bench.send(ApplyPush(0.0, 1.0))
    bench.advance(0.01)
    assert bench.column("F_push", last=1)[0] == 0.0


def test_a_push_is_rejected_in_modes_without_pushes(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    refused = bench.send(ApplyPush(5.0, 1.0))
    assert isinstance(refused, Refused)
    pushed_in = (Mode.RUN, Mode.COMPLIANCE)
    assert_reason(refused.reason, "push_not_in_mode", mode=Mode.PRETENSION, push_modes=pushed_in)
    program = Program(Law.CASCADE, (Segment(2.0, 0.0, S_REF, F_push=3.0),))
    assert isinstance(bench.send(RunProgram(program)), Accepted)
    bench.advance(0.5)
    assert isinstance(bench.send(ApplyPush(5.0, 1.0)), Refused)
    assert bench.column("F_push", last=1)[0] == 3.0
    bench = controlled(ideal, Mode.RUN)
    for push in (ApplyPush(math.nan, 1.0), ApplyPush(5.0, math.nan), ApplyPush(5.0, 60.0), ApplyPush(5.0, -1.0)):
        assert isinstance(bench.send(push), Refused)
    bench.advance(0.01)
    assert not bench.column("F_push", last=10).any()


def test_a_compliance_program_starts_from_pretension_only(ideal: PlantParameters) -> None:
    bench = controlled(ideal, Mode.RUN, q_ref=math.radians(15.0))
    program = Program(Law.COMPLIANCE, (Segment(1.0, 0.0, S_REF),))
    refused = bench.send(RunProgram(program))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, "law_requires_pretension", law=Law.COMPLIANCE)
    assert bench.loop.mode is Mode.RUN


class Pushed(Simulator):
    """A simulator that records the pushes that it receives [N]."""

    force = 0.0

    def push(self, F_push: float) -> None:
        self.force = F_push
        super().push(F_push)


def test_the_push_starts_in_the_first_tick_of_its_segment_and_is_in_the_sample(ideal: PlantParameters) -> None:
    plant = Pushed(ideal)
    bench = BenchTop(ideal, plant=plant)
    bench.wind_up()
    forces = (0.0, 3.0, 3.0, -2.0, 0.0)
    program = Program(Law.CASCADE, tuple(Segment(0.004, 0.0, S_REF, F_push=F) for F in forces))
    assert isinstance(bench.send(RunProgram(program)), Accepted)
    said, done = [], []
    while bench.loop.mode is Mode.EXPERIMENT:
        bench.advance(0.001)
        said.append(bench.column("F_push", last=1)[0])
        done.append(plant.force)
    assert done == [*np.repeat(forces, 4), 0.0]
    assert said[1:] == done[:-1]  # a sample says what acted on the period that it ends


# An obstacle, commanded by an operator and by a program: when it acts, and who removes it.

ABOVE, BELOW = Obstacle(1.0, 0.15, 2e4, 1.0), Obstacle(-1.0, -0.15, 1e4, 1.0)
THERE = Segment(0.4, 0.3, 10.0, shape=Shape.RAMP)
BACK = Segment(0.4, 0.0, 10.0, shape=Shape.RAMP)


def running(parameters: PlantParameters) -> BenchTop:
    bench = BenchTop(parameters)
    bench.run()
    bench.send(SetReferences(0.0, 10.0))
    bench.advance(0.5)
    return bench


def standing(bench: BenchTop) -> Obstacle | None:
    assert isinstance(bench.plant, Simulator)
    wall: Obstacle = bench.plant.simulated.field("obstacle").get()
    return wall if wall.side else None


def test_an_operator_sets_and_removes_an_obstacle_in_motion_and_statics_hold(ideal: PlantParameters) -> None:
    """At rest the wall bears the spring force: r_j F_wall = −S (q_e − q), and F_A − F_B = −F_wall."""
    bench = running(ideal)
    assert bench.column("F_wall", last=1)[0] == 0.0
    bench.send(SetMode(Mode.COMPLIANCE))
    bench.send(SetReferences(0.0, 10.0))
    assert isinstance(bench.send(Obstruct(ABOVE)), Accepted)
    bench.send(SetReferences(0.3, 10.0))
    bench.advance(2.5)
    F, q, F_A, F_B = (bench.column(name, last=1)[0] for name in ("F_wall", "q", "F_A", "F_B"))
    assert pytest.approx(-10.0 * (0.3 - q) / R_J, rel=0.02) == F
    assert pytest.approx(F_A - F_B, rel=1e-2) == -F
    assert q == pytest.approx(0.15 - F / 2e4 / R_J, abs=1e-5)
    assert isinstance(bench.send(Obstruct(None)), Accepted)
    bench.advance(1.0)
    assert bench.column("F_wall", last=1)[0] == 0.0
    assert bench.column("q", last=1)[0] == pytest.approx(0.3, abs=2e-3)


def test_invalid_obstacles_are_rejected_with_the_reason_and_nothing_trips(ideal: PlantParameters) -> None:
    bench = running(ideal)
    for wall, told in (
        (ABOVE._replace(q_wall=-0.1), Reason("joint_inside_obstacle", q_wall=-0.1)),
        (ABOVE._replace(k_wall=1e6), TextWith(re.escape("1e+06 N/m is outside 100 to"))),
        (ABOVE._replace(q_wall=math.nan), TextWith(f": {Angle(math.nan)}")),
    ):
        refused = bench.send(Obstruct(wall))
        assert isinstance(refused, Refused)
        assert refused.reason == told
    bench.advance(0.1)
    assert (bench.loop.mode, bench.loop.fault) == (Mode.RUN, Fault.NONE)


class Bare:
    """A plant like a rig: it implements the protocol, but has no obstacle."""

    def __init__(self, simulator: Simulator) -> None:
        self._simulator = simulator

    def __getattr__(self, name: str) -> object:
        if name == "obstacle":
            raise AttributeError(name)
        return getattr(self._simulator, name)


def test_a_plant_without_obstacles_rejects_those_of_operators_and_programs(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal, plant=Bare(Simulator(ideal)))  # type: ignore[arg-type]  # by its attributes it is one
    bench.wind_up()
    program = Program(Law.CASCADE, (Segment(0.1, 0.0, 10.0, wall=1),), walls=(ABOVE,))
    for command in (Obstruct(ABOVE), Obstruct(None), RunProgram(program)):
        refused = bench.send(command)
        assert isinstance(refused, Refused)
        assert_reason(refused.reason, "plant_without_obstacles")
    assert bench.loop.mode is Mode.PRETENSION


@pytest.mark.parametrize("stopped", [False, True])
def test_the_operators_obstacle_is_restored_after_a_program_with_its_own(ideal: PlantParameters, stopped: bool) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    bench.send(Obstruct(BELOW))
    segments = (
        Segment(0.2, 0.0, 10.0), Segment(0.1, 0.0, 10.0, wall=1), THERE, Segment(1.0, 0.3, 10.0), BACK,
        Segment(0.2, 0.0, 10.0, wall=2), THERE,
    )  # fmt: skip
    assert isinstance(bench.send(RunProgram(Program(Law.CASCADE, segments, walls=(ABOVE, None)))), Accepted)
    seen = []
    for _ in range(3000):
        bench.advance(0.001)
        seen.append((standing(bench), bench.column("F_wall", last=1)[0]))
        if stopped and len(seen) == 1500:
            refused = bench.send(Obstruct(None))
            assert isinstance(refused, Refused)
            assert_reason(refused.reason, "program_sets_obstacles")
            bench.send(SetMode(Mode.STOPPING))
        if bench.loop.mode is not Mode.EXPERIMENT:
            break
    walls = [wall for wall, _ in seen]
    assert walls[199:202] == [BELOW, ABOVE, ABOVE]
    assert not any([F for wall, F in seen if wall is None][1:])  # the first was measured before it was taken away
    assert min(F for _, F in seen) < -1.0
    assert standing(bench) == BELOW
    assert walls.count(None) == (0 if stopped else pytest.approx(600, abs=2))
    assert isinstance(bench.send(Obstruct(None)), Accepted)


def test_an_obstacle_of_a_program_inside_the_joint_trips_with_a_remedy(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    bench.send(
        RunProgram(Program(Law.CASCADE, (Segment(2.0, 0.3, 10.0), Segment(1.0, 0.0, 10.0, wall=1)), walls=(ABOVE,)))
    )
    bench.advance(2.2)
    stop = next(event for event in bench.events if isinstance(event, Stopped))
    assert stop.fault is Fault.PLANT_ERROR
    seen = joint_inside_obstacle(q=0.0, q_wall=ABOVE.q_wall, side=ABOVE.side)
    assert stop.detail.partition(", ")[2] == seen.partition(", ")[2]
    assert standing(bench) is None


@pytest.mark.parametrize(
    ("program", "code", "values"),
    [
        (
            Program(Law.CASCADE, (Segment(0.1, 0.0, 10.0, wall=2),), walls=(ABOVE,)),
            "unknown_obstacle",
            {"number": 2, "count": 1},
        ),
        (
            Program(Law.CASCADE, (Segment(0.1, 0.0, 10.0, wall=-1),)),
            "unknown_obstacle",
            {"number": -1, "count": 0},
        ),
        (
            Program(Law.TENSION_SWEEP, tension_N=8.0, legs=(TensionLeg(20.0, 0.5),), walls=(ABOVE,)),
            "law_without_obstacle",
            {"law": Law.TENSION_SWEEP},
        ),
    ],
)
def test_programs_with_invalid_obstacles_are_rejected_before_motion(
    ideal: PlantParameters, program: Program, code: str, values: dict[str, object]
) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    refused = bench.send(RunProgram(program))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, code, **values)
    assert bench.loop.mode is Mode.PRETENSION


def test_programs_with_too_many_obstacles_are_rejected_before_motion(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    program = Program(Law.CASCADE, (Segment(0.1, 0.0, 10.0),), walls=(None,) * (MAX_WALLS + 1))
    refused = bench.send(RunProgram(program))
    assert isinstance(refused, Refused)
    assert messages.number_of_obstacle_changes() in refused.reason
    assert bench.loop.mode is Mode.PRETENSION


def test_an_obstacle_is_active_from_the_first_tick_of_its_segment(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    walls = (ABOVE, BELOW, None)
    segments = tuple(Segment(0.004, 0.0, 10.0, wall=wall) for wall in (0, 1, 0, 2, 3))
    bench.send(RunProgram(Program(Law.CASCADE, segments, walls=walls)))
    stood = []
    while bench.loop.mode is Mode.EXPERIMENT:
        bench.advance(0.001)
        stood.append(standing(bench))
    expected = np.repeat([0, 1, 1, 2, 0], 4)
    assert stood == [*[(None, ABOVE, BELOW)[at] for at in expected], None]
