"""What a run came to: its criteria, its figures, and a sentence that says it."""

from collections.abc import Mapping
from typing import Any

from backend.identification.result import Grade
from backend.reports.document import Column, Section, Table, exact, shown
from backend.reports.provenance import shown_unit
from backend.reports.source import Source

OUTCOMES = {Grade.USABLE: "passed", Grade.CAUTION: "incomplete", Grade.UNUSABLE: "failed"}
"""Outcome of a report by the grade of its model."""

_WORDS = {True: "pass", False: "fail", None: "not judged"}


def verdict(source: Source) -> tuple[str, str]:
    """Return the outcome (passed, failed, incomplete or neutral) and the sentence that heads the report."""
    if source.result is None:
        return "incomplete", "No result: the run holds no samples of its program."
    metrics, criteria = source.result.metrics, source.result.criteria
    failed = [item["title"] for item in criteria if item["passed"] is False]
    if not metrics["complete"]:
        played = f"{exact(metrics['played_s'])} s of {exact(metrics['planned_s'])} s were played"
        already = f" Already failed: {', '.join(failed)}." if failed else ""
        return "incomplete", f"Incomplete: {played}. Figures cover that part only.{already}"
    if failed:
        return "failed", f"{len(failed)} of {len(criteria)} criteria failed: {', '.join(failed)}."
    if not criteria:
        return "neutral", "Completed. No criteria are set for this kind of run."
    unjudged = sum(item["passed"] is None for item in criteria)
    if unjudged:
        return "incomplete", f"{unjudged} of {len(criteria)} criteria could not be judged."
    return "passed", f"All {len(criteria)} criteria passed."


def results_section(source: Source) -> tuple[Section, ...]:
    """Return criteria and figures; nothing for a run without a result."""
    if source.result is None:
        return ()
    tables = (criteria_table(source.result.criteria), figures_table(source.result.metrics))
    return (Section("Results", tables if source.result.criteria else tables[1:]),)


def criteria_table(criteria: list[dict[str, Any]]) -> Table:
    """Return each criterion with bound, figure and result."""
    columns = (
        Column("Criterion", number=False, wide=True),
        Column("Bound"),
        Column("Figure"),
        Column("Unit", number=False),
        Column("Result", number=False),
    )
    rows = tuple(
        (
            item["title"],
            f"{item['relation']} {exact(item['bound'])}",
            shown(item["figure"]),
            item["unit"],
            _WORDS[item["passed"]],
        )
        for item in criteria
    )
    return Table("Criteria.", columns, rows)


def figures_table(metrics: Mapping[str, Any]) -> Table:
    """Return the figures of a result, each with unit and definition."""
    columns = (
        Column("Quantity", number=False),
        Column("Value"),
        Column("Unit", number=False),
        Column("Definition", number=False, wide=True),
    )
    part = "" if metrics["complete"] else " The run is incomplete: only finished steps count."
    rows = tuple(
        (item["label"], shown(item["value"]), shown_unit(item["unit"]), item["definition"])
        for item in metrics["figures"]
    )
    return Table(f"Metrics on measured signals.{part}", columns, rows)
