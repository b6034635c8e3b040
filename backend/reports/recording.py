"""The report of what was played or done by hand without criteria: its curves, and figures where there are some."""

from backend.reports.document import Figure, Report, Section
from backend.reports.judgement import results_section, verdict
from backend.reports.provenance import facts, lineage, parameter_section, settings_table, subtitle, tuning_facts
from backend.reports.source import Source
from backend.reports.tracking_figures import tension_panel, tracking_panels
from backend.storage.runs import RunKind

_TITLES = {RunKind.SESSION: "Session", RunKind.SEQUENCE: "Own sequence"}


def recording_report(source: Source) -> Report:
    """Build the report of a session or of an own sequence."""
    run = source.run
    title = _TITLES.get(RunKind(run.kind), "Recording")
    outcome, sentence = verdict(source)
    if run.kind == RunKind.SESSION:
        outcome, sentence = "neutral", "Recorded by hand: no program was played, nothing is judged."
    made = (settings_table(source),) if run.settings.get("declared") else ()
    sections = [*results_section(source), Section("How it was made", (*made, *lineage(source)))]
    if source.columns["t"].size:
        sections.append(_figures(source))
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


def _figures(source: Source) -> Section:
    columns, parameters = source.columns, source.run.parameters
    u_max, F_max = parameters["motor"]["u_max"]["value"], parameters["safety"]["F_max"]["value"]
    panels = tracking_panels(columns, 0.0, float(columns["t"][-1]), "ABC", "panels", u_max)
    caption = "(A) joint position, (B) joint stiffness, (C) motor voltages. References dashed."
    tensions = "Tendon tensions as the load cells show them."
    return Section(
        "Figures",
        (Figure("panels", panels, caption), Figure("tension", tension_panel(columns, F_max, "tension"), tensions)),
    )
