"""What a run came to: its criteria, its figures, and a sentence that says it."""

from collections.abc import Sequence

from backend.identification.models import Grade
from backend.models.run import DEFINITIONS, Criterion, Metrics
from backend.reports.document import Column, Fact, Section, Table, exact, shown
from backend.reports.provenance import shown_unit
from backend.reports.source import Source
from backend.reports.verdict import SEEN, verdict_of
from backend.units import Angles, read

OUTCOMES = {Grade.USABLE: "passed", Grade.CAUTION: "incomplete", Grade.UNUSABLE: "failed"}
"""Outcome of a report by the grade of its model."""

NOT_MEASURED = "not measured"
_WORDS = {True: "pass", False: "fail", None: NOT_MEASURED}


def verdict(source: Source) -> tuple[str, str]:
    """Return the outcome (passed, failed, incomplete or neutral) and the sentence that heads the report."""
    result = source.result
    found = (
        verdict_of(None, (), source.run.evaluation_problem)
        if result is None
        else verdict_of(result.metrics, result.criteria)
    )
    return found.outcome, found.sentence


def definitions_facts(sources: Sequence[Source]) -> tuple[Fact, ...]:
    """Return a line that names the runs whose results are of other definitions than this version's; none for none."""
    of = {source.run.id: source.result.metrics.definitions for source in sources if source.result is not None}
    others = {number: version for number, version in of.items() if version != DEFINITIONS}
    if not others:
        return ()
    versions = " and ".join(map(str, sorted(set(others.values()))))
    commands = ", ".join(f"sinew runs evaluate {number}" for number in others)
    which = "" if len(sources) == 1 else f"of run {', '.join(map(str, others))}: "
    words = (
        f"{which}computed by version {versions} of the definitions of figures and criteria; this Sinew computes by "
        f"version {DEFINITIONS}. To compute anew, before a new report: {commands}"
    )
    return (Fact("Definitions", words),)


def measured(value: float | None, digits: int = 3) -> str:
    """Write a figure, or that it was not measured."""
    return NOT_MEASURED if value is None else shown(value, digits)


def read_or_none(value: float | None, unit: str, angles: Angles) -> float | None:
    """Return a figure in SI as it is read; none where none was measured."""
    return None if value is None else read(value, unit, angles)


def results_section(source: Source) -> tuple[Section, ...]:
    """Return criteria and figures; nothing for a run without a result."""
    if source.result is None:
        return ()
    tables = (
        criteria_table(source.result.criteria, source.angles),
        figures_table(source.result.metrics, source.angles),
    )
    return (Section("Results", tables if source.result.criteria else tables[1:]),)


def criteria_table(criteria: Sequence[Criterion], angles: Angles) -> Table:
    """Return each criterion with bound, figure and result."""
    columns = (
        Column("Criterion", number=False),
        Column("Bound"),
        Column("Figure"),
        Column("Unit", number=False),
        Column("Result", number=False, wide=True),
    )
    rows = tuple(
        (
            item.title,
            f"{item.relation} {exact(read(item.bound, item.unit, angles))}",
            measured(read_or_none(item.figure, item.unit, angles)),
            shown_unit(item.unit, angles),
            _with_reason(
                _WORDS[item.passed],
                item.reason,
                "" if item.passed is None else SEEN[item.relation],
            ),
        )
        for item in criteria
    )
    return Table("Criteria.", columns, rows)


def measured_figures(source: Source) -> tuple[Table, ...]:
    """Return the table of figures; none for a run without a result."""
    return () if source.result is None else (figures_table(source.result.metrics, source.angles),)


def figures_table(metrics: Metrics, angles: Angles) -> Table:
    """Return the figures of a result, each with unit and definition."""
    columns = (
        Column("Quantity", number=False),
        Column("Value"),
        Column("Unit", number=False),
        Column("Definition", number=False, wide=True),
    )
    part = "" if metrics.complete else " The run is incomplete: only finished steps count."
    rows = tuple(
        (
            item.label,
            measured(read_or_none(item.value, item.unit, angles)),
            shown_unit(item.unit, angles),
            _with_reason(
                item.definition,
                item.reason,
                "" if item.value is None else SEEN["<"],
            ),
        )
        for item in metrics.figures
    )
    return Table(f"Metrics on measured signals.{part}", columns, rows)


def _with_reason(text: str, reason: str, seen: str) -> str:
    if not reason:
        return text
    return f"{text}; {seen}: {reason}" if seen else f"{text}; {reason}"
