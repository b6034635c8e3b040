"""What the ready-made experiments say of figures that a test has made or measured."""

from typing import Any

from backend.analysis.disturbance_metrics import ComplianceFigures, RobustnessFigures
from backend.analysis.evaluation import criteria_of, figure_documents, known_to_bounds
from backend.analysis.step_metrics import TrackingMetrics, ended_early, unseen
from backend.experiments.library import build_ready_plan
from backend.models.run import RunCriterion
from backend.tuning.gains import LAM_MOTOR, TuningParameters
from plant.parameters import load_parameters

LEAD_IN_S = 6.0
"""Of compliance and robustness: time before the first push or load."""


def tracking_criteria(metrics: TrackingMetrics, parameters: str, missed: int = 0) -> tuple[RunCriterion, ...]:
    early = "" if metrics.complete else ended_early(metrics.played_s, metrics.planned_s)
    return _judged("tracking", metrics.overall, metrics.reasons, parameters, unseen(missed, early))


def compliance_criteria(figures: ComplianceFigures, reason: str = "") -> tuple[RunCriterion, ...]:
    return _judged("compliance", figures, figures.reasons, "lab", reason)


def robustness_criteria(
    figures: RobustnessFigures, lam_motor: float = LAM_MOTOR, reason: str = ""
) -> tuple[RunCriterion, ...]:
    return _judged("robustness", figures, figures.reasons, "lab", reason, TuningParameters(lam_motor=lam_motor))


def _judged(
    name: str, figures: Any, reasons: Any, parameters: str, reason: str, lambdas: TuningParameters | None = None
) -> tuple[RunCriterion, ...]:
    plan = build_ready_plan(name)
    known = known_to_bounds(dict(plan.values), load_parameters(parameters), lambdas or TuningParameters())
    return criteria_of(plan.experiment, figure_documents(figures, reasons), known, reason)
