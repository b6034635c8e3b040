"""The result of a run as it is stored: every figure with its label, unit and definition.

Reports, the page and the command line show what stands here; none of them needs to know how it was computed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

from backend.experiments.results.metrics import TrackingMetrics
from backend.experiments.results.steps import StepMetrics
from backend.models.run import Figure, Metrics, Phase, StepFigures


def tracking_document(metrics: TrackingMetrics, phases: Sequence[Phase], missing_samples: int = 0) -> Metrics:
    """Return completeness, overall figures, steps and phases."""
    return Metrics(
        complete=metrics.complete,
        played_s=metrics.played_s,
        planned_s=metrics.planned_s,
        figures=figure_documents(metrics.overall, metrics.reasons),
        steps=tuple(_step(item) for item in metrics.steps),
        phases=tuple(phases),
        missing_samples=missing_samples,
    )


def figure_documents(figures: Any, reasons: Mapping[str, str] | None = None) -> tuple[Figure, ...]:
    """Return the fields of a dataclass made of ``figure`` declarations with their declarations.

    ``reasons`` tells by name what could not be measured, or not on all steps, and why.
    """
    why = reasons or {}
    return tuple(
        Figure(
            name=item.name,
            **item.metadata,
            value=_finite(getattr(figures, item.name)),
            reason=why.get(item.name, ""),
        )
        for item in fields(figures)
        if item.metadata
    )


def _step(metrics: StepMetrics) -> StepFigures:
    figures = asdict(metrics)
    return StepFigures(**figures.pop("step"), **figures)


def _finite(value: float | None) -> float | None:
    return None if value is None or not math.isfinite(value) else value
