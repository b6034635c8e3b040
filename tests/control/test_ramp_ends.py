"""A ramp of a program ends where it was sent: the plan knows the end from the segments, and brakes before it."""

import math

import numpy as np
import pytest

from backend.control.motion_types import Setpoint
from backend.control.setpoint_player import find_ramp_end, step_setpoint_player
from backend.realtime.commands import Accepted, RunProgram
from backend.realtime.gains import make_tuning_command
from backend.realtime.motions import make_segment_player
from backend.realtime.program import Law, Program, Segment, Shape
from backend.sample import INDEX
from backend.tuning.gains import TuningParameters
from plant.parameters import load_parameters
from tests.realtime.bench_top import BenchTop

COUNT = 2.0 * math.pi / 4000.0
RAMP = Segment(0.02, 0.5, 12.0, shape=Shape.RAMP)
HELD = Segment(0.02, 0.5, 12.0)


@pytest.mark.parametrize(
    ("segments", "q_end", "S_end"),
    [
        ((RAMP,), 0.5, 12.0),
        ((RAMP, HELD), 0.5, 12.0),
        ((RAMP, Segment(0.02, 0.5, 12.0, F_push=3.0, shape=Shape.RAMP)), 0.5, 12.0),
        ((RAMP, Segment(0.02, 0.8, 12.0, shape=Shape.RAMP)), math.nan, 12.0),
        ((RAMP, Segment(0.02, 0.5, 13.0)), 0.5, math.nan),
        ((RAMP, Segment(0.02, 0.6, 13.0, shape=Shape.SINE, period_s=0.01)), math.nan, math.nan),
        ((HELD, RAMP), math.nan, math.nan),
        ((Segment(0.02, 0.5, 12.0, shape=Shape.SINE, period_s=0.01),), math.nan, math.nan),
    ],
)
def test_an_end_is_announced_where_the_references_stay(
    segments: tuple[Segment, ...], q_end: float, S_end: float
) -> None:
    start = Setpoint(0.0, 10.0, 0.0)
    _, _, player = step_setpoint_player(make_segment_player(segments, start), start)
    np.testing.assert_equal(find_ramp_end(player), (q_end, S_end))


def test_nothing_is_announced_after_the_program() -> None:
    start = Setpoint(0.0, 10.0, 0.0)
    player, done = make_segment_player((RAMP,), start), False
    while not done:
        done, _, player = step_setpoint_player(player, start)
    np.testing.assert_equal(find_ramp_end(player), (math.nan, math.nan))


@pytest.mark.parametrize(("speed", "S"), [(0.5, 10.0), (1.0, 10.0), (-1.0, 10.0), (0.8, 14.0), (2.5, 10.0)])
def test_a_ramp_is_not_overshot(speed: float, S: float) -> None:
    """Neither where the motors follow it nor where it is faster than they are; what follows keeps up before the end."""
    lab = load_parameters("lab")
    bench = BenchTop(lab, make_tuning_command(lab, TuningParameters(0.355, 0.345), u_plan=8.5))
    bench.wind_up()
    before = len(bench.samples.rows)
    way, way_s = math.copysign(0.8, speed), 0.8 / abs(speed)
    segments = (Segment(2.0, 0.0, 10.0), Segment(way_s, way, S, shape=Shape.RAMP), Segment(2.0, way, S))
    assert isinstance(bench.send(RunProgram(Program(Law.CASCADE, segments), 5)), Accepted)
    bench.advance(4.0 + way_s)
    rows = np.array(bench.samples.rows[before:])
    done = rows[2000:, INDEX["q"]] * math.copysign(1.0, speed)
    assert done.max() <= 0.8 + COUNT
    assert np.all(done[round(1000 * way_s) + 300 :] >= 0.8 - 3.0 * COUNT)
    assert rows[2000:, INDEX["S"]].max() <= S + 0.1
    if abs(speed) <= 1.0:
        last = slice(2000 + round(750 * way_s), 2000 + round(900 * way_s))
        lag = np.abs(rows[last, INDEX["q_ref"]] - rows[last, INDEX["q"]])
        assert lag.max() <= 0.012 * abs(speed) + COUNT


def test_a_ramp_that_goes_on_is_not_slowed_down_in_between() -> None:
    """In two parts with the same speed it is driven as in one."""
    lab = load_parameters("lab")
    driven = []
    for segments in (
        (Segment(1.0, 0.5, 10.0, shape=Shape.RAMP),),
        (Segment(0.4, 0.2, 10.0, shape=Shape.RAMP), Segment(0.6, 0.5, 10.0, shape=Shape.RAMP)),
    ):
        bench = BenchTop(lab, make_tuning_command(lab, TuningParameters(0.355, 0.345), u_plan=8.5))
        bench.wind_up()
        before = len(bench.samples.rows)
        whole = (Segment(1.0, 0.0, 10.0), *segments, Segment(0.5, 0.5, 10.0))
        bench.send(RunProgram(Program(Law.CASCADE, whole), 5))
        bench.advance(2.5)
        driven.append(np.array(bench.samples.rows[before:])[:, INDEX["q"]])
    assert np.max(np.abs(driven[0] - driven[1])) <= 1.01 * COUNT


@pytest.mark.parametrize(
    "excitation",
    [
        Segment(0.02, 0.5, 12.0, shape=Shape.SINE, period_s=0.01),
        Segment(0.02, 0.5, 12.0, shape=Shape.SWEEP, period_s=0.01, period_end_s=0.005),
        Segment(0.021, 0.5, 12.0, shape=Shape.PRBS, period_s=0.001, count=3),
        Segment(0.02, 0.5, 12.0, shape=Shape.MULTISINE, period_s=0.01, count=2, peak=2.0),
    ],
)
def test_what_follows_an_excitation_begins_where_that_began(excitation: Segment) -> None:
    """Told by a ramp behind it; a sine of whole periods ends there by itself."""
    start, ramp = Setpoint(0.1, 10.0, 0.0), Segment(0.02, 0.3, 14.0, shape=Shape.RAMP)
    player = make_segment_player((excitation, ramp), start)
    targets, (done, target, player) = [], step_setpoint_player(player, start)
    while not done:
        targets.append((target.q_ref, target.S_ref))
        done, target, player = step_setpoint_player(player, target)
    share = np.arange(1, 21) / 20.0
    line = np.column_stack((0.1 + 0.2 * share, 10.0 + 4.0 * share))
    np.testing.assert_allclose(targets[-20:], line, atol=1e-12)
    assert np.ptp([q for q, _ in targets[:-20]]) > 0.1
