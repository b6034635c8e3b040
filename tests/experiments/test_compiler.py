"""Programs of experiments: segments, pushes, reach and planned profiles."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backend.control import setpoint_player
from backend.control.decoupler import compute_bounds
from backend.control.motion_types import Setpoint
from backend.experiments.compiler import (
    SMOOTH_SEGMENT_S,
    CompiledExperiment,
    PushSegment,
    compute_multisine_peak,
    generate_manual_pushes,
    generate_smooth_push,
    list_played_parts,
    require_reach,
)
from backend.experiments.library import build_ready_plan
from backend.experiments.parser import ExperimentError, parse_experiment
from backend.experiments.plans import PROFILE_POINTS, ActuatorIdentificationPlan, ExperimentPlan, build_profile
from backend.realtime.motions import make_segment_player
from backend.realtime.program import OSCILLATING, ContactDetection, Law, Program, Segment, Shape
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.experiments.composing.written import WOBBLE, plan_of, with_parts
from tests.refusals import refused_because

# Segments that the parts of an experiment compile to.

LEAD_IN = "{do: step, q_ref: 0.1, S_ref: 10.0, duration_s: 6.0}"
FIRST = Segment(6.0, 0.1, 10.0)


def after_lead_in(*parts: str) -> tuple[Segment, ...]:
    segments = plan_of(with_parts(LEAD_IN, *parts)).program().segments
    assert segments[0] == FIRST
    return segments[1:]


def test_references_that_are_not_named_are_unchanged() -> None:
    assert after_lead_in(
        "{do: step, S_ref: 12, duration_s: 1}", "{do: ramp, q_ref: 0.3, duration_s: 2}", "{do: hold, duration_s: 0.5}"
    ) == (Segment(1.0, 0.1, 12.0), Segment(2.0, 0.3, 12.0, shape=Shape.RAMP), Segment(0.5, 0.3, 12.0))


def test_a_pulse_returns_to_its_initial_reference() -> None:
    assert after_lead_in("{do: pulse, q_ref: -0.2, duration_s: 1, rest_s: 2}") == (
        Segment(1.0, -0.2, 10.0),
        Segment(2.0, 0.1, 10.0),
    )


def test_excitations_oscillate_around_the_references_and_do_not_change_them() -> None:
    sweep, prbs, many, held = after_lead_in(
        "{do: sweep, q_amplitude: 0.2, from_Hz: 0.5, to_Hz: 4, duration_s: 9}",
        "{do: prbs, S_amplitude: 0.5, chip_s: 0.2, bits: 4, periods: 3}",
        "{do: multisine, q_amplitude: 0.1, period_s: 8, lines: 6, periods: 2}",
        "{do: hold, duration_s: 1}",
    )
    assert (sweep.shape, sweep.period_s, sweep.period_end_s) == (Shape.SWEEP, 2.0, 0.25)
    assert sweep.q_ref == pytest.approx(0.3)
    assert (prbs.shape, prbs.S_ref, prbs.period_s, prbs.count) == (Shape.PRBS, 10.5, 0.2, 4)
    assert prbs.duration_s == pytest.approx(3 * 15 * 0.2)
    assert (many.shape, many.duration_s, many.count, many.peak) == (Shape.MULTISINE, 16.0, 6, compute_multisine_peak(6))
    assert held == Segment(1.0, 0.1, 10.0)


def test_a_part_after_an_incomplete_sine_starts_from_its_end() -> None:
    _, held = after_lead_in("{do: sine, q_amplitude: 0.2, period_s: 4, duration_s: 1}", "{do: hold, duration_s: 1}")
    assert held.q_ref == pytest.approx(0.1 + 0.2 * math.sin(math.pi / 2))


def test_repetitions_count_in_their_expressions_and_nest() -> None:
    inner = "{do: repeat, index: k, times: 2, parts: [{do: step, q_ref: 0.1 * i + 0.01 * k, duration_s: 1}]}"
    segments = after_lead_in(f"{{do: repeat, times: 3, parts: [{inner}]}}")
    assert [segment.q_ref for segment in segments] == pytest.approx([0.0, 0.01, 0.1, 0.11, 0.2, 0.21])


def test_tuning_changes_accumulate_and_apply_to_the_next_motion() -> None:
    plan = plan_of(
        with_parts(
            LEAD_IN,
            "{do: tuning, lam_q: 0.8}",
            "{do: hold, duration_s: 1}",
            "{do: hold, duration_s: 1}",
            "{do: tuning, lam_S: 0.9, interpolate: true}",
            "{do: hold, duration_s: 1}",
        )
    )
    assert [segment.tuning for segment in plan.program().segments] == [0, 1, 0, 2]
    assert plan.compiled.changes == ({"lam_q": 0.8}, {"lam_q": 0.8, "lam_S": 0.9, "interpolate": True})


def test_pushes_end_with_their_part() -> None:
    push, held = after_lead_in("{do: push, F_push: -4, duration_s: 1, shape: ramp}", "{do: hold, duration_s: 1}")
    assert (push.F_push, push.shape, held.F_push) == (-4.0, Shape.RAMP, 0.0)
    pressed = after_lead_in("{do: push, F_push: 6, duration_s: 0.4, shape: smooth}")
    forces = [0.0, *(piece.F_push for piece in pressed)]
    assert (np.diff(forces) > 0.0).all()
    assert forces[-1] == pytest.approx(6.0)
    assert sum(piece.duration_s for piece in pressed) == pytest.approx(0.4)
    (brief,) = after_lead_in("{do: push, F_push: 6, duration_s: 0.05, shape: smooth}")
    assert brief.duration_s == 0.05


def test_settings_change_the_program_and_may_select_the_control_law() -> None:
    assert plan_of(WOBBLE, depth=0.4).program().segments[1].q_ref == pytest.approx(0.4)
    assert plan_of(WOBBLE).program().segments[1].q_ref == pytest.approx(0.2)
    settings = (
        "law: how\nsettings:\n"
        "  - {name: how, kind: choice, symbol: how, meaning: law, default: cascade, choices: [cascade, single-loop]}\n"
    )
    plan = plan_of(with_parts(LEAD_IN, settings=settings), how="single-loop")
    assert plan.program().law is Law.SINGLE_LOOP


def test_the_multisine_peak_bounds_the_sum_of_the_lines() -> None:
    t = np.linspace(0.0, 1.0, 20_001)
    for lines in (1, 3, 17, 40):
        total = sum(np.cos(2 * np.pi * k * t - np.pi * k * (k - 1) / lines) for k in range(1, lines + 1))
        assert np.abs(total).max() <= compute_multisine_peak(lines) <= 1.03 * np.abs(total).max()


def test_parts_that_a_contact_ends_are_marked_with_their_start_and_end() -> None:
    inner = (
        "{do: until_contact, contact_N: 1.5, parts: [{do: ramp, q_ref: 0.4, duration_s: 1}, {do: hold, duration_s: 1}]}"
    )
    program = plan_of(
        with_parts(
            LEAD_IN, "{do: learn}", inner, "{do: step, q_ref: 0.1, duration_s: 1}", inner, "{do: hold, duration_s: 1}"
        )
    ).program()
    assert program.segments[1] == Segment(2.0, 0.1, 10.0)
    assert [segment.contact_detection for segment in program.segments] == [0, 0, 1, 0, 2, 3, 0, 4]
    assert program.contact_detections == (
        ContactDetection(1.5, calibrates_bias=True),
        ContactDetection(),
        ContactDetection(1.5),
        ContactDetection(),
    )


def test_until_contact_with_threshold_zero_compiles_to_its_inner_parts() -> None:
    held = "{do: hold, duration_s: 1}"
    within = plan_of(with_parts(LEAD_IN, f"{{do: until_contact, contact_N: 0, parts: [{held}]}}")).program()
    assert within == plan_of(with_parts(LEAD_IN, held)).program()


def test_a_push_may_accompany_a_step_a_ramp_or_a_sine() -> None:
    step, ramp, sine, held = after_lead_in(
        "{do: step, q_ref: 0.2, duration_s: 1, F_push: 3}",
        "{do: ramp, q_ref: 0.3, duration_s: 2, F_push: -4 / 2}",
        "{do: sine, q_amplitude: 0.1, period_s: 4, duration_s: 3, F_push: 5}",
        "{do: hold, duration_s: 1}",
    )
    assert step == Segment(1.0, 0.2, 10.0, 3.0)
    assert ramp == Segment(2.0, 0.3, 10.0, -2.0, Shape.RAMP)
    assert sine == Segment(3.0, 0.4, 10.0, 5.0, Shape.SINE, 4.0)
    assert held.F_push == 0.0
    sine, first, *_ = after_lead_in(
        "{do: sine, q_amplitude: 0.1, period_s: 4, duration_s: 3, F_push: 5}",
        "{do: push, F_push: 0, duration_s: 0.4, shape: smooth}",
    )
    assert sine.F_push == 5.0
    assert -5.0 < first.F_push < -4.5  # starts from the phase after three quarters of a period


def test_the_crest_of_a_sine_may_be_given_as_a_reference() -> None:
    sine, held = after_lead_in(
        "{do: sine, q_ref: -0.2, S_amplitude: 1, period_s: 4, duration_s: 1}", "{do: hold, duration_s: 1}"
    )
    assert (sine.q_ref, sine.S_ref) == (-0.2, 11.0)
    assert [held.q_ref, held.S_ref] == pytest.approx([-0.2, 11.0])
    sine, held = after_lead_in("{do: sine, S_ref: 12, period_s: 4, duration_s: 4}", "{do: hold, duration_s: 1}")
    assert (sine.q_ref, sine.S_ref) == (0.1, 12.0)
    assert held.S_ref == pytest.approx(10.0)


# Random manual pushes stay within their bounds and are reproducible by their seed.


@pytest.mark.parametrize(("start", "end"), [(0.0, 12.0), (12.0, 0.0), (-5.0, 7.0)])
def test_a_smooth_push_follows_half_a_cosine(start: float, end: float) -> None:
    pieces = list(generate_smooth_push(start, end, 0.8))
    share = np.arange(1, 21) / 20.0
    expected = start + (end - start) * 0.5 * (1.0 - np.cos(math.pi * share))
    np.testing.assert_allclose([piece.F_push for piece in pieces], expected, atol=1e-12)
    assert {(piece.duration_s, piece.shape) for piece in pieces} == {(SMOOTH_SEGMENT_S, Shape.RAMP)}
    assert pieces[-1].F_push == pytest.approx(end)


def pushes(pieces: list[PushSegment]) -> list[list[PushSegment]]:
    """Split segments into pushes; each ends with a pause without force."""
    found: list[list[PushSegment]] = [[]]
    for piece in pieces:
        found[-1].append(piece)
        if piece.shape is Shape.STEP and piece.F_push == 0.0:
            found.append([])
    assert found.pop() == []
    return found


def test_each_manual_push_rises_holds_falls_and_pauses() -> None:
    found = pushes(list(generate_manual_pushes(20.0, 40, 2.0, 5)))
    assert len(found) == 40
    for push in found:
        held, pause = (piece for piece in push if piece.shape is Shape.STEP)
        forces = np.array([piece.F_push for piece in push[:-1]])
        at = push.index(held)
        assert 0.3 * 20.0 <= abs(held.F_push) <= 20.0
        assert 0.2 <= held.duration_s <= 1.5
        assert 0.3 * 2.0 <= pause.duration_s <= 2.0
        assert (np.diff(np.abs(forces[: at + 1])) >= -1e-9).all()
        assert (np.diff(np.abs(forces[at:])) <= 1e-9).all()
        for ramp in (push[:at], push[at + 1 : -1]):
            assert 0.3 - SMOOTH_SEGMENT_S / 2.0 <= len(ramp) * SMOOTH_SEGMENT_S <= 0.9 + SMOOTH_SEGMENT_S / 2.0
        assert push[-2].F_push == pytest.approx(0.0, abs=1e-12)
    assert {math.copysign(1.0, max(push, key=lambda piece: abs(piece.F_push)).F_push) for push in found} == {-1.0, 1.0}


def test_manual_pushes_depend_only_on_the_seed() -> None:
    again = [list(generate_manual_pushes(20.0, 3, 1.0, seed)) for seed in (0, 0, 1)]
    assert again[0] == again[1]
    assert again[0] != again[2]


def test_additional_pushes_do_not_change_the_first_pushes() -> None:
    few, many = (list(generate_manual_pushes(20.0, pushes, 1.0, 7)) for pushes in (2, 5))
    assert many[: len(few)] == few


# References outside the bounds of the plant are rejected with line and bound.

_LAB = load_parameters("lab")
PLANT = replace(_LAB, geometry=replace(_LAB.geometry, q_max=1.0))
BOUNDS = compute_bounds(PLANT)
HELD = Segment(1.0, 0.0, 10.0)
LINES = {(): 1, ("phases", 0, "parts", 0): 9, ("phases", 0, "parts", 1): 10, ("phases", 0, "parts", 2): 11}


def of(*segments: Segment) -> CompiledExperiment:
    places = tuple(("phases", 0, "parts", at) for at in range(len(segments)))
    return CompiledExperiment(segments, places, (), (), ())


@pytest.mark.parametrize("shape", [Shape.STEP, Shape.RAMP])
@pytest.mark.parametrize(
    ("q_ref", "S_ref", "quantity"),
    [
        (BOUNDS.q_max, 10.0, "q_ref"),
        (BOUNDS.q_min, 10.0, "q_ref"),
        (0.0, BOUNDS.S_max, "S_ref"),
        (0.0, BOUNDS.S_min, "S_ref"),
    ],
)
def test_a_reference_at_its_bound_is_accepted_and_one_beyond_it_is_rejected(
    shape: Shape, q_ref: float, S_ref: float, quantity: str
) -> None:
    require_reach(of(HELD, Segment(1.0, q_ref, S_ref, shape=shape)), PLANT, LINES)
    beyond = Segment(
        1.0,
        q_ref * 1.001 if quantity == "q_ref" else q_ref,
        S_ref * (1.001 if S_ref > 10.0 else 0.999) if quantity == "S_ref" else S_ref,
        shape=shape,
    )
    value = beyond.q_ref if quantity == "q_ref" else beyond.S_ref
    with refused_because(ExperimentError, "out_of_range", quantity=quantity, value=value) as caught:
        require_reach(of(HELD, beyond, HELD), PLANT, LINES)
    assert caught.value.line == 10


@pytest.mark.parametrize("shape", OSCILLATING)
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_an_oscillation_is_checked_on_both_sides_of_its_centre(shape: Shape, sign: float) -> None:
    middle = Segment(1.0, 0.5 * BOUNDS.q_max, 10.0)
    room = 0.5 * BOUNDS.q_max
    within = replace(middle, q_ref=middle.q_ref + sign * 0.99 * room, shape=shape)
    require_reach(of(HELD, middle, within), PLANT, LINES)
    beyond = replace(middle, q_ref=middle.q_ref + sign * 1.01 * room, shape=shape)
    with refused_because(ExperimentError, "out_of_range", quantity="q_ref") as caught:
        require_reach(of(HELD, middle, beyond), PLANT, LINES)
    assert caught.value.line == 11


def test_a_completed_excitation_does_not_shift_the_centre_of_the_next() -> None:
    excited = Segment(1.0, 0.9 * BOUNDS.q_max, 10.0, shape=Shape.MULTISINE)
    require_reach(of(HELD, excited, excited), PLANT, LINES)


# Times and references of played parts, compared with the program.

WRITTEN = """format: 1
name: loops
title: Loops
phases:
  - name: all
    title: All
    parts:
      - {do: step, q_ref: 0.1, duration_s: 1.0}
      - do: repeat
        times: 3
        parts:
          - {do: ramp, q_ref: 0.4, duration_s: 2.0}
          - {do: pulse, q_ref: 0.0, duration_s: 0.5, rest_s: 0.5}
"""


def test_each_played_part_has_path_times_and_references() -> None:
    experiment, lines = parse_experiment(WRITTEN)
    step, ramp, pulse = list_played_parts(ExperimentPlan(experiment, {}, lines=lines).compiled)
    assert step.path == ("phases", 0, "parts", 0)
    assert (step.start_s, step.end_s, step.q_from, step.q_to) == (0.0, 1.0, None, 0.1)
    assert ramp.path == ("phases", 0, "parts", 1, "parts", 0)
    assert (ramp.start_s, ramp.end_s, ramp.pieces, ramp.piece_s) == (1.0, 9.0, 3, 2.0)
    assert (ramp.q_from, ramp.q_to, ramp.S_from) == (0.1, 0.4, 10.0)
    assert (pulse.start_s, pulse.end_s, pulse.pieces) == (3.0, 10.0, 6)


# The profile of a program, compared with its execution and with closed forms.

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
    """Return the references of the control loop at every tick, shape (ticks, 2)."""
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
def test_the_profile_matches_the_references_of_the_control_loop(program: Program) -> None:
    whole = played(program, -0.1, 9.5)
    found = build_profile(program, -0.1, 9.5)
    ticks = np.rint(found.t / T_s).astype(int)
    assert np.all(np.diff(ticks) > 0)
    assert (ticks[0], ticks[-1]) == (1, len(whole))
    assert np.array_equal(np.column_stack([found.q_ref, found.S_ref]), whole[ticks - 1])
    assert len(ticks) <= PROFILE_POINTS + 3 * len(program.segments)


def test_profiles_of_a_ramp_and_a_sine_match_their_closed_forms() -> None:
    found = build_profile(Program(Law.CASCADE, MIXED.segments[1:3]), 0.2, 9.0)
    ramp = found.t <= 1.0
    assert found.q_ref[ramp] == pytest.approx(0.2 - 0.6 * found.t[ramp], abs=1e-12)
    swing = 0.5 * np.sin(2.0 * math.pi * (found.t[~ramp] - 1.0) / 0.7)
    assert found.q_ref[~ramp] == pytest.approx(-0.4 + swing, abs=1e-9)


def test_the_profile_contains_a_push_from_its_first_to_its_last_tick() -> None:
    segments = (Segment(0.5, 0.0, 10.0), Segment(1.0, 0.0, 10.0, F_push=6.0), Segment(0.5, 0.0, 10.0))
    found = build_profile(Program(Law.COMPLIANCE, segments), 0.0, 10.0)
    pushed = (found.t > 0.5 + T_s / 2) & (found.t < 1.5 + T_s / 2)
    assert np.array_equal(found.F_push, np.where(pushed, 6.0, 0.0))


def test_an_identification_program_has_an_empty_profile() -> None:
    assert all(len(part) == 0 for part in build_profile(ActuatorIdentificationPlan().program(), 0.0, 10.0))
