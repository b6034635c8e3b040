"""A contact is felt and the joint gives way: how soon, how soft, and until when."""

import math
from typing import TypeVar

import numpy as np
import pytest

from backend.faults import Limit
from backend.realtime.commands import (
    Accepted,
    ApplyPush,
    ModeChanged,
    Refused,
    RunEnded,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
)
from backend.realtime.contact import TAIL_S
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import MODE_CODE, Cause, Mode
from backend.realtime.program import ConfigureContactDetection, ContactDetected, Law, Program, Segment, Shape
from backend.tuning.gains import TuningParameters
from plant.dynamics import Obstacle
from plant.parameters import load_parameters
from tests.realtime.bench_top import BenchTop

_E = TypeVar("_E")

FROM_N = 1.5
LAB = {8.0: -0.25, 10.0: -0.49, 12.0: -0.85, 14.0: -1.22, 15.0: -1.37}
"""Bias [N] over S [N·m/rad] of the set lab, whose springs are 3 % apart, with the motors' zeros known exactly."""


def armed() -> BenchTop:
    """In run at 0.3 rad and 12 N·m/rad, with the bias learned: how the zeros were found moves it as a whole."""
    bench = BenchTop(load_parameters("lab"))
    bench.run(run=7)
    bench.send(SetReferences(0.3, 12.0))
    bench.advance(3.0)
    off = float(np.mean(bench.column("F_ext_hat", last=500))) - LAB[12.0]
    assert isinstance(
        bench.send(ConfigureContactDetection(tuple((S, F + off) for S, F in LAB.items()), FROM_N)), Accepted
    )
    return bench


def told(bench: BenchTop, kind: type[_E]) -> list[_E]:
    return [event for event in bench.events if isinstance(event, kind)]


def test_the_row_has_the_outside_force_less_what_was_learned() -> None:
    bench = armed()
    bench.advance(0.2)
    assert bench.column("F_ext_hat", last=200) == pytest.approx(0.0, abs=0.25)
    bench.send(ConfigureContactDetection(((12.0, 3.0),), 0.0))
    bench.advance(0.001)
    bias = bench.column("F_ext_hat", last=1)[0] + 3.0
    bench.send(ConfigureContactDetection(((12.0, bias),), 0.0))
    bench.send(ApplyPush(-4.0, 1.0))
    bench.advance(0.5)
    assert np.mean(bench.column("F_ext_hat", last=100)) == pytest.approx(-4.0, abs=0.3)
    assert bench.loop.mode is Mode.RUN  # nothing is reacted to


def test_nothing_is_known_before_the_motors_have_their_zeros() -> None:
    bench = BenchTop(load_parameters("lab"))
    bench.advance(0.01)
    assert np.all(np.isnan(bench.column("F_ext_hat")))
    bench.send(ConfigureContactDetection((), FROM_N))
    bench.wind_up()
    assert math.isfinite(bench.column("F_ext_hat", last=1)[0])
    assert told(bench, ContactDetected) == []  # in pretension nothing is followed that could give way


@pytest.mark.parametrize("F_push", [5.0, -5.0])
def test_the_joint_gives_way_in_the_tick_in_which_a_contact_is_felt(F_push: float) -> None:
    bench = armed()
    begun = len(bench.samples.rows)
    bench.send(ApplyPush(F_push, 4.0))
    bench.advance(2.6)
    (felt,) = told(bench, ContactDetected)
    assert felt.tick - begun <= 15
    assert math.copysign(1.0, felt.F_ext_hat) == math.copysign(1.0, F_push)
    estimate, mode, limits = (bench.column(name) for name in ("F_ext_hat", "mode", "limits"))
    over = begun + int(np.argmax(np.abs(estimate[begun:]) > FROM_N))
    assert felt.tick == over
    assert felt.F_ext_hat == estimate[over]
    changed = int(np.argmax(mode == MODE_CODE[Mode.COMPLIANCE]))
    assert changed == over  # asked: within two ticks of the threshold
    assert limits[over - 1].astype(int) & Limit.CONTACT == 0
    assert np.all(limits[over:].astype(int) & Limit.CONTACT)
    assert told(bench, ModeChanged)[-1].cause is Cause.CONTACT
    q, S = bench.column("q"), bench.column("S")
    assert np.mean(S[-100:]) == pytest.approx(bench.loop.bounds.S_min, abs=0.3)  # as slowly as λ_S has it
    assert np.mean(q[-100:]) == pytest.approx(q[over] + 0.075 * F_push / 8.0, abs=0.03)  # statics, equation 14
    assert min(bench.column("F_A", last=2000).min(), bench.column("F_B", last=2000).min()) > 1.0
    assert np.all(bench.column("run", last=2000) == 7)


def test_until_a_mode_is_chosen_again_references_are_refused_and_then_it_feels_anew() -> None:
    bench = armed()
    bench.send(ApplyPush(5.0, 0.5))
    bench.advance(2.0)
    refused = bench.send(SetReferences(0.0, 12.0))
    assert isinstance(refused, Refused)
    assert "gives way" in refused.reason
    assert bench.column("q_ref", last=1)[0] == pytest.approx(0.3, abs=0.05)
    u = bench.column("u_A", last=1)[0]
    assert isinstance(bench.send(SetMode(Mode.RUN, 7)), Accepted)
    bench.advance(0.001)
    assert bench.column("u_A", last=1)[0] == pytest.approx(u, abs=0.2)
    assert int(bench.column("limits", last=1)[0]) & Limit.CONTACT == 0
    assert isinstance(bench.send(SetReferences(0.0, 12.0)), Accepted)
    bench.advance(3.0)
    assert bench.column("q", last=1)[0] == pytest.approx(0.0, abs=0.02)
    bench.send(ApplyPush(-5.0, 0.5))
    bench.advance(0.1)
    assert len(told(bench, ContactDetected)) == 2


def test_a_contact_ends_a_program_whose_run_holds_what_came_of_it() -> None:
    bench = armed()
    segments = (Segment(1.0, 0.3, 12.0), Segment(1.0, 0.3, 12.0, 6.0), Segment(5.0, 0.3, 12.0))
    assert isinstance(bench.send(RunProgram(Program(Law.CASCADE, segments), 8)), Accepted)
    bench.advance(4.0)
    (felt,) = told(bench, ContactDetected)
    ended = told(bench, RunEnded)[-1]
    assert (ended.run, ended.completed, ended.why) == (8, False, Cause.CONTACT)
    assert ended.tick - felt.tick == pytest.approx(1000 * TAIL_S, abs=2)
    assert bench.loop.mode is Mode.COMPLIANCE
    F_push, run = bench.column("F_push"), bench.column("run")
    assert F_push[felt.tick + 300] == 6.0  # whoever pushes still does
    assert F_push[-1] == 0.0
    assert set(run[felt.tick : ended.tick]) == {8.0}
    assert run[-1] == 0.0
    assert int(bench.column("limits", last=1)[0]) & Limit.CONTACT


def test_fast_moves_are_no_contact() -> None:
    bench = armed()
    for q_ref, S_ref in ((-1.0, 8.0), (1.0, 15.0), (0.0, 10.0)):
        bench.send(SetReferences(q_ref, S_ref))
        bench.advance(1.5)
    assert told(bench, ContactDetected) == []
    assert np.max(np.abs(bench.column("F_ext_hat", last=4000))) < 0.7


def test_a_stop_goes_before_a_contact() -> None:
    bench = armed()
    bench.send(ApplyPush(5.0, 2.0))
    bench.advance(0.1)
    bench.send(Stop())
    bench.advance(0.1)
    assert bench.loop.mode is Mode.TRIPPED
    assert int(bench.column("limits", last=1)[0]) & Limit.CONTACT == 0


@pytest.mark.parametrize(
    ("command", "words"),
    [
        (ConfigureContactDetection((), 0.5), "1"),
        (ConfigureContactDetection((), 100.0), "30"),
        (ConfigureContactDetection((), -2.0), "1"),
        (ConfigureContactDetection((), math.nan), "contact_N"),
        (ConfigureContactDetection(((10.0, 0.1), (8.0, 0.2)), 0.0), "rise"),
        (ConfigureContactDetection(((8.0, math.nan),), 0.0), "rise"),
        (ConfigureContactDetection(tuple((8.0 + 0.1 * k, 0.0) for k in range(65)), 0.0), "64"),
    ],
)
def test_what_makes_no_sense_is_refused_and_what_was_stays(command: ConfigureContactDetection, words: str) -> None:
    bench = armed()
    refused = bench.send(command)
    assert isinstance(refused, Refused)
    assert words in refused.reason
    bench.send(ApplyPush(5.0, 0.5))
    bench.advance(0.1)
    assert len(told(bench, ContactDetected)) == 1


def test_a_wall_that_a_program_has_put_up_stays_until_its_run_has_ended() -> None:
    bench = armed()
    segments = (Segment(1.0, 0.3, 12.0, wall=1), Segment(3.0, 0.8, 12.0))
    program = Program(Law.CASCADE, segments, walls=(Obstacle(1.0, 0.5, 5e3, 0.0),))
    assert isinstance(bench.send(RunProgram(program, 8)), Accepted)
    bench.advance(4.0)
    (felt,) = told(bench, ContactDetected)
    ended = told(bench, RunEnded)[-1]
    F_wall = bench.column("F_wall")
    assert F_wall[felt.tick - 15 : felt.tick].min() < -FROM_N  # it was felt a moment after it was touched
    pressing = F_wall[felt.tick : ended.tick]
    assert pressing.min() < -FROM_N
    assert abs(pressing[-1]) < abs(pressing.min())  # softer and softer
    assert ended.why is Cause.CONTACT
    assert F_wall[-1] == 0.0


def hit(v: float, contact_N: float) -> tuple[float, float, BenchTop]:
    """Peak [N] and impulse [N·s] of half a second from the touch of a wall at ``v`` [rad/s], at 15 N·m/rad."""
    lab = load_parameters("lab")
    bench = BenchTop(lab, make_tuning_command(lab, TuningParameters(), u_plan=8.5))
    bench.run()
    bench.send(SetReferences(-0.3, 15.0))
    bench.advance(4.0)
    bench.send(ConfigureContactDetection(((15.0, float(np.mean(bench.column("F_ext_hat", last=1000)))),), contact_N))
    way = 0.51 + 0.025 * v
    parts = (
        Segment(0.5, -0.3, 15.0, wall=1),
        Segment(way / v, way - 0.3, 15.0, shape=Shape.RAMP),
        Segment(0.1, way - 0.3, 15.0),
        Segment(1.0, -0.3, 15.0, shape=Shape.RAMP),
    )
    begun = len(bench.samples.rows)
    bench.send(RunProgram(Program(Law.CASCADE, parts, walls=(Obstacle(1.0, 0.2, 2e4, 1.0),)), 8))
    bench.advance(0.5 + way / v + 0.6)
    F_wall = -bench.column("F_wall")[begun:]
    pressed = F_wall[int(np.argmax(F_wall > 0.0)) :][:500]
    return float(pressed.max()), float(pressed.sum()) * 1e-3, bench


def test_giving_way_takes_a_third_of_the_impulse_and_something_of_the_peak() -> None:
    for v in (0.2, 0.6):
        peak, impulse, _ = hit(v, 0.0)
        softer_peak, softer_impulse, bench = hit(v, FROM_N)
        assert softer_impulse < 0.67 * impulse
        assert softer_peak < peak
        assert len(told(bench, ContactDetected)) == 1


def test_giving_way_saves_a_stiff_joint_from_a_trip() -> None:
    _, _, bench = hit(1.2, 0.0)
    assert bench.loop.mode is Mode.TRIPPED
    _, _, bench = hit(1.2, FROM_N)
    assert bench.loop.mode is Mode.COMPLIANCE
