"""A metric that is not measured has a reason and passes no criterion."""

import math

import numpy as np
import pytest

from backend.analysis import messages
from backend.analysis.disturbance_metrics import compute_compliance_metrics
from backend.analysis.step_metrics import (
    ReferenceStep,
    TrackingMetrics,
    compute_step_metrics,
    compute_tracking_metrics,
    evaluate_criterion,
)
from backend.experiments.library import build_ready_plan
from backend.experiments.plans import ExperimentPlan
from backend.models.run import RunCriterion
from tests.analysis.test_disturbance_metrics import R_J, pushed
from tests.analysis.test_step_metrics import T_s, double_lag, step, tracked
from tests.experiments.judging import LEAD_IN_S, compliance_criteria, tracking_criteria
from tests.reasons import assert_reason

SHORT_HOLDS = build_ready_plan("tracking", q_duration_s=1.5, S_duration_s=2.0)


def measured(plan: ExperimentPlan, lam_q: float = 0.5, lam_S: float = 0.42) -> TrackingMetrics:
    return compute_tracking_metrics(tracked(plan, lam_q=lam_q, lam_S=lam_S), plan.program(), plan.phases())


def by_name(criteria: tuple[RunCriterion, ...]) -> dict[str, RunCriterion]:
    return {item.name: item for item in criteria}


def test_holds_that_are_too_short_for_steps_pass_only_the_tension_criterion() -> None:
    criteria = by_name(tracking_criteria(measured(SHORT_HOLDS), "ideal"))
    assert {name: item.passed for name, item in criteria.items()} == {
        "overshoot_q": None,
        "overshoot_S": None,
        "deviation_S": None,
        "min_tension": True,
    }
    reason = criteria["overshoot_q"].reason
    assert_reason(reason, "steps_not_measured", reason=messages.not_settled())
    assert criteria["min_tension"].reason == ""


def test_a_step_that_begins_in_motion_has_no_metrics() -> None:
    """The step of S from 8 to 10 begins at 8.36, so S crosses 10 % before the step."""
    t = np.arange(0, 8, T_s)
    begins_at = 0.18
    y = 8.0 + 2.0 * (begins_at + (1 - begins_at) * double_lag(t, 0.42))
    result = compute_step_metrics(t, y, ReferenceStep("S", "stiffness", 0.0, 8.0, 8.0, 10.0, alone=True))
    assert (result.rise_s, result.reach_s, result.settling_s, result.overshoot_percent) == (None, None, None, None)
    for name in ("rise_s", "reach_s", "settling_s", "overshoot_percent"):
        assert_reason(result.reasons[name], "began_away_from_start", share=pytest.approx(begins_at))


def test_a_signal_that_passes_the_initial_value_in_motion_is_not_at_rest() -> None:
    """The signal crosses the initial value of the step at that moment, at twice the step size per second."""
    t = np.arange(0, 8, T_s)
    before = -2.0 * T_s * np.arange(100, 0, -1, dtype=float)
    result = compute_step_metrics(t, double_lag(t, 0.5), step(), before)
    assert result.rise_s is None
    assert_reason(result.reasons["rise_s"], "moved_at_start")
    assert compute_step_metrics(t, double_lag(t, 0.5), step(), np.zeros(100)).rise_s is not None


def test_overshoot_requires_a_step_that_settled_or_overshot() -> None:
    t = np.arange(0, 1.5, T_s)
    short = compute_step_metrics(t, double_lag(t, 0.5), step(end_s=1.5))
    came_to = 1 - 4 * math.exp(-3)  # 1 − (1 + x) exp(−x) at x = 3
    assert short.overshoot_percent is None
    assert_reason(short.reasons["reach_s"], "step_not_reached", share=pytest.approx(came_to, abs=0.005))
    assert_reason(short.reasons["overshoot_percent"], "not_settled")
    assert short.steady_error is None
    rings = 1 + 0.3 * np.cos(6 * t)
    rings[0] = 0.0
    assert compute_step_metrics(t, rings, step(end_s=1.5)).overshoot_percent == pytest.approx(30, abs=0.1)


def test_the_remainder_of_the_previous_motion_does_not_count_as_coupling() -> None:
    """With λ_q = 1 s and holds of 3 s, a fifth of the last step of q remains when S begins to step."""
    plan = build_ready_plan("tracking", q_duration_s=3.0, S_duration_s=8.0)
    columns = tracked(plan, lam_q=1.0)
    metrics = compute_tracking_metrics(columns, plan.program(), plan.phases())
    first, *rest = [item for item in metrics.steps if item.step.phase == "stiffness"]
    assert first.cross_coupling is None
    just_before = np.searchsorted(columns["t"], first.step.start_s - 0.1 - 1e-9)
    left = abs(columns["q"][just_before] - columns["q_ref"][just_before])
    deviation = pytest.approx(left, abs=0.005)
    assert_reason(first.reasons["cross_coupling"], "other_signal_moved", signal="q", deviation=deviation)
    assert all(item.cross_coupling is not None and item.cross_coupling < 0.01 for item in rest)
    assert metrics.overall.deviation_q == max(item.cross_coupling or 0.0 for item in rest)
    assert_reason(metrics.reasons["deviation_q"], "steps_not_measured", missing=1, steps=5)


def test_every_missing_metric_has_a_reason() -> None:
    for plan in (SHORT_HOLDS, build_ready_plan("tracking", q_duration_s=0.5, S_duration_s=0.5)):
        metrics = measured(plan)
        for name, value in vars(metrics.overall).items():
            assert value is not None or metrics.reasons[name], name
        for item in metrics.steps:
            for name in ("rise_s", "reach_s", "settling_s", "overshoot_percent", "steady_error", "cross_coupling"):
                assert getattr(item, name) is not None or item.reasons[name], name


def test_a_step_beyond_a_bound_fails_the_criterion_even_if_other_steps_are_not_measured() -> None:
    columns = tracked(SHORT_HOLDS)
    swings = (columns["t"] > 2.0) & (columns["t"] < 3.5)
    columns["q"] = np.where(swings, math.pi / 3 * 1.1, columns["q"])
    metrics = compute_tracking_metrics(columns, SHORT_HOLDS.program(), SHORT_HOLDS.phases())
    failed = by_name(tracking_criteria(metrics, "ideal"))["overshoot_q"]
    assert failed.passed is False
    assert failed.figure == pytest.approx(10.0)


def test_a_recording_with_gaps_or_nan_samples_passes_no_criterion() -> None:
    metrics = measured(build_ready_plan("tracking"))
    whole = tracking_criteria(metrics, "ideal")
    assert all(item.passed for item in whole)
    holes = tracking_criteria(metrics, "ideal", missed=12)
    assert {item.passed for item in holes} == {None}
    for item in holes:
        assert_reason(item.reason, "samples_missing", missed=12)
    for relation in "<>":
        nothing = evaluate_criterion("F", "Tension", relation, 5.0, math.nan, "N")
        assert (nothing.passed, nothing.figure) == (None, None)
        assert_reason(nothing.reason, "signal_without_value")


@pytest.mark.parametrize(
    ("signal", "criteria"), [("q", {"overshoot_q", "deviation_S"}), ("S", {"overshoot_S", "deviation_S"})]
)
def test_a_single_invalid_sample_prevents_passing(signal: str, criteria: set[str]) -> None:
    plan = build_ready_plan("tracking")
    columns = tracked(plan)
    columns[signal] = columns[signal].copy()
    columns[signal][[17_000, 45_000]] = np.nan  # in a step of q alone, and in one of S alone
    metrics = compute_tracking_metrics(columns, plan.program(), plan.phases())
    judged = by_name(tracking_criteria(metrics, "ideal"))
    assert {name for name, item in judged.items() if item.passed is None} == criteria
    for name in criteria:
        assert_reason(judged[name].reason, "steps_not_measured", reason=messages.sample_without_value())


def test_without_pushes_the_stiffness_is_not_measured() -> None:
    columns = pushed()
    for name, rest in (("q", 0.0), ("F_A", 17.0), ("F_B", 17.0)):
        columns[name] = np.full_like(columns["t"], rest)
    figures = compute_compliance_metrics(columns, R_J, LEAD_IN_S)
    assert (figures.stiffness_felt, figures.delay_s, figures.rmse_aligned_N) == (None, None, None)
    criteria = by_name(compliance_criteria(figures))
    assert criteria["rmse_aligned"].passed is None
    assert_reason(criteria["rmse_aligned"].reason, "push_too_weak", largest_N=0.0)
    assert criteria["min_tension"].passed


def test_a_delay_at_the_search_limit_is_not_measured() -> None:
    figures = compute_compliance_metrics(pushed(delay_ms=60), R_J, LEAD_IN_S)
    assert figures.delay_s is None
    assert_reason(figures.reasons["delay_s"], "delay_at_search_limit", limit_s=0.04)
