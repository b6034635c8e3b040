"""The profile of a program, compared with its execution and with closed forms."""

import math

import numpy as np
import pytest

from backend.control import setpoint_player
from backend.control.motion_types import Setpoint
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import PROFILE_POINTS, ActuatorIdentificationPlan, build_profile
from backend.realtime.motions import make_segment_player
from backend.realtime.program import Law, Program, Segment, Shape
from plant.interface import T_s

MIXED = Program(
    Law.CASCADE,
    (
        Segment(0.5, 0.2, 9.0),
        Segment(1.0, -0.4, 11.0, shape=Shape.RAMP),
        Segment(1.3, 0.1, 11.0, shape=Shape.SINE, period_s=0.7),
        Segment(2.0, 0.1, 11.0, shape=Shape.SWEEP, period_s=1.0, period_end_s=0.2),
        Segment(1.55, 0.0, 12.0, shape=Shape.PRBS, period_s=0.05, count=5),
        Segment(1.0, 0.3, 12.0, shape=Shape.MULTISINE, period_s=1.0, count=4, peak=2.0),
        Segment(0.2, 0.0, 10.0),
    ),
)


def played(program: Program, q_ref: float, S_ref: float) -> np.ndarray:
    """Every tick as the loop plays it: (ticks, 2)."""
    last = Setpoint(q_ref, S_ref, 0.0)
    now = make_segment_player(program.segments, last)
    rows: list[tuple[float, float]] = []
    while True:
        over, last, now = setpoint_player.step_setpoint_player(now, last)
        if over:
            return np.array(rows)
        rows.append((last.q_ref, last.S_ref))


@pytest.mark.parametrize(
    "program", [MIXED, build_ready_plan("frequency_response").program()], ids=["mixed", "response"]
)
def test_it_is_what_the_loop_plays(program: Program) -> None:
    whole = played(program, -0.1, 9.5)
    found = build_profile(program, -0.1, 9.5)
    ticks = np.rint(found.t / T_s).astype(int)
    assert np.all(np.diff(ticks) > 0)
    assert (ticks[0], ticks[-1]) == (1, len(whole))
    assert np.array_equal(np.column_stack([found.q_ref, found.S_ref]), whole[ticks - 1])
    assert len(ticks) <= PROFILE_POINTS + 3 * len(program.segments)


def test_a_ramp_and_a_sine_are_their_closed_forms() -> None:
    found = build_profile(Program(Law.CASCADE, MIXED.segments[1:3]), 0.2, 9.0)
    ramp = found.t <= 1.0
    assert found.q_ref[ramp] == pytest.approx(0.2 - 0.6 * found.t[ramp], abs=1e-12)
    swing = 0.5 * np.sin(2.0 * math.pi * (found.t[~ramp] - 1.0) / 0.7)
    assert found.q_ref[~ramp] == pytest.approx(-0.4 + swing, abs=1e-9)


def test_a_push_is_in_it_from_its_first_tick_to_its_last() -> None:
    segments = (Segment(0.5, 0.0, 10.0), Segment(1.0, 0.0, 10.0, F_push=6.0), Segment(0.5, 0.0, 10.0))
    found = build_profile(Program(Law.COMPLIANCE, segments), 0.0, 10.0)
    pushed = (found.t > 0.5 + T_s / 2) & (found.t < 1.5 + T_s / 2)
    assert np.array_equal(found.F_push, np.where(pushed, 6.0, 0.0))


def test_a_program_of_identification_has_none() -> None:
    assert all(len(part) == 0 for part in build_profile(ActuatorIdentificationPlan().program(), 0.0, 10.0))
