"""The result of a run as a document: every figure with its label, unit and definition, ready for JSON.

Reports, the page and the command line show what stands here; none of them needs to know how it was computed.
"""

import math
from collections.abc import Sequence
from dataclasses import asdict, fields
from typing import Any

from backend.experiments.criteria import Criterion
from backend.experiments.metrics import Overall, TrackingMetrics
from backend.experiments.plans import Phase

Document = dict[str, Any]


def tracking_document(metrics: TrackingMetrics, phases: Sequence[Phase]) -> Document:
    """Return completeness, overall figures (name, label, unit, definition, value), steps and phases."""
    figures = [
        {"name": f.name, **f.metadata, "value": _plain(getattr(metrics.overall, f.name))} for f in fields(Overall)
    ]
    steps = [{**asdict(item.step), **_figures(asdict(item))} for item in metrics.steps]
    return {
        "complete": metrics.complete,
        "played_s": metrics.played_s,
        "planned_s": metrics.planned_s,
        "figures": figures,
        "steps": steps,
        "phases": [asdict(phase) for phase in phases],
    }


def criteria_documents(criteria: Sequence[Criterion]) -> list[Document]:
    """Return the criteria as JSON objects."""
    return [_figures(asdict(item)) for item in criteria]


def _figures(item: Document) -> Document:
    return {name: _plain(value) for name, value in item.items() if name != "step"}


def _plain(value: Any) -> Any:
    """JSON has no nan: a figure that cannot be told is null."""
    return None if isinstance(value, float) and not math.isfinite(value) else value
