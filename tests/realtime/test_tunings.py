"""A program that changes the tuning: which gains are in force when, and that the operator's come back after it."""

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.realtime.commands import Accepted, Command, Refused, Reset, RunProgram, SetMode, Stop, TuningChanged
from backend.realtime.control_loop import Loop
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import Mode
from backend.realtime.program import Law, Program, Segment
from backend.realtime.ring_buffer import Ring
from backend.sample import INDEX
from backend.tuning.gains import TuningParameters
from plant.parameters import load_parameters
from plant.simulator import Simulator

LAB = load_parameters("lab")
OPERATORS = make_tuning_command(LAB, TuningParameters(0.5, 0.5))
SLOWER = make_tuning_command(LAB, TuningParameters(0.9, 0.7))
SEGMENTS = (Segment(0.3, 0.0, 10.0), Segment(0.4, 0.1, 10.0, tuning=1), Segment(0.3, 0.0, 10.0))
WOUND_UP = 5900


class OnTheBench:
    def __init__(self) -> None:
        self.ring = Ring.create(1 << 14)
        self.loop = Loop(Simulator(LAB, seed=1), LAB, self.ring, OPERATORS)
        self.send(SetMode(Mode.PRETENSION))
        self.tick(WOUND_UP)

    def send(self, command: Command) -> Accepted | Refused:
        self.loop.handle(1, command)
        return next(event for event in self.loop.drain_events()[::-1] if isinstance(event, Accepted | Refused))

    def tick(self, ticks: int) -> list[TuningChanged]:
        for _ in range(ticks):
            self.loop.tick()
        return [event for event in self.loop.drain_events() if isinstance(event, TuningChanged)]

    def lam_q(self) -> float:
        newest = self.ring.newest()
        assert newest is not None
        return float(newest[INDEX["lam_q"]])

    def play(self, law: Law = Law.CASCADE) -> Accepted | Refused:
        return self.send(RunProgram(Program(law, SEGMENTS, tunings=(SLOWER,)), run=3))


def test_samples_show_each_tuning_for_as_long_as_it_is_in_force() -> None:
    bench = OnTheBench()
    assert isinstance(bench.play(), Accepted)
    changes = bench.tick(1100)
    _, rows, _ = bench.ring.read(WOUND_UP, 2000)
    played = rows[rows[:, INDEX["run"]] == 3.0]
    slower = played[:, INDEX["lam_q"]] == 0.9
    assert slower.argmax() == pytest.approx(300, abs=1)  # from the first tick of the second segment on
    assert slower[slower.argmax() :].all()
    assert [change.number for change in changes] == [1, 0]
    assert bench.lam_q() == 0.5


@pytest.mark.parametrize(
    "ending", [SetMode(Mode.STOPPING), SetMode(Mode.PRETENSION), Stop(), Stop(hard=False)], ids=repr
)
def test_the_operators_tuning_is_back_however_the_program_ends(ending: Command) -> None:
    bench = OnTheBench()
    bench.play()
    assert [change.number for change in bench.tick(400)] == [1]
    assert bench.lam_q() == 0.9
    bench.loop.handle(2, ending)
    assert [change.number for change in bench.tick(400)] == [0]
    assert bench.lam_q() == 0.5


def test_what_follows_is_as_if_the_tuning_had_never_been_another() -> None:
    """With the motors wound up anew after a reset: no gain of the program has stayed anywhere."""

    def after(tunings: bool) -> NDArray[np.float64]:
        bench = OnTheBench()
        if tunings:
            bench.play()
            bench.tick(400)
        bench.send(Stop())
        bench.tick(3000)
        bench.send(Reset())
        gains = bench.loop._mode_manager.tunings.gains
        return np.concatenate([np.ravel(gains.schedule.entries), np.array(gains.motors).ravel()])

    np.testing.assert_array_equal(after(True), after(False))


def test_an_operator_cannot_change_what_the_program_changes() -> None:
    bench = OnTheBench()
    bench.play()
    bench.tick(100)
    answer = bench.send(SLOWER)
    assert isinstance(answer, Refused)
    assert "the program changes the tuning by itself" in answer.reason
    bench.tick(1000)
    assert isinstance(bench.send(SLOWER), Accepted)


def test_a_law_without_these_gains_refuses_them() -> None:
    bench = OnTheBench()
    answer = bench.play(Law.SINGLE_LOOP)
    assert isinstance(answer, Refused)
    assert "gains are fixed" in answer.reason
    assert bench.loop.mode is Mode.PRETENSION


def test_a_segment_that_wants_a_tuning_that_is_not_there_is_refused_before_anything_moves() -> None:
    bench = OnTheBench()
    answer = bench.send(RunProgram(Program(Law.CASCADE, SEGMENTS)))
    assert isinstance(answer, Refused)
    assert "wants tuning 1 of the program's 0" in answer.reason
