"""Evaluates the criteria of ready-made experiments for given metrics."""

from typing import Any

from backend.analysis.disturbance_metrics import ComplianceMetrics, RobustnessMetrics
from backend.analysis.evaluation import build_metric_documents, collect_bound_values, evaluate_criteria
from backend.analysis.step_metrics import TrackingMetrics, format_early_end, format_incomplete
from backend.experiments.library import build_ready_plan
from backend.models.run import RunCriterion
from backend.tuning.gains import LAM_MOTOR, TuningParameters
from plant.parameters import load_parameters

LEAD_IN_S = 6.0
"""Of compliance and robustness: time before the first push or load."""


def tracking_criteria(metrics: TrackingMetrics, parameters: str, missed: int = 0) -> tuple[RunCriterion, ...]:
    early = "" if metrics.complete else format_early_end(metrics.played_s, metrics.planned_s)
    return _judged("tracking", metrics.overall, metrics.reasons, parameters, format_incomplete(missed, early))


def compliance_criteria(figures: ComplianceMetrics, reason: str = "") -> tuple[RunCriterion, ...]:
    return _judged("compliance", figures, figures.reasons, "lab", reason)


def robustness_criteria(
    figures: RobustnessMetrics, lam_motor: float = LAM_MOTOR, reason: str = ""
) -> tuple[RunCriterion, ...]:
    return _judged("robustness", figures, figures.reasons, "lab", reason, TuningParameters(lam_motor=lam_motor))


def _judged(
    name: str, figures: Any, reasons: Any, parameters: str, reason: str, lambdas: TuningParameters | None = None
) -> tuple[RunCriterion, ...]:
    plan = build_ready_plan(name)
    known = collect_bound_values(dict(plan.values), load_parameters(parameters), lambdas or TuningParameters())
    return evaluate_criteria(plan.experiment, build_metric_documents(figures, reasons), known, reason)
