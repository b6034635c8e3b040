"""What a run came to, in one word and one sentence: the same in report, page, dry run and command line. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass
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


@dataclass(frozen=True)
class Verdict:
    """The outcome, and the sentence that says it."""

    outcome: Outcome
    sentence: str


def verdict_of(metrics: Metrics | None, criteria: Sequence[Criterion], problem: str = "") -> Verdict:
    """Judge a run by its stored metrics and criteria; ``problem`` says why it has none."""
    if metrics is None:
        return Verdict(Outcome.INCOMPLETE, f"No result: {problem or 'the run has not been evaluated'}.")
    if not metrics.complete:
        failed = _titles(criteria, passed=False)
        already = f" Already failed: {', '.join(failed)}." if failed else ""
        played = f"{metrics.played_s:.6g} s of {metrics.planned_s:.6g} s were played"
        return Verdict(Outcome.INCOMPLETE, f"Incomplete: {played}. Figures cover that part only.{already}")
    if not criteria:
        return Verdict(Outcome.NEUTRAL, "Completed. No criteria are set for this kind of run.")
    return _judged(criteria)


SEEN = {"<": "at least this", ">": "at most this"}
"""What a figure is that was not seen whole, by the relation to its bound."""


def _judged(criteria: Sequence[Criterion]) -> Verdict:
    failed, unmeasured = _titles(criteria, passed=False), _titles(criteria, passed=None)
    parts = []
    if failed:
        parts.append(f"{len(failed)} of {len(criteria)} criteria failed: {', '.join(failed)}.")
    if unmeasured:
        verb = "was" if len(unmeasured) == 1 else "were"
        parts.append(f"{len(unmeasured)} of {len(criteria)} criteria {verb} not measured: {', '.join(unmeasured)}.")
    if failed:
        return Verdict(Outcome.FAILED, " ".join(parts))
    if unmeasured:
        return Verdict(Outcome.INCOMPLETE, " ".join(parts))
    return Verdict(Outcome.PASSED, f"All {len(criteria)} criteria passed.")


def _titles(criteria: Sequence[Criterion], *, passed: bool | None) -> list[str]:
    return [item.title for item in criteria if item.passed is passed]
