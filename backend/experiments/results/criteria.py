"""Pass or fail of an experiment: criterion, bound, figure; and why one that was not measured is neither."""

import math
from dataclasses import dataclass

from backend.documents.result import Criterion
from backend.experiments.results.metrics import TrackingMetrics


@dataclass(frozen=True)
class Bounds:
    """What a parameter set promises: overshoot [%], stiffness deviation under q steps [N·m/rad], tension [N]."""

    overshoot_percent: float
    deviation_S: float
    min_tension_N: float


BOUNDS_IDEAL = Bounds(overshoot_percent=1.0, deviation_S=0.1, min_tension_N=5.0)
BOUNDS_LAB = Bounds(overshoot_percent=2.0, deviation_S=0.2, min_tension_N=4.0)


def bounds_for(parameters: str) -> Bounds:
    """Return the bounds of a parameter set by name; anything but ``ideal`` is judged as a real bench, like ``lab``."""
    return BOUNDS_IDEAL if parameters == "ideal" else BOUNDS_LAB


def tracking_criteria(metrics: TrackingMetrics, bounds: Bounds, missed: int = 0) -> tuple[Criterion, ...]:
    """Judge a tracking run of which the recording lacks ``missed`` samples."""
    overall = metrics.overall
    rows = (
        ("overshoot_q_percent", "overshoot_q", "Overshoot of q", "<", bounds.overshoot_percent, "%"),
        ("overshoot_S_percent", "overshoot_S", "Overshoot of S", "<", bounds.overshoot_percent, "%"),
        ("deviation_S", "deviation_S", "Stiffness deviation during q steps", "<", bounds.deviation_S, "N·m/rad"),
        ("min_tension_N", "min_tension", "Smallest tendon tension", ">", bounds.min_tension_N, "N"),
    )
    part = unseen(missed, "" if metrics.complete else ended_early(metrics.played_s, metrics.planned_s))
    return tuple(
        judge(name, title, relation, bound, getattr(overall, field), unit, metrics.reasons.get(field, "") or part)
        for field, name, title, relation, bound, unit in rows
    )


def ended_early(played_s: float, planned_s: float) -> str:
    """Return the reason that a run which ended before its program gives nothing to pass by."""
    return f"the run ended after {played_s:.1f} s of {planned_s:.1f} s"


def unseen(missed: int, early: str) -> str:
    """Return why a run was not seen whole: samples that its recording lacks, an early end; "" where it was."""
    return f"the recording lacks {missed} samples" if missed else early


def judge(
    name: str, title: str, relation: str, bound: float, figure: float | None, unit: str, reason: str = ""
) -> Criterion:
    """Judge one figure. With a ``reason`` why not all of it was measured it can fail and cannot pass."""
    if figure is None or math.isnan(figure):
        return Criterion(name, title, relation, bound, None, unit, None, reason or "the signal holds no number")
    held = figure < bound if relation == "<" else figure > bound
    if held and reason:
        return Criterion(name, title, relation, bound, figure, unit, None, reason)
    return Criterion(name, title, relation, bound, figure, unit, held, reason)
