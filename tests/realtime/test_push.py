"""A push by an operator's hand: what the joint does under it, and that it is let go of for sure."""

import math

import numpy as np
import pytest

from backend.realtime.commands import (
    Accepted,
    ApplyPush,
    PushReleased,
    Refused,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
)
from backend.realtime.modes import Mode
from backend.realtime.program import Law, Program, Segment
from plant.parameters import PlantParameters, load_parameters
from plant.simulator import Simulator
from tests.realtime.bench_top import BenchTop

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


def test_with_the_joint_loop_open_geometry_alone_takes_the_joint_to_q_ref(ideal: PlantParameters) -> None:
    bench = controlled(ideal, Mode.COMPLIANCE)
    bench.send(SetReferences(0.4, S_REF))
    bench.advance(2.0)
    assert bench.column("q", last=1)[0] == pytest.approx(0.4, abs=2e-3)


def test_a_push_moves_the_joint_as_statics_say_and_only_a_closed_loop_brings_it_back(ideal: PlantParameters) -> None:
    """At rest the springs carry the push: τ = r_j F = S (q − q_ref), whatever q_ref (equation 14)."""
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


def test_a_push_is_let_go_when_its_time_is_over(ideal: PlantParameters) -> None:
    bench = controlled(ideal, Mode.COMPLIANCE)
    bench.send(ApplyPush(5.0, 0.7))
    bench.advance(2.0)
    pushed = np.flatnonzero(bench.column("F_push", last=2000) == 5.0)
    assert pushed.size == 700
    assert np.all(np.diff(pushed) == 1)
    assert bench.column("q", last=1)[0] == pytest.approx(0.0, abs=2e-3)
    assert [event.why for event in bench.events if isinstance(event, PushReleased)] == ["its time is over"]


@pytest.mark.parametrize(
    "leave",
    [Stop(), Stop(hard=False), SetMode(Mode.PRETENSION), SetMode(Mode.STOPPING)],
    ids=["stop", "lost", "pretension", "soft stop"],
)
def test_a_push_is_let_go_with_the_mode(ideal: PlantParameters, leave: Stop | SetMode) -> None:
    bench = controlled(ideal, Mode.COMPLIANCE)
    bench.send(ApplyPush(5.0, 9.0))
    bench.advance(0.2)
    bench.send(leave)
    bench.advance(0.005)
    assert bench.column("F_push", last=1)[0] == 0.0
    assert [event.why for event in bench.events if isinstance(event, PushReleased)] == [
        f"the mode is {bench.loop.mode}"
    ]


def test_a_push_of_zero_lets_go_at_once_and_a_new_one_takes_the_place_of_the_old(ideal: PlantParameters) -> None:
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


def test_a_push_is_refused_where_no_hand_may_push(ideal: PlantParameters) -> None:
    bench = BenchTop(ideal)
    bench.wind_up()
    refused = bench.send(ApplyPush(5.0, 1.0))
    assert isinstance(refused, Refused)
    assert "run" in refused.reason
    assert "compliance" in refused.reason
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
    assert "pretension" in refused.reason
    assert bench.loop.mode is Mode.RUN


class Pushed(Simulator):
    """A simulator that tells what it is pushed with [N]."""

    force = 0.0

    def push(self, F_push: float) -> None:
        self.force = F_push
        super().push(F_push)


def test_the_plant_is_pushed_from_the_first_tick_of_a_segment_on_and_the_sample_says_so(ideal: PlantParameters) -> None:
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
