"""Detected contacts, contacts in programs, and disturbance rejection."""

import math
from dataclasses import replace
from typing import TypeVar
from unittest.mock import Mock, call

import numpy as np
import pytest
from numpy.typing import NDArray

from backend.control.motion_types import Setpoint
from backend.faults import Limit
from backend.realtime import messages
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
    TuningChanged,
    WallChanged,
)
from backend.realtime.contact import TAIL_S, ProgramDisturbances
from backend.realtime.gains import build_cascade_tuning, make_tuning_command
from backend.realtime.modes import MODE_CODE, Cause, Mode
from backend.realtime.program import (
    MAX_CONTACT_DETECTIONS,
    ConfigureContactDetection,
    ContactDetected,
    ContactDetection,
    Law,
    Program,
    Segment,
    SetTuning,
    Shape,
)
from backend.tuning.gains import UNSEEN_F, TuningParameters, collect_plant_knowledge
from backend.tuning.simulation import NEAR_RAD, PUSH_N, forecast_push
from plant.dynamics import Obstacle
from plant.parameters import load_parameters
from tests.realtime.bench_top import BenchTop
from tests.reasons import assert_reason

# The contact reaction: its delay, its compliance and its end.

_E = TypeVar("_E")

FROM_N = 1.5
LAB = {8.0: -0.25, 10.0: -0.49, 12.0: -0.85, 14.0: -1.22, 15.0: -1.37}
"""Bias [N] over S [N·m/rad] of the set lab, whose springs are 3 % apart, with the motors' zeros known exactly."""


def armed() -> BenchTop:
    """In run at 0.3 rad and 12 N·m/rad, with the bias measured: errors of the zeros shift the estimate."""
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


def test_samples_hold_the_external_force_minus_the_bias() -> None:
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


def test_the_external_force_is_unknown_until_the_motors_are_zeroed() -> None:
    bench = BenchTop(load_parameters("lab"))
    bench.advance(0.01)
    assert np.all(np.isnan(bench.column("F_ext_hat")))
    bench.send(ConfigureContactDetection((), FROM_N))
    bench.wind_up()
    assert math.isfinite(bench.column("F_ext_hat", last=1)[0])
    assert told(bench, ContactDetected) == []  # in pretension nothing is followed that could give way


@pytest.mark.parametrize("F_push", [5.0, -5.0])
def test_the_contact_reaction_starts_in_the_tick_of_the_detection(F_push: float) -> None:
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


def test_references_are_rejected_after_a_contact_until_a_mode_is_selected() -> None:
    bench = armed()
    bench.send(ApplyPush(5.0, 0.5))
    bench.advance(2.0)
    refused = bench.send(SetReferences(0.0, 12.0))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, "compliant_after_contact")
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


def test_a_contact_ends_the_program_and_its_run_records_the_reaction() -> None:
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


def test_fast_motions_cause_no_contact() -> None:
    bench = armed()
    for q_ref, S_ref in ((-1.0, 8.0), (1.0, 15.0), (0.0, 10.0)):
        bench.send(SetReferences(q_ref, S_ref))
        bench.advance(1.5)
    assert told(bench, ContactDetected) == []
    assert np.max(np.abs(bench.column("F_ext_hat", last=4000))) < 0.7


def test_a_stop_takes_precedence_over_a_contact() -> None:
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
        (ConfigureContactDetection(tuple((8.0 + 0.1 * k, 0.0) for k in range(65)), 0.0), "64"),
    ],
)
def test_invalid_contact_settings_are_rejected_and_the_old_ones_remain(
    command: ConfigureContactDetection, words: str
) -> None:
    bench = armed()
    refused = bench.send(command)
    assert isinstance(refused, Refused)
    assert words in refused.reason
    bench.send(ApplyPush(5.0, 0.5))
    bench.advance(0.1)
    assert len(told(bench, ContactDetected)) == 1


@pytest.mark.parametrize("bias", [((10.0, 0.1), (8.0, 0.2)), ((8.0, math.nan),)])
def test_an_invalid_bias_is_rejected_and_the_old_one_remains(bias: tuple[tuple[float, float], ...]) -> None:
    bench = armed()
    refused = bench.send(ConfigureContactDetection(bias, 0.0))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, "bias_not_increasing")
    bench.send(ApplyPush(5.0, 0.5))
    bench.advance(0.1)
    assert len(told(bench, ContactDetected)) == 1


def test_an_obstacle_of_a_program_remains_until_its_run_has_ended() -> None:
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
    """Peak [N] and impulse [N·s] in the half second after the contact with a wall at ``v`` [rad/s], at 15 N·m/rad."""
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


def test_the_contact_reaction_reduces_the_impulse_by_a_third_and_the_peak() -> None:
    for v in (0.2, 0.6):
        peak, impulse, _ = hit(v, 0.0)
        softer_peak, softer_impulse, bench = hit(v, FROM_N)
        assert softer_impulse < 0.67 * impulse
        assert softer_peak < peak
        assert len(told(bench, ContactDetected)) == 1


def test_the_contact_reaction_prevents_a_trip_of_a_stiff_joint() -> None:
    _, _, bench = hit(1.2, 0.0)
    assert bench.loop.mode is Mode.TRIPPED
    _, _, bench = hit(1.2, FROM_N)
    assert bench.loop.mode is Mode.COMPLIANCE


# A program with contacts: the segment ends, the joint is compliant, and the program continues on schedule.

LAB_PROGRAM = load_parameters("lab")
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
    """Return the bench during or after a program, and the tick in which the program begins."""
    bench = BenchTop(LAB_PROGRAM, make_tuning_command(LAB_PROGRAM, TuningParameters(), u_plan=8.5))
    bench.wind_up()
    begun = len(bench.samples.rows)
    assert isinstance(bench.send(RunProgram(program, 8)), Accepted)
    bench.advance(seconds or program.duration_s + 0.1)
    return bench, begun


def reacts(bench: BenchTop, begun: int) -> NDArray[np.int64]:
    return np.flatnonzero(bench.column("limits")[begun:].astype(int) & Limit.CONTACT)


def test_the_reaction_lasts_from_the_detection_to_the_end_of_its_segment() -> None:
    bench, begun = played(HITS)
    reacting = reacts(bench, begun)
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


def test_the_program_continues_on_schedule_after_the_reaction_in_one_run() -> None:
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


def test_the_position_loop_is_closed_again_after_the_reaction() -> None:
    """A push of 2 N in the remaining program moves the joint, and the position loop returns it."""
    pushed = replace(HITS, segments=(*PARTS[:-1], replace(PARTS[-1], duration_s=4.0, F_push=2.0)))
    bench, begun = played(pushed)
    end = told(bench, RunEnded)[-1].tick
    q = bench.column("q")[begun + BACK + 1000 : end]
    assert np.abs(q).max() > 0.01
    assert np.abs(q[-200:]).max() < 0.003


def test_the_voltages_have_no_jump_at_start_and_end_of_the_reaction() -> None:
    bench, begun = played(HITS)
    for name in ("u_A", "u_B"):
        u = bench.column(name)[begun:]
        first = reacts(bench, begun)[0]
        step = 8.5 / 10  # of a plan, whose voltages are averaged over 10 ms; twice that from full to full reverse
        assert abs(u[first] - u[first - 1]) < 2.0 * step
        assert abs(u[BACK] - u[BACK - 1]) < step + 0.05


def test_the_operators_bias_is_active_before_and_after_the_program() -> None:
    bench = BenchTop(LAB_PROGRAM, make_tuning_command(LAB_PROGRAM, TuningParameters(), u_plan=8.5))
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
    assert reacts(bench, begun).size
    bench.advance(6.0)
    assert bench.column("F_ext_hat", last=1)[0] < -3.0  # 5 N are taken off again


def test_a_contact_in_a_segment_without_detection_is_ignored() -> None:
    unlike = (
        *PARTS[:1],
        Segment(1.0, 0.23, 12.0, shape=Shape.RAMP),
        PARTS[2],
        replace(PARTS[3], contact_detection=1),
        PARTS[4],
    )
    bench, begun = played(replace(HITS, segments=unlike, contact_detections=(ContactDetection(calibrates_bias=True),)))
    assert reacts(bench, begun).size == 0
    assert np.abs(bench.column("F_wall")).max() > FROM_N


@pytest.mark.parametrize("why", ["nothing was learned", "it was learned while a hand moved the joint"])
def test_without_a_bias_a_program_hits_the_obstacle_without_reaction(why: str) -> None:
    first = PARTS[0]
    contact_detections: tuple[ContactDetection, ...] = (ContactDetection(FROM_N), ContactDetection())
    before: tuple[Segment, ...] = (first,)
    if why != "nothing was learned":
        shaken = Segment(3.0, 0.0, 12.0, F_push=8.0, shape=Shape.SINE, period_s=0.3, wall=1)
        before, contact_detections = (replace(first, duration_s=0.01), shaken), HITS.contact_detections
    bench, begun = played(replace(HITS, segments=(*before, *PARTS[1:]), contact_detections=contact_detections))
    assert np.abs(bench.column("F_ext_hat")[begun + 3010 :]).max() > FROM_N
    assert reacts(bench, begun).size == 0
    assert told(bench, RunEnded)[-1].completed


def test_the_operators_reaction_ends_programs_and_rejects_those_with_their_own() -> None:
    bench = BenchTop(LAB_PROGRAM, make_tuning_command(LAB_PROGRAM, TuningParameters(), u_plan=8.5))
    bench.run()
    bench.send(SetReferences(0.0, 12.0))
    bench.advance(4.0)
    bias = float(np.mean(bench.column("F_ext_hat", last=1000)))
    bench.send(ConfigureContactDetection(((12.0, bias),), 1.2))
    refused = bench.send(RunProgram(HITS, 8))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, "contact_reaction_armed", threshold_N=1.2)
    assert told(bench, RunEnded) == []
    assert isinstance(bench.send(RunProgram(NEVER, 8)), Accepted)  # it has no contact reaction by itself
    bench.send(SetMode(Mode.PRETENSION))
    bench.advance(5.0)
    bench.send(ConfigureContactDetection(((12.0, bias),), 0.0))
    assert isinstance(bench.send(RunProgram(HITS, 9)), Accepted)
    bench.advance(3.5)
    bench.send(ConfigureContactDetection(((12.0, bias),), 1.2))  # in flight: it goes before the program's own
    bench.advance(2.0)
    assert told(bench, RunEnded)[-1].why is Cause.CONTACT
    assert bench.loop.mode is Mode.COMPLIANCE


def test_changes_of_the_aborted_segment_are_active_in_the_next_one() -> None:
    parts = (*PARTS[:2], replace(PARTS[2], tuning=1, wall=2), *PARTS[3:])
    slower = make_tuning_command(LAB_PROGRAM, TuningParameters(0.8, 0.6))
    bench, begun = played(replace(HITS, segments=parts, tunings=(slower,), walls=(WALL, None)), 5.01)
    assert reacts(bench, begun)[0] < 4000
    assert told(bench, TuningChanged)[-1].lam_q == 0.8
    assert told(bench, WallChanged)[-1].wall is None
    assert bench.column("lam_q", last=1)[0] == 0.8


def test_a_reaction_in_the_last_segment_ends_the_program_on_schedule() -> None:
    bench, begun = played(replace(HITS, segments=PARTS[:3]))
    ended = told(bench, RunEnded)[-1]
    assert ended.completed
    assert ended.tick - begun == pytest.approx(BACK, abs=2)
    assert reacts(bench, begun)[-1] == pytest.approx(BACK, abs=2)


def test_a_stop_during_the_reaction_clears_the_reaction() -> None:
    bench, begun = played(HITS, 4.5)
    assert reacts(bench, begun).size
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
        (
            replace(HITS, contact_detections=(ContactDetection(),) * (MAX_CONTACT_DETECTIONS + 1)),
            messages.number_of_reaction_changes(),
        ),
    ],
)
def test_out_of_range_contact_detection_is_rejected_before_motion(program: Program, words: str) -> None:
    bench = BenchTop(LAB_PROGRAM, make_tuning_command(LAB_PROGRAM, TuningParameters(), u_plan=8.5))
    bench.wind_up()
    refused = bench.send(RunProgram(program, 8))
    assert isinstance(refused, Refused)
    assert words in refused.reason
    assert bench.loop.mode is Mode.PRETENSION


@pytest.mark.parametrize(
    ("program", "code", "values"),
    [
        (
            replace(HITS, contact_detections=(ContactDetection(FROM_N),)),
            "unknown_contact_detection",
            {"number": 2, "count": 1},
        ),
        (replace(HITS, law=Law.SINGLE_LOOP), "law_without_contact_reaction", {"law": Law.SINGLE_LOOP}),
    ],
)
def test_inconsistent_contact_detection_is_rejected_before_motion(
    program: Program, code: str, values: dict[str, object]
) -> None:
    bench = BenchTop(LAB_PROGRAM, make_tuning_command(LAB_PROGRAM, TuningParameters(), u_plan=8.5))
    bench.wind_up()
    refused = bench.send(RunProgram(program, 8))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, code, **values)
    assert bench.loop.mode is Mode.PRETENSION


# Disturbance rejection by feed-forward: time of the return, preconditions, and bumpless switching.


def held(name: str, lam_q: float, S: float = 10.0) -> tuple[BenchTop, SetTuning]:
    """In run at 0 rad, at rest, without a measured bias."""
    parameters = load_parameters(name)
    tuning = make_tuning_command(parameters, TuningParameters(lam_q, 0.345), u_plan=8.5)
    bench = BenchTop(parameters, tuning)
    bench.run()
    bench.send(SetReferences(0.0, S))
    bench.advance(4.0)
    return bench, tuning


def learned(name: str, lam_q: float, k_ext: float, S: float = 10.0) -> tuple[BenchTop, SetTuning]:
    """The same with the bias measured there, and disturbance rejection active."""
    bench, tuning = held(name, lam_q, S)
    assert isinstance(
        bench.send(ConfigureContactDetection(((S, float(np.mean(bench.column("F_ext_hat", last=500)))),))), Accepted
    )
    rejecting = replace(tuning, k_ext=k_ext)
    assert isinstance(bench.send(rejecting), Accepted)
    return bench, rejecting


def back_s(bench: BenchTop, F_push: float, seconds: float) -> float:
    begun = len(bench.samples.rows)
    assert isinstance(bench.send(ApplyPush(F_push, seconds)), Accepted)
    bench.advance(seconds)
    off = np.abs(bench.column("q")[begun:] - bench.column("q_ref")[begun:])
    return float(np.flatnonzero(off > 1.01 * NEAR_RAD)[-1] + 1) * 1e-3


@pytest.mark.parametrize("k_ext", [0.0, 0.7, 1.0])
def test_the_joint_returns_at_the_forecast_time(k_ext: float) -> None:
    """Compares nonlinear springs, an independent simulator and the whole loop with the linear model."""
    bench, tuning = learned("ideal", 1.0, k_ext)
    known = build_cascade_tuning(tuning, collect_plant_knowledge(load_parameters("ideal")))
    forecast = forecast_push(load_parameters("ideal"), known, 10.0, 1.0)
    assert back_s(bench, PUSH_N, 8.0) == pytest.approx(forecast.recovery_s, rel=0.06)
    assert np.max(np.abs(bench.column("q", last=8000))) == pytest.approx(forecast.deflection, rel=0.02)


@pytest.mark.parametrize("name", ["lab", "lab-stick"])
def test_with_friction_and_counts_the_position_loop_only_corrects_the_remainder(name: str) -> None:
    """The remainder is 0.3 N that are not compensated, and half an encoder count in the bias measured at rest."""
    parameters = load_parameters(name)
    bench, _ = learned(name, 2.0, 1.0)
    left_N = UNSEEN_F + 10.0 * 0.5 * parameters.sensors.joint_step / parameters.geometry.r_j
    for F_push in (5.0, -5.0):
        assert back_s(bench, F_push, 6.0) < 4.5  # by the position loop alone 11; 4.23 with dead zones at rest
        off = bench.column("q", last=4500) - bench.column("q_ref", last=4500)
        assert np.max(np.abs(off)) < left_N * parameters.geometry.r_j / 10.0 + parameters.sensors.joint_step
        assert np.ptp(bench.column("u_A", last=2000)) < 0.3
        bench.advance(6.0)


def test_disturbance_rejection_moves_nothing_at_rest() -> None:
    bench, _ = learned("lab", 1.0, 1.0)
    bench.advance(3.0)
    plain, _ = held("lab", 1.0)
    plain.advance(3.0)
    for name in ("q", "u_A", "u_B", "S"):
        np.testing.assert_array_equal(bench.column(name, last=3000), plain.column(name, last=3000))


def test_disturbance_rejection_subtracts_the_bias() -> None:
    bench, tuning = held("lab", 1.0)
    refused = bench.send(replace(tuning, k_ext=0.7))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, "bias_not_calibrated")
    program = Program(Law.CASCADE, (Segment(0.5, 0.0, 10.0, tuning=1),), tunings=(replace(tuning, k_ext=0.7),))
    assert isinstance(bench.send(RunProgram(program, 3)), Refused)
    assert isinstance(bench.send(ConfigureContactDetection(((10.0, 0.0),))), Accepted)
    assert isinstance(bench.send(replace(tuning, k_ext=1.2)), Refused)
    assert isinstance(bench.send(RunProgram(program, 3)), Accepted)
    bench.advance(1.0)  # over, and the operator's is back
    assert isinstance(bench.send(ConfigureContactDetection(())), Accepted)


def test_the_bias_cannot_be_cleared_during_disturbance_rejection() -> None:
    bench, tuning = learned("lab", 1.0, 0.7)
    refused = bench.send(ConfigureContactDetection(()))
    assert isinstance(refused, Refused)
    assert_reason(refused.reason, "bias_in_use")
    assert isinstance(bench.send(tuning), Accepted)


def test_new_zeros_switch_disturbance_rejection_off() -> None:
    bench, tuning = learned("ideal", 1.0, 1.0)
    tunings = bench.loop._mode_manager.tunings
    assert tunings.gains.disturbance_feedforward.k_ext == 1.0
    bench.loop._mode_manager.contact.reset(0)
    assert tunings.gains.disturbance_feedforward.k_ext == 0.0
    assert back_s(bench, 5.0, 8.0) > 3.0  # with it 0.5 s
    assert isinstance(bench.send(tuning), Refused)


@pytest.mark.parametrize("u_plan", [0.0, 8.5])
def test_disturbance_rejection_switches_without_a_bump_under_a_push(u_plan: float) -> None:
    bench, tuning = learned("ideal", 1.0, 0.0)
    for after_s in (0.1, 0.4, 1.5):
        tuning = replace(tuning, u_plan=u_plan, k_ext=0.0)
        bench.send(tuning)
        bench.advance(6.0)
        bench.send(ApplyPush(6.0, after_s + 0.8))
        bench.advance(after_s)
        for k_ext in (1.0, 0.5, 0.0, 0.8):
            bench.send(replace(tuning, k_ext=k_ext))
            bench.advance(0.2)
            steps = np.abs(np.diff(bench.column("u_A", last=205)))
            assert steps[4] < max(1e-3, 1.5 * steps[3])  # the tick in which it changed, against the one before
            assert np.max(steps) < 0.05
    assert bench.loop.mode is Mode.RUN


def test_disturbance_rejection_is_inactive_with_an_open_loop_and_closes_smoothly() -> None:
    closed = {}
    for k_ext in (0.0, 1.0):
        bench, _ = learned("ideal", 1.0, k_ext)
        assert isinstance(bench.send(SetMode(Mode.COMPLIANCE, 2)), Accepted)
        bench.advance(1.0)
        bench.send(ApplyPush(5.0, 8.0))
        bench.advance(3.0)
        assert bench.column("q", last=1)[0] == pytest.approx(0.075 * 5.0 / 10.0, rel=0.02)
        assert isinstance(bench.send(SetMode(Mode.RUN, 3)), Accepted)
        bench.advance(1.0)
        closed[k_ext] = bench.column("u_A", last=1000), bench.column("q", last=1)[0] - 0.075 * 5.0 / 10.0
    (u, off), (u_rejected, off_rejected) = closed[0.0], closed[1.0]
    assert abs(u_rejected[0] - u[0]) < 1e-9
    assert np.max(np.abs(np.diff(u_rejected - u))) < 0.02
    # Run begins with the references where the joint is, so there is nothing to bring back (decision 0053).
    assert max(abs(off), abs(off_rejected)) < 1e-4


def test_the_contact_reaction_works_during_disturbance_rejection() -> None:
    ways = []
    for k_ext in (0.0, 1.0):
        bench, _ = learned("lab", 1.0, k_ext)
        bias = bench.loop._mode_manager.contact._step._bias.get()
        bench.send(ConfigureContactDetection(tuple((float(S), float(F)) for S, F in bias), 2.0))
        bench.send(ApplyPush(6.0, 2.0))
        bench.advance(2.0)
        assert bench.loop.mode is Mode.COMPLIANCE
        ways.append(bench.column("q", last=2000))
    np.testing.assert_allclose(ways[1], ways[0], atol=0.01)


@pytest.mark.parametrize("name", ["ideal", "lab"])
def test_random_pushes_cause_neither_a_trip_nor_slack(name: str) -> None:
    bench, _ = learned(name, 1.0, 1.0)
    random = np.random.default_rng(16)
    for _ in range(30):
        if random.random() < 0.4:
            lambdas = TuningParameters(random.uniform(0.36, 2.0), random.uniform(0.35, 0.8))
            k_ext, u_plan = random.uniform(0.0, 1.0), 8.5 if random.random() < 0.7 else 0.0
            parameters = load_parameters(name)
            assert isinstance(
                bench.send(replace(make_tuning_command(parameters, lambdas, u_plan=u_plan), k_ext=k_ext)), Accepted
            )
        if random.random() < 0.3:
            bench.send(SetReferences(random.uniform(-1.0, 1.0), random.uniform(9.0, 12.0)))
        bench.send(ApplyPush(random.uniform(-10.0, 10.0), random.uniform(0.05, 2.0)))
        bench.advance(random.uniform(0.1, 1.5))
        assert bench.loop.mode is Mode.RUN
    for F in (bench.column("F_A"), bench.column("F_B")):
        assert F[10_000:].min() > 1.0
        assert F[10_000:].max() < 50.0


def test_a_program_does_not_inherit_contact_detection_from_the_previous_one() -> None:
    contact = Mock()
    disturbances = ProgramDisturbances(Mock(), [], contact)
    program = Mock(walls=())
    for _ in range(2):
        disturbances.begin(program)
        disturbances.apply_setpoint(Setpoint(0.0, 12.0, 0.0, contact_detection=1), 5)
        assert disturbances.get_active_inputs(0).contact_detection == 1
        disturbances.end(9)
        assert disturbances.get_active_inputs(0).contact_detection == 0
    assert contact.use.call_args_list == [call(1), call(1)]
