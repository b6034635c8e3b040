"""The report of what was played or done by hand without criteria: its curves, and figures where there are some."""

import json
from typing import Any

from backend.analysis.evaluation import used_settings
from backend.reports.document import Column, Figure, Paragraph, Report, Section, Table, exact
from backend.reports.judgement import results_section, verdict
from backend.reports.provenance import (
    S_NOTE,
    facts,
    lineage,
    parameter_section,
    settings_table,
    subtitle,
    table_of,
    tuning_facts,
)
from backend.reports.reproduction import reproduction
from backend.reports.source import Source
from backend.reports.tracking_figures import CUT_OFF, TENSIONS, WHAT_IS_DRAWN, tension_panel, tracking_panels
from backend.storage.runs import RunKind
from backend.units import Angles, read, reading_of

_TITLES = {RunKind.SESSION: "Session", RunKind.SEQUENCE: "Own sequence"}


def recording_report(source: Source) -> Report:
    """Build the report of a session or of an own sequence."""
    run = source.run
    title = _TITLES.get(RunKind(run.kind), "Recording")
    outcome, sentence = verdict(source)
    again = () if run.kind == RunKind.SESSION else reproduction(source)
    if run.kind == RunKind.SESSION:
        outcome, sentence = "neutral", "Recorded by hand: no program was played, nothing is judged."
    sections = [*results_section(source), Section("How it was made", (*_made(source), *again, *lineage(source)))]
    if source.columns["t"].size:
        sections += [_figures(source), Section("Notes", (Paragraph(S_NOTE),))]
    return Report(
        title=title,
        subtitle=subtitle(source),
        outcome=outcome,
        verdict=sentence,
        facts=(*facts(source), *tuning_facts(source)),
        sections=(*sections, parameter_section(source)),
        footer=f"Sinew {run.software} · {title.lower()} · run {run.id}",
        date=run.started_at,
    )


def _made(source: Source) -> tuple[Table, ...]:
    """Return the settings that are stored, own segments as a table of their own: nobody reads JSON."""
    if not source.run.set_to.declared:
        return ()
    declared = used_settings(source.run)
    sequence = next((item.value for item in declared if item.name == "segments"), None)
    if sequence is None:
        return (settings_table(source),)
    others = [item for item in declared if item.name != "segments"]
    return _segments_table(json.loads(str(sequence)), source.angles), table_of(others, source)


def _segments_table(segments: list[dict[str, Any]], angles: Angles) -> Table:
    columns = (
        Column("Segment"),
        Column("Shape", number=False),
        Column("Length", "s"),
        Column("q_ref", reading_of("rad", angles).unit),
        Column("S_ref", "N·m/rad"),
        Column("Push", "N"),
        Column("Period", "s"),
    )
    rows = tuple(
        (
            str(number),
            str(segment.get("shape", "step")),
            exact(segment["duration_s"]),
            exact(read(segment["q_ref"], "rad", angles)),
            exact(segment["S_ref"]),
            exact(segment.get("F_push", 0.0)),
            exact(segment["period_s"]) if segment.get("shape") == "sine" and "period_s" in segment else "",
        )
        for number, segment in enumerate(segments, start=1)
    )
    return Table("Segments of the sequence, in order.", columns, rows)


def _figures(source: Source) -> Section:
    columns, run = source.columns, source.run
    u_max, F_max = run.number("motor", "u_max"), run.number("safety", "F_max")
    panels = tracking_panels(columns, 0.0, float(columns["t"][-1]), "ABCDEF", "panels", u_max, source.angles)
    caption = f"{WHAT_IS_DRAWN}. References dashed. {CUT_OFF}"
    tensions = TENSIONS
    return Section(
        "Figures",
        (Figure("panels", panels, caption), Figure("tension", tension_panel(columns, F_max, "tension"), tensions)),
    )
