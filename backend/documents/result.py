"""What was computed from a run: figures, steps and criteria, each with what its reader needs to know. Pure.

Times in s from the start of the program, all numbers in SI, None where a figure does not exist.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from backend.documents.edge import ABSENT, Edge

VERSION = 1
DEFINITIONS = 1
"""Version of the definitions that figures and criteria are computed by: one more with each change of what one means.
Results from before it was kept have 0."""

OLDER = "evaluated by an older version, which kept no reason; evaluate the run again to have one"


@dataclass(frozen=True)
class Phase:
    """A named stretch of a program [s from its start]; the report draws one set of panels for each."""

    name: str
    title: str
    start_s: float
    end_s: float


@dataclass(frozen=True)
class Figure:
    """A figure of a result. ``reason`` says why it, or a part of it, was not measured; "" where nothing is missing."""

    name: str
    unit: str
    label: str
    definition: str
    value: float | None
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class StepFigures:
    """How one reference step of ``signal``, "q" or "S", went; ``reasons`` says by name what was not measured, and why.

    ``alone`` when the other reference stood still; the figures are those of ``StepMetrics``.
    """

    signal: str
    phase: str
    start_s: float
    end_s: float
    before: float
    after: float
    alone: bool
    rise_s: float | None
    reach_s: float | None = None
    settling_s: float | None
    overshoot_percent: float | None
    steady_error: float | None
    cross_coupling: float | None
    reasons: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Criterion:
    """One criterion. ``relation`` is "<" or ">".

    ``passed`` is None when it was not measured, and ``reason`` says why; ``figure`` is then what was seen, if anything.
    With a reason one that failed was not seen whole either: its figure is at least that where it has to stay below its
    bound, at most that where above.
    """

    name: str
    title: str
    relation: str
    bound: float
    figure: float | None
    unit: str
    passed: bool | None
    reason: str = ""


@dataclass(frozen=True, kw_only=True)
class Metrics:
    """Figures of a run; ``complete`` is False when it ended before its program: they then cover what was played.

    ``steps`` is None for a run that is not measured step by step, ``missing_samples`` where that was not kept;
    ``problem`` says why an identification gave no model; ``definitions`` is the version of what the figures mean.
    """

    complete: bool
    played_s: float
    planned_s: float
    figures: tuple[Figure, ...] = ()
    steps: tuple[StepFigures, ...] | None = field(default=None, metadata=ABSENT)
    phases: tuple[Phase, ...] = ()
    missing_samples: int | None = None
    problem: str = ""
    version: int = VERSION
    definitions: int = DEFINITIONS

    def value_of(self, name: str) -> float | None:
        """Return the figure of this name, None where it was not measured or is not there."""
        return next((item.value for item in self.figures if item.name == name), None)


def _metrics_with_reasons(document: Any) -> Any:
    if not isinstance(document, Mapping) or not isinstance(document.get("figures"), list):
        return document
    return {"definitions": 0, **document, "figures": [_with_reason(item, "value") for item in document["figures"]]}


def _criteria_with_reasons(document: Any) -> Any:
    return [_with_reason(item, "passed") for item in document] if isinstance(document, list) else document


def _with_reason(item: Any, measured: str) -> Any:
    """Give a figure or criterion from before reasons were kept one, where it was not measured."""
    if not isinstance(item, Mapping) or "reason" in item:
        return item
    return {**item, "reason": OLDER if item.get(measured) is None else ""}


METRICS: Edge[Metrics] = Edge(Metrics, "its result", VERSION, _metrics_with_reasons)
CRITERIA: Edge[tuple[Criterion, ...]] = Edge(tuple[Criterion, ...], "its criteria", 0, _criteria_with_reasons)
