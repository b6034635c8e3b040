"""Sample ranges of pushes and loads in programs, and the deviations in them."""

import numpy as np
import pytest

from backend.analysis.disturbance_metrics import compute_disturbance_metrics
from backend.analysis.step_metrics import NoSamplesError, find_pushes, find_undisturbed_end, list_load_steps
from backend.realtime.program import Law, Program, Segment

HELD = Segment(1.0, 0.0, 10.0)
PUSHED = Program(
    Law.CASCADE,
    (
        HELD,
        Segment(0.5, 0.0, 10.0, F_push=5.0),
        Segment(0.5, 0.0, 10.0, F_push=3.0),
        HELD,
        HELD,
        Segment(0.2, 0.0, 10.0, F_push=-5.0),
        HELD,
        Segment(1.0, 0.1, 10.0),
    ),
)


def test_pushes_that_follow_each_other_are_one() -> None:
    assert find_pushes(PUSHED) == (slice(1000, 2000), slice(4000, 4200))


def test_nothing_moves_until_the_next_push_or_reference() -> None:
    assert find_undisturbed_end(PUSHED, 2000) == 4000
    assert find_undisturbed_end(PUSHED, 4200) == 5200


def test_a_reference_that_jumps_as_a_push_ends_disturbs_at_once() -> None:
    pushed = Segment(0.5, 0.0, 10.0, F_push=5.0)
    program = Program(Law.CASCADE, (HELD, pushed, Segment(2.0, 0.3, 10.0)))
    assert find_undisturbed_end(program, 1500) == 1500


def test_loads_step_on_and_off_at_their_sides() -> None:
    program = Program(
        Law.CASCADE,
        (HELD, Segment(0.5, 0.0, 10.0, load_A=0.2), HELD, Segment(0.4, 0.0, 10.0, load_A=0.1, load_B=0.3), HELD),
    )
    assert [(step.side, step.window, step.on) for step in list_load_steps(program)] == [
        ("A", slice(1000, 1500), True),
        ("A", slice(1500, 2500), False),
        ("A", slice(2500, 2900), True),
        ("B", slice(2500, 2900), True),
        ("A", slice(2900, 3900), False),
        ("B", slice(2900, 3900), False),
    ]
    assert list_load_steps(PUSHED) == ()


def columns(off_q: np.ndarray) -> dict[str, np.ndarray]:
    ones = np.ones_like(off_q)
    return {
        "q": off_q,
        "q_ref": 0.0 * ones,
        "S": 10.02 * ones,
        "S_ref": 10.0 * ones,
        "F_A": 20.0 * ones,
        "F_B": 15.0 * ones,
        "u_A": -2.0 * ones,
        "u_B": ones,
    }


def test_a_push_is_measured_while_it_lasts_and_until_the_joint_is_back() -> None:
    off = np.zeros(6200)
    off[1000:2000] = 0.06
    off[2000:2300] = -0.03  # swings through
    off[4000:4200] = -0.08
    off[4200:4350] = -0.02
    figures = compute_disturbance_metrics(columns(off), PUSHED)
    assert figures.push_deviation_q == 0.08
    assert figures.push_deviation_S == pytest.approx(0.02)
    assert figures.push_back_s == pytest.approx(0.3)
    assert (figures.min_tension_N, figures.max_tension_N, figures.peak_voltage_V) == (15.0, 20.0, 2.0)


def test_a_joint_that_is_not_back_or_holds_no_number_is_not_measured() -> None:
    for wrong in (0.03, np.nan):
        off = np.zeros(6200)
        off[2000:4000] = wrong
        figures = compute_disturbance_metrics(columns(off), PUSHED)
        assert figures.push_back_s is None
        assert "after the push that ended at 2 s the joint was still" in figures.reasons["push_back_s"]


def test_a_run_that_ended_before_the_pushes_were_over_has_no_figures() -> None:
    with pytest.raises(NoSamplesError, match="before the pushes were over"):
        compute_disturbance_metrics(columns(np.zeros(4100)), PUSHED)
    with pytest.raises(NoSamplesError, match="nothing pushes the joint"):
        compute_disturbance_metrics(columns(np.zeros(4100)), Program(Law.CASCADE, (HELD,)))
