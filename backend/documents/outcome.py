"""How a run counts, from its stored metrics and criteria: for its verdict, and for whoever looks for it. Pure."""

from collections.abc import Sequence
from enum import StrEnum

from backend.documents.result import Criterion, Metrics


class Outcome(StrEnum):
    """How a run counts."""

    PASSED = "passed"
    FAILED = "failed"
    INCOMPLETE = "incomplete"
    """it ended early, or not all of it could be measured"""
    NEUTRAL = "neutral"
    """there is nothing to judge it by"""


def outcome_of(metrics: Metrics | None, criteria: Sequence[Criterion]) -> Outcome:
    """Judge a run; one criterion that failed decides, then one that was not measured."""
    if metrics is None or not metrics.complete:
        return Outcome.INCOMPLETE
    if not criteria:
        return Outcome.NEUTRAL
    if any(item.passed is False for item in criteria):
        return Outcome.FAILED
    return Outcome.INCOMPLETE if any(item.passed is None for item in criteria) else Outcome.PASSED
