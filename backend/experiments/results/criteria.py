"""Pass or fail of an experiment: criterion, bound, figure; and why one that was not measured is neither."""

import math

from backend.models.run import Criterion


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
