"""A program with contacts of its own: a part ends, the joint gives way, and the program goes on in time."""

import math
from dataclasses import replace
from typing import TypeVar

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.faults import Limit
from backend.realtime.commands import (
    Accepted,
    Refused,
    RunEnded,
    RunProgram,
    SetMode,
    SetReferences,
    Stop,
    TuningChanged,
    WallChanged,
)
from backend.realtime.gains import make_tuning_command
from backend.realtime.modes import MODE_CODE, Cause, Mode
from backend.realtime.program import (
    MAX_CONTACT_DETECTIONS,
    ConfigureContactDetection,
    ContactDetected,
    ContactDetection,
    Law,
    Program,
    Segment,
    Shape,
)
from backend.tuning.gains import TuningParameters
from plant.dynamics import Obstacle
from plant.parameters import load_parameters
from tests.realtime.bench_top import BenchTop

_E = TypeVar("_E")

LAB = load_parameters("lab")
FROM_N = 1.5
WALL = Obstacle(1.0, 0.2, 2e4, 1.0)
PARTS = (
    Segment(3.0, 0.0, 12.0, wall=1),
    Segment(1.0, 0.23, 12.0, shape=Shape.RAMP, contact_detection=1),
    Segment(1.0, 0.23, 12.0),
    Segment(1.0, 0.0, 12.0, shape=Shape.RAMP, contact_detection=2),
    Segment(2.0, 0.0, 12.0),
)
"""3 s of rest at 12 N·m/rad, a ramp into the wall within a second, a second there, and back."""

HITS = Program(
    Law.CASCADE,
    PARTS,
    walls=(WALL,),
    contact_detections=(ContactDetection(FROM_N, calibrates_bias=True), ContactDetection()),
)
NEVER = replace(HITS, contact_detections=(ContactDetection(), ContactDetection()))
PRESSED, BACK = 3000, 5000
"""Ticks of the program from which on, and up to which, a contact ends what is played."""


def played(program: Program, seconds: float = 0.0) -> tuple[BenchTop, int]:
    """The bench after a program, or so long into it; the tick in which it begins."""
    bench = BenchTop(LAB, make_tuning_command(LAB, TuningParameters(), u_plan=8.5))
    bench.wind_up()
    begun = len(bench.samples.rows)
    assert isinstance(bench.send(RunProgram(program, 8)), Accepted)
    bench.advance(seconds or program.duration_s + 0.1)
    return bench, begun


def gives_way(bench: BenchTop, begun: int) -> NDArray[np.int64]:
    return np.flatnonzero(bench.column("limits")[begun:].astype(int) & Limit.CONTACT)


def told(bench: BenchTop, kind: type[_E]) -> list[_E]:
    return [event for event in bench.events if isinstance(event, kind)]


def test_the_joint_gives_way_from_the_tick_in_which_it_is_felt_until_its_part_is_over() -> None:
    bench, begun = played(HITS)
    reacting = gives_way(bench, begun)
    estimate = np.abs(bench.column("F_ext_hat")[begun:])
    over = PRESSED + int(np.argmax(estimate[PRESSED:] > FROM_N))
    assert reacting[0] == over
    assert np.array_equal(reacting, np.arange(over, BACK - 1))  # in the last tick it is over
    S, F_wall = bench.column("S")[begun:], np.abs(bench.column("F_wall")[begun:])
    assert S[BACK - 1] == pytest.approx(bench.loop.bounds.S_min, abs=1.0)
    assert S[-500] == pytest.approx(12.0, abs=0.1)
    assert F_wall[BACK - 200 : BACK].max() < 0.5 * FROM_N  # it leans on the wall no more
    never, _ = played(NEVER)
    assert F_wall.sum() < 0.5 * np.abs(never.column("F_wall")).sum()


def test_the_program_goes_on_in_time_as_one_run() -> None:
    bench, begun = played(HITS)
    never, _ = played(NEVER)
    ended, plainly = told(bench, RunEnded)[-1], told(never, RunEnded)[-1]
    assert (ended.run, ended.completed, ended.why) == (8, True, Cause.PROGRAM_ENDED)
    assert ended.tick == plainly.tick
    for name in ("q_ref", "S_ref"):
        one, other = (each.column(name)[begun + BACK + 1000 : ended.tick] for each in (bench, never))
        assert np.array_equal(one, other)
    assert set(bench.column("mode")[begun : ended.tick]) == {MODE_CODE[Mode.EXPERIMENT]}
    assert set(bench.column("run")[begun : ended.tick]) == {8.0}
    assert told(bench, ContactDetected) == []  # nobody has to choose a mode
    assert bench.column("F_A")[begun:].min() > 1.0


def test_no_voltage_jumps_where_it_gives_way_or_goes_on() -> None:
    bench, begun = played(HITS)
    for name in ("u_A", "u_B"):
        u = bench.column(name)[begun:]
        first = gives_way(bench, begun)[0]
        step = 8.5 / 10  # of a plan, whose voltages are averaged over 10 ms; twice that from full to full reverse
        assert abs(u[first] - u[first - 1]) < 2.0 * step
        assert abs(u[BACK] - u[BACK - 1]) < step + 0.05


def test_what_the_operator_has_learned_is_in_force_before_and_after_it() -> None:
    bench = BenchTop(LAB, make_tuning_command(LAB, TuningParameters(), u_plan=8.5))
    bench.run()
    bench.send(SetReferences(0.0, 12.0))
    bench.advance(4.0)
    bench.send(ConfigureContactDetection(((12.0, 5.0),), 0.0))
    bench.advance(0.001)
    before = bench.column("F_ext_hat", last=1)[0]
    begun = len(bench.samples.rows)
    bench.send(RunProgram(HITS, 8))
    bench.advance(HITS.duration_s)
    estimate = bench.column("F_ext_hat")[begun:]
    assert estimate[:2900] == pytest.approx(before, abs=0.5)
    assert estimate[3010:3500] == pytest.approx(0.0, abs=0.3)
    assert gives_way(bench, begun).size
    bench.advance(6.0)
    assert bench.column("F_ext_hat", last=1)[0] < -3.0  # 5 N are taken off again


def test_a_contact_in_another_part_is_none() -> None:
    unlike = (
        *PARTS[:1],
        Segment(1.0, 0.23, 12.0, shape=Shape.RAMP),
        PARTS[2],
        replace(PARTS[3], contact_detection=1),
        PARTS[4],
    )
    bench, begun = played(replace(HITS, segments=unlike, contact_detections=(ContactDetection(calibrates_bias=True),)))
    assert gives_way(bench, begun).size == 0
    assert np.abs(bench.column("F_wall")).max() > FROM_N


@pytest.mark.parametrize("why", ["nothing was learned", "it was learned while a hand moved the joint"])
def test_where_it_is_not_known_what_nothing_reads_it_is_hit_without_reaction(why: str) -> None:
    first = PARTS[0]
    contact_detections: tuple[ContactDetection, ...] = (ContactDetection(FROM_N), ContactDetection())
    before: tuple[Segment, ...] = (first,)
    if why != "nothing was learned":
        shaken = Segment(3.0, 0.0, 12.0, F_push=8.0, shape=Shape.SINE, period_s=0.3, wall=1)
        before, contact_detections = (replace(first, duration_s=0.01), shaken), HITS.contact_detections
    bench, begun = played(replace(HITS, segments=(*before, *PARTS[1:]), contact_detections=contact_detections))
    assert np.abs(bench.column("F_ext_hat")[begun + 3010 :]).max() > FROM_N
    assert gives_way(bench, begun).size == 0
    assert told(bench, RunEnded)[-1].completed


def test_an_operators_reaction_ends_a_program_for_good_and_is_told_of_before() -> None:
    bench = BenchTop(LAB, make_tuning_command(LAB, TuningParameters(), u_plan=8.5))
    bench.run()
    bench.send(SetReferences(0.0, 12.0))
    bench.advance(4.0)
    bias = float(np.mean(bench.column("F_ext_hat", last=1000)))
    bench.send(ConfigureContactDetection(((12.0, bias),), 1.2))
    refused = bench.send(RunProgram(HITS, 8))
    assert isinstance(refused, Refused)
    assert "contacts from 1.2 N on" in refused.reason
    assert told(bench, RunEnded) == []
    assert isinstance(bench.send(RunProgram(NEVER, 8)), Accepted)  # it gives way to nothing by itself
    bench.send(SetMode(Mode.PRETENSION))
    bench.advance(5.0)
    bench.send(ConfigureContactDetection(((12.0, bias),), 0.0))
    assert isinstance(bench.send(RunProgram(HITS, 9)), Accepted)
    bench.advance(3.5)
    bench.send(ConfigureContactDetection(((12.0, bias),), 1.2))  # in flight: it goes before the program's own
    bench.advance(2.0)
    assert told(bench, RunEnded)[-1].why is Cause.CONTACT
    assert bench.loop.mode is Mode.COMPLIANCE


def test_what_was_changed_in_the_part_that_is_over_is_in_force_behind_it() -> None:
    parts = (*PARTS[:2], replace(PARTS[2], tuning=1, wall=2), *PARTS[3:])
    slower = make_tuning_command(LAB, TuningParameters(0.8, 0.6))
    bench, begun = played(replace(HITS, segments=parts, tunings=(slower,), walls=(WALL, None)), 5.01)
    assert gives_way(bench, begun)[0] < 4000
    assert told(bench, TuningChanged)[-1].lam_q == 0.8
    assert told(bench, WallChanged)[-1].wall is None
    assert bench.column("lam_q", last=1)[0] == 0.8


def test_a_part_that_ends_the_program_ends_it_in_time() -> None:
    bench, begun = played(replace(HITS, segments=PARTS[:3]))
    ended = told(bench, RunEnded)[-1]
    assert ended.completed
    assert ended.tick - begun == pytest.approx(BACK, abs=2)
    assert gives_way(bench, begun)[-1] == pytest.approx(BACK, abs=2)


def test_a_stop_while_it_gives_way_is_a_stop_and_nothing_of_it_is_left() -> None:
    bench, begun = played(HITS, 4.5)
    assert gives_way(bench, begun).size
    bench.send(Stop())
    bench.advance(2.0)
    assert bench.loop.mode is Mode.TRIPPED
    assert told(bench, RunEnded)[-1].why is Stop().fault
    assert int(bench.column("limits", last=1)[0]) & Limit.CONTACT == 0
    assert bench.column("F_wall", last=1)[0] == 0.0


@pytest.mark.parametrize(
    ("program", "words"),
    [
        (replace(HITS, contact_detections=(ContactDetection(0.5), ContactDetection())), "0.5 N is outside 1"),
        (replace(HITS, contact_detections=(ContactDetection(31.0), ContactDetection())), "31 N"),
        (replace(HITS, contact_detections=(ContactDetection(math.nan), ContactDetection())), "contact_N"),
        (replace(HITS, contact_detections=(ContactDetection(FROM_N),)), "touch 2 of the program's 1"),
        (
            replace(HITS, contact_detections=(ContactDetection(),) * (MAX_CONTACT_DETECTIONS + 1)),
            "number of changes of what is given way to",
        ),
        (replace(HITS, law=Law.SINGLE_LOOP), "gives way to nothing"),
    ],
)
def test_what_makes_no_sense_is_refused_before_anything_moves(program: Program, words: str) -> None:
    bench = BenchTop(LAB, make_tuning_command(LAB, TuningParameters(), u_plan=8.5))
    bench.wind_up()
    refused = bench.send(RunProgram(program, 8))
    assert isinstance(refused, Refused)
    assert words in refused.reason
    assert bench.loop.mode is Mode.PRETENSION
