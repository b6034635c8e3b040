"""Build the report of a run or a series by its kind, and write its files."""

import json
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from backend.analysis import evaluate_pending_runs
from backend.exports import DataFormat, export_run_if_recorded, stream_export, write_files_whole
from backend.models import CRITERIA
from backend.reports import messages
from backend.reports.evidence import ReportManifest, build_manifest, to_element
from backend.reports.experiment_report import (
    compliance_report,
    program_report,
    recording_report,
    robustness_report,
    tracking_report,
)
from backend.reports.identification_report import (
    actuator_identification_report,
    motor_identification_report,
    spring_identification_report,
)
from backend.reports.model import (
    NO_FIGURE,
    Block,
    Code,
    Column,
    Figure,
    Paragraph,
    Report,
    ReportSection,
    Table,
    to_html,
)
from backend.reports.pdf import to_pdf
from backend.reports.provenance import definitions_facts, judge_stored_run
from backend.reports.run_data import RunData, load_source
from backend.reports.timing import timing_section
from backend.storage import Database, EndState, RunKind
from backend.units import AngleUnit, format_text

# Build ---------------------------------------------------------------------------------------------
# Choice of the report by the kind of run.


_BUILDERS = {
    RunKind.TRACKING: tracking_report,
    RunKind.COMPLIANCE: compliance_report,
    RunKind.ROBUSTNESS: robustness_report,
    RunKind.EXPERIMENT: program_report,
    RunKind.SEQUENCE: program_report,
    RunKind.ACTUATOR_IDENTIFICATION: actuator_identification_report,
    RunKind.MOTOR_IDENTIFICATION: motor_identification_report,
    RunKind.SPRING_IDENTIFICATION: spring_identification_report,
}


def build_report(source: RunData) -> Report:
    """Build the report of a run of any kind.

    A run whose kind has no report of its own gets its curves without criteria.
    """
    report = _BUILDERS.get(RunKind(source.run.kind), recording_report)(source)
    report = replace(report, facts=(*report.facts, *definitions_facts([source])))
    manifest = build_manifest(source)
    if manifest is None:
        return format_report_angles(report, source.angles)
    sections = (*report.sections, *timing_section(source), hashes_section(manifest))
    return format_report_angles(replace(report, sections=sections, evidence=to_element(manifest)), source.angles)


def hashes_section(manifest: ReportManifest) -> ReportSection:
    """Return the section with the hashes of all inputs and the command to verify them."""
    rows = tuple((name, digest) for name, digest in manifest.hashes.items())
    titles = (Column("Content", number=False), Column("SHA-256", number=False, wide=True))
    command = Code(messages.every_number_is_recomputable(), "sinew report verify report.html")
    return ReportSection("Verification", (Table(messages.content_hashes(), titles, rows), command))


def format_report_angles(report: Report, angles: AngleUnit) -> Report:
    """Return the report with the angles in its prose in the display unit.

    Numbers in tables and axes are converted already. Text that a person has written stays as it is: text marked as
    quoted, or between “ and ”.
    """
    return replace(
        report,
        verdict=format_text(report.verdict, angles),
        facts=tuple(
            fact if fact.quoted else replace(fact, text=format_text(fact.text, angles)) for fact in report.facts
        ),
        sections=tuple(
            replace(section, blocks=tuple(_format_block_angles(block, angles) for block in section.blocks))
            for section in report.sections
        ),
    )


def _format_block_angles(block: Block, angles: AngleUnit) -> Block:
    match block:
        case Paragraph(text):
            return Paragraph(format_text(text, angles))
        case Table(caption, columns, rows):
            formatted = tuple(
                tuple(
                    cell if column.quoted else format_text(cell, angles)
                    for column, cell in zip(columns, row, strict=True)
                )
                for row in rows
            )
            if any(NO_FIGURE in row for row in rows):
                caption += f" {messages.dash_means_no_value()}"
            return Table(format_text(caption, angles), columns, formatted)
        case Figure(name, svg, caption):
            return Figure(name, svg, format_text(caption, angles))
        case Code(caption, text):
            return Code(format_text(caption, angles), text)


# Files ---------------------------------------------------------------------------------------------
# Files of a run in a folder: the report for people, the data and the metrics for programs.


def write_report_files(
    database: Database, run_id: int, folder: Path, angles: AngleUnit = AngleUnit.DEGREES
) -> tuple[Path, ...]:
    """Write report.html, report.pdf, data.csv and metrics.json, either all or none.

    Creates the folder if it is missing. ``angles`` is the display unit of the report; data and metrics are in SI units.
    A run whose evaluation is still pending is evaluated first. Raises UnknownRecordError, ExportError, OSError.
    """
    evaluate_pending_runs(database, [run_id])
    source = load_source(database, run_id, angles)
    report = build_report(source)
    contents = {
        "report.html": to_html(report).encode(),
        "report.pdf": to_pdf(report),
        "metrics.json": json.dumps(build_metrics_document(source), indent=2, ensure_ascii=False).encode() + b"\n",
    }
    folder.mkdir(parents=True, exist_ok=True)
    data = stream_export(export_run_if_recorded(database, run_id), DataFormat.CSV, folder)
    write_files_whole({**{folder / name: (content,) for name, content in contents.items()}, folder / "data.csv": data})
    return tuple(folder / name for name in ("report.html", "report.pdf", "data.csv", "metrics.json"))


def build_metrics_document(source: RunData) -> dict[str, Any]:
    """Return the metrics document: figures with units, criteria, steps and models."""
    run = source.run
    metrics = source.result.metrics if source.result else None
    criteria = source.result.criteria if source.result else ()
    figures = metrics.figures if metrics else ()
    found = source.identification
    return {
        "run": run.id,
        "kind": run.kind,
        "end_state": run.end_state,
        "end_detail": run.end_detail,
        "plant": run.plant,
        "parameters": run.parameters_name,
        "settings": run.settings,
        "complete": metrics.complete if metrics else False,
        "problem": metrics.problem if metrics else run.evaluation_problem,
        "missing_samples": metrics.missing_samples if metrics and run.end_state != EndState.SERVICE_DIED else None,
        "metrics": {item.name: item.value for item in figures},
        "not_measured": {item.name: item.reason for item in figures if item.reason},
        "verdict": judge_stored_run(metrics, criteria).sentence,
        "labels": {item.name: item.label for item in figures},
        "units": {item.name: item.unit for item in figures},
        "criteria": CRITERIA.write(criteria),
        "steps": [asdict(step) for step in (metrics.steps or () if metrics else ())],
        "identification": None
        if found is None
        else {"estimate": found.id, "model": found.model, "quality": found.quality, "verdict": found.verdict},
    }
