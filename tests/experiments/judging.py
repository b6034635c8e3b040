"""What the ready-made experiments say of figures that a test has made or measured."""

from typing import Any

from backend.analysis.disturbance_metrics import ComplianceFigures, RobustnessFigures
from backend.analysis.evaluation import criteria_of, figure_documents, known_to_bounds
from backend.analysis.step_metrics import TrackingMetrics, ended_early, unseen
from backend.experiments.library import ready_plan
from backend.models.run import Criterion
from backend.tuning.gains import LAM_MOTOR, Lambdas
from plant.parameters import load_parameters

LEAD_IN_S = 6.0
"""Of compliance and robustness: time before the first push or load."""


def tracking_criteria(metrics: TrackingMetrics, parameters: str, missed: int = 0) -> tuple[Criterion, ...]:
    early = "" if metrics.complete else ended_early(metrics.played_s, metrics.planned_s)
    return _judged("tracking", metrics.overall, metrics.reasons, parameters, unseen(missed, early))


def compliance_criteria(figures: ComplianceFigures, reason: str = "") -> tuple[Criterion, ...]:
    return _judged("compliance", figures, figures.reasons, "lab", reason)


def robustness_criteria(
    figures: RobustnessFigures, lam_motor: float = LAM_MOTOR, reason: str = ""
) -> tuple[Criterion, ...]:
    return _judged("robustness", figures, figures.reasons, "lab", reason, Lambdas(lam_motor=lam_motor))


def _judged(
    name: str, figures: Any, reasons: Any, parameters: str, reason: str, lambdas: Lambdas | None = None
) -> tuple[Criterion, ...]:
    plan = ready_plan(name)
    known = known_to_bounds(dict(plan.values), load_parameters(parameters), lambdas or Lambdas())
    return criteria_of(plan.experiment, figure_documents(figures, reasons), known, reason)
