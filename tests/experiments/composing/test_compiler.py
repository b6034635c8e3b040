"""Segments that the parts of an experiment compile to."""

import math

import numpy as np
import pytest

from backend.experiments.compiler import compute_multisine_peak
from backend.realtime.program import ContactDetection, Law, Segment, Shape
from tests.experiments.composing.written import WOBBLE, plan_of, with_parts

LEAD_IN = "{do: step, q_ref: 0.1, S_ref: 10.0, duration_s: 6.0}"
FIRST = Segment(6.0, 0.1, 10.0)


def after_lead_in(*parts: str) -> tuple[Segment, ...]:
    segments = plan_of(with_parts(LEAD_IN, *parts)).program().segments
    assert segments[0] == FIRST
    return segments[1:]


def test_references_that_are_not_named_stay() -> None:
    assert after_lead_in(
        "{do: step, S_ref: 12, duration_s: 1}", "{do: ramp, q_ref: 0.3, duration_s: 2}", "{do: hold, duration_s: 0.5}"
    ) == (Segment(1.0, 0.1, 12.0), Segment(2.0, 0.3, 12.0, shape=Shape.RAMP), Segment(0.5, 0.3, 12.0))


def test_a_pulse_comes_back() -> None:
    assert after_lead_in("{do: pulse, q_ref: -0.2, duration_s: 1, rest_s: 2}") == (
        Segment(1.0, -0.2, 10.0),
        Segment(2.0, 0.1, 10.0),
    )


def test_excitations_go_around_the_references_and_leave_them_where_they_were() -> None:
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


def test_a_change_of_the_tuning_goes_with_the_next_motion_and_adds_up() -> None:
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


def test_settings_move_what_is_played_and_the_law_may_be_one() -> None:
    assert plan_of(WOBBLE, depth=0.4).program().segments[1].q_ref == pytest.approx(0.4)
    assert plan_of(WOBBLE).program().segments[1].q_ref == pytest.approx(0.2)
    settings = (
        "law: how\nsettings:\n"
        "  - {name: how, kind: choice, symbol: how, meaning: law, default: cascade, choices: [cascade, single-loop]}\n"
    )
    plan = plan_of(with_parts(LEAD_IN, settings=settings), how="single-loop")
    assert plan.program().law is Law.SINGLE_LOOP


def test_the_peak_of_a_multisine_is_no_less_than_that_of_its_sum() -> None:
    t = np.linspace(0.0, 1.0, 20_001)
    for lines in (1, 3, 17, 40):
        total = sum(np.cos(2 * np.pi * k * t - np.pi * k * (k - 1) / lines) for k in range(1, lines + 1))
        assert np.abs(total).max() <= compute_multisine_peak(lines) <= 1.03 * np.abs(total).max()


def test_what_a_contact_ends_is_marked_where_it_begins_and_where_it_is_over() -> None:
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


def test_parts_that_no_contact_ends_are_played_as_if_they_stood_alone() -> None:
    held = "{do: hold, duration_s: 1}"
    within = plan_of(with_parts(LEAD_IN, f"{{do: until_contact, contact_N: 0, parts: [{held}]}}")).program()
    assert within == plan_of(with_parts(LEAD_IN, held)).program()


def test_a_push_goes_with_a_step_a_ramp_and_a_sine() -> None:
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
    assert -5.0 < first.F_push < -4.5  # on from where three quarters of a turn have left it


def test_a_sine_goes_to_a_crest_that_is_named() -> None:
    sine, held = after_lead_in(
        "{do: sine, q_ref: -0.2, S_amplitude: 1, period_s: 4, duration_s: 1}", "{do: hold, duration_s: 1}"
    )
    assert (sine.q_ref, sine.S_ref) == (-0.2, 11.0)
    assert [held.q_ref, held.S_ref] == pytest.approx([-0.2, 11.0])
    sine, held = after_lead_in("{do: sine, S_ref: 12, period_s: 4, duration_s: 4}", "{do: hold, duration_s: 1}")
    assert (sine.q_ref, sine.S_ref) == (0.1, 12.0)
    assert held.S_ref == pytest.approx(10.0)
