"""What a run came to, in one word and one sentence: the same in report, page, dry run and command line. Pure."""

from collections.abc import Sequence
from dataclasses import dataclass

from backend.models.run import Criterion, Metrics, Outcome, outcome_of

__all__ = ["SEEN", "Outcome", "Verdict", "verdict_of"]


@dataclass(frozen=True)
class Verdict:
    """The outcome, and the sentence that says it."""

    outcome: Outcome
    sentence: str


def verdict_of(metrics: Metrics | None, criteria: Sequence[Criterion], problem: str = "") -> Verdict:
    """Judge a run by its stored metrics and criteria; ``problem`` says why it has none."""
    if metrics is None:
        return Verdict(outcome_of(metrics, criteria), f"No result: {problem or 'the run has not been evaluated'}.")
    if not metrics.complete:
        failed = _titles(criteria, passed=False)
        already = f" Already failed: {', '.join(failed)}." if failed else ""
        played = f"{metrics.played_s:.6g} s of {metrics.planned_s:.6g} s were played"
        return Verdict(outcome_of(metrics, criteria), f"Incomplete: {played}. Figures cover that part only.{already}")
    if not criteria:
        return Verdict(outcome_of(metrics, criteria), "Completed. No criteria are set for this kind of run.")
    return Verdict(outcome_of(metrics, criteria), _judged(criteria))


SEEN = {"<": "at least this", ">": "at most this"}
"""What a figure is that was not seen whole, by the relation to its bound."""


def _judged(criteria: Sequence[Criterion]) -> str:
    failed, unmeasured = _titles(criteria, passed=False), _titles(criteria, passed=None)
    parts = []
    if failed:
        parts.append(f"{len(failed)} of {len(criteria)} criteria failed: {', '.join(failed)}.")
    if unmeasured:
        verb = "was" if len(unmeasured) == 1 else "were"
        parts.append(f"{len(unmeasured)} of {len(criteria)} criteria {verb} not measured: {', '.join(unmeasured)}.")
    all_passed = "The criterion passed." if len(criteria) == 1 else f"All {len(criteria)} criteria passed."
    return " ".join(parts) or all_passed


def _titles(criteria: Sequence[Criterion], *, passed: bool | None) -> list[str]:
    return [item.title for item in criteria if item.passed is passed]
