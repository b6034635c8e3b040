"""What the reports of all judged experiments have in common: the order in which one is read."""

from collections.abc import Iterable

from backend.reports.document import Paragraph, Report, Section
from backend.reports.judgement import results_section, verdict
from backend.reports.provenance import facts, lineage, parameter_section, settings_table, subtitle, tuning_facts
from backend.reports.reproduction import reproduction
from backend.reports.source import Source


def experiment_report(source: Source, title: str, name: str, seen: Iterable[Section], notes: tuple[str, ...]) -> Report:
    """Build the report of an experiment: verdict and criteria, how it was made, what was ``seen``, notes, parameters.

    ``name`` is what the footer calls the experiment. A run without result says why it has none.
    """
    outcome, sentence = verdict(source)
    return Report(
        title=title,
        subtitle=subtitle(source),
        outcome=outcome,
        verdict=sentence,
        facts=(*facts(source), *tuning_facts(source)),
        sections=(
            *results_section(source),
            Section("How it was made", (settings_table(source), *reproduction(source), *lineage(source))),
            *seen,
            Section("Notes", tuple(Paragraph(note) for note in notes)),
            parameter_section(source),
        ),
        footer=f"Sinew {source.run.software} · {name} · run {source.run.id}",
        date=source.run.started_at,
    )
