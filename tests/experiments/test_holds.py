"""Metrics of holds, for signals with known swing and counts."""

from typing import Any

import numpy as np
import pytest

from backend.analysis.disturbance_metrics import compute_hold_metrics, find_hold_windows, measure_holds
from backend.analysis.step_metrics import NoSamplesError
from backend.experiments.plans import ExperimentPlan
from plant.interface import T_s
from plant.parameters import load_parameters
from tests.experiments.composing.written import plan_of, with_parts

LAB, IDEAL = load_parameters("lab"), load_parameters("ideal")
COUNT, MOTOR = 2.0 * np.pi / 4000.0, 2.0 * np.pi / 8000.0
MOVE = "{do: step, q_ref: 0.3, S_ref: 10.0, duration_s: 2.0}"
HOLD = "{do: hold, duration_s: 3.0}"
BACK = "{do: step, q_ref: 0.0, duration_s: 2.0}"


def columns(plan: ExperimentPlan) -> dict[str, Any]:
    """An actuator that is where its references are, on whole counts."""
    segments = plan.program().segments
    q_ref, S_ref = (
        np.repeat([getattr(one, name) for one in segments], [round(one.duration_s / T_s) for one in segments])
        for name in ("q_ref", "S_ref")
    )
    ones = np.ones(q_ref.size)
    return {
        "t": np.arange(q_ref.size) * T_s, "q": q_ref.copy(), "q_ref": q_ref, "S": S_ref.copy(), "S_ref": S_ref,
        "theta_A": 100.0 * MOTOR * ones, "theta_B": 90.0 * MOTOR * ones, "F_A": 20.0 * ones, "F_B": 15.0 * ones,
        "u_A": ones.copy(), "u_B": ones.copy(),
    }  # fmt: skip


def test_only_constant_references_after_a_move_are_a_hold() -> None:
    push, sine = (
        "{do: push, F_push: 3.0, duration_s: 2.0}",
        "{do: sine, q_amplitude: 0.1, period_s: 2.0, duration_s: 2.0}",
    )
    short = "{do: hold, duration_s: 0.5}", "{do: hold, duration_s: 0.3}"
    plan = plan_of(with_parts(MOVE, HOLD, HOLD, BACK, push, HOLD, HOLD, sine, *short))
    # what follows a push is its end, what follows that is rest; 0.3 s are too short
    assert find_hold_windows(plan.program()) == (slice(2000, 8000), slice(15000, 18000))


def test_swings_and_distances_are_the_largest_of_all_stretches() -> None:
    plan = plan_of(with_parts(MOVE, HOLD, BACK, HOLD))
    seen = columns(plan)
    seen["q"][3000:3100] += 1.0 * COUNT
    seen["q"][8000:8100] -= 2.0 * COUNT
    seen["u_B"][8500] += 0.2
    seen["u_A"][8600] -= 0.15
    seen["S"][4000] += 0.004
    seen["theta_A"][3000] += MOTOR  # there and back: two ticks in which it moved
    figures = compute_hold_metrics(seen, plan.program(), LAB)
    assert figures.held_q_swing_counts == pytest.approx(2.0)
    assert figures.held_q_swing == pytest.approx(2.0 * COUNT)
    assert figures.held_off_counts == pytest.approx(1.5)  # a reading tells to half a count
    assert figures.held_u_swing_V == pytest.approx(0.2)
    assert figures.held_S_swing == pytest.approx(0.004)
    assert figures.held_moving_percent == pytest.approx(100.0 * 2 / 2999)
    first, second = measure_holds(seen, plan.program(), LAB)
    assert (first.q_ref, first.S_ref, second.q_ref) == (0.3, 10.0, 0.0)
    assert (first.start_s, second.start_s) == (2.0, 7.0)
    assert first.off == pytest.approx(COUNT * 100 / 3000)


def test_where_readings_are_exact_counts_are_the_papers_and_nothing_is_granted() -> None:
    plan = plan_of(with_parts(MOVE, HOLD))
    seen = columns(plan)
    seen["q"][3000:3100] += 0.3 * COUNT
    figures = compute_hold_metrics(seen, plan.program(), IDEAL)
    assert figures.held_off_counts == pytest.approx(0.3)
    assert figures.held_q_swing_counts == pytest.approx(0.3)


def test_what_moves_before_a_stretch_is_none_of_it() -> None:
    plan = plan_of(with_parts(MOVE, HOLD))
    seen = columns(plan)
    seen["q"][:1999] = 0.0
    seen["u_A"][:1999] = 9.0
    figures = compute_hold_metrics(seen, plan.program(), LAB)
    assert (figures.held_q_swing_counts, figures.held_u_swing_V, figures.held_moving_percent) == (0.0, 0.0, 0.0)


def test_a_reading_that_is_none_is_not_at_rest() -> None:
    plan = plan_of(with_parts(MOVE, HOLD))
    seen = columns(plan)
    seen["q"][3000] = np.nan
    figures = compute_hold_metrics(seen, plan.program(), LAB)
    assert (figures.held_q_swing_counts, figures.held_off_counts) == (None, None)
    assert figures.reasons["held_off_counts"] == "a sample of it holds no number"
    assert figures.held_u_swing_V == 0.0


def test_nothing_held_to_its_end_gives_nothing() -> None:
    plan = plan_of(with_parts(MOVE, HOLD))
    early = {name: column[:-1] for name, column in columns(plan).items()}
    with pytest.raises(NoSamplesError, match="nothing was held to its end"):
        compute_hold_metrics(early, plan.program(), LAB)
