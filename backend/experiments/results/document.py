"""The result of a run as a document: every figure with its label, unit and definition, ready for JSON.

Reports, the page and the command line show what stands here; none of them needs to know how it was computed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any

from backend.experiments.plans.phase import Phase
from backend.experiments.results.criteria import Criterion
from backend.experiments.results.metrics import TrackingMetrics
from backend.experiments.results.steps import StepMetrics

Document = dict[str, Any]


def tracking_document(metrics: TrackingMetrics, phases: Sequence[Phase]) -> Document:
    """Return completeness, overall figures (name, label, unit, definition, value), steps and phases."""
    return {
        "complete": metrics.complete,
        "played_s": metrics.played_s,
        "planned_s": metrics.planned_s,
        "figures": figure_documents(metrics.overall, metrics.reasons),
        "steps": [_step(item) for item in metrics.steps],
        "phases": [asdict(phase) for phase in phases],
    }


def figure_documents(figures: Any, reasons: Mapping[str, str] | None = None) -> list[Document]:
    """Return the fields of a dataclass made of ``figure`` declarations as self-describing JSON objects.

    ``reasons`` tells by name what could not be measured, or not on all steps, and why.
    """
    values, why = json_ready(asdict(figures)), reasons or {}
    return [
        {"name": item.name, **item.metadata, "value": values[item.name], "reason": why.get(item.name, "")}
        for item in fields(figures)
        if item.metadata
    ]


def criteria_documents(criteria: Sequence[Criterion]) -> list[Document]:
    """Return the criteria as JSON objects."""
    return [json_ready(asdict(item)) for item in criteria]


def json_ready(document: Mapping[str, Any]) -> Document:
    """Return the same document with null for nan and infinity, which JSON does not have."""
    return {name: _ready(value) for name, value in document.items()}


def _step(metrics: StepMetrics) -> Document:
    figures = json_ready(asdict(metrics))
    step: Document = figures.pop("step")
    return {**step, **figures}


def _ready(value: Any) -> Any:
    if isinstance(value, Mapping):
        return json_ready(value)
    if isinstance(value, list | tuple):
        return [_ready(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
