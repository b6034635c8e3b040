"""Which report a run gets."""

from dataclasses import replace

from backend.reports.actuator_identification import actuator_identification_report
from backend.reports.compliance import compliance_report
from backend.reports.composed import composed_report
from backend.reports.document import NO_FIGURE, Block, Code, Column, Figure, Paragraph, Report, Section, Table
from backend.reports.evidence import Evidence, evidence_of, to_element
from backend.reports.judgement import definitions_facts
from backend.reports.motor_identification import motor_identification_report
from backend.reports.recording import recording_report
from backend.reports.robustness import robustness_report
from backend.reports.source import Source
from backend.reports.spring_identification import spring_identification_report
from backend.reports.timing import timing_section
from backend.reports.tracking import tracking_report
from backend.storage.runs import RunKind
from backend.units import Angles, in_words

_BUILDERS = {
    RunKind.TRACKING: tracking_report,
    RunKind.COMPLIANCE: compliance_report,
    RunKind.ROBUSTNESS: robustness_report,
    RunKind.EXPERIMENT: composed_report,
    RunKind.ACTUATOR_IDENTIFICATION: actuator_identification_report,
    RunKind.MOTOR_IDENTIFICATION: motor_identification_report,
    RunKind.SPRING_IDENTIFICATION: spring_identification_report,
}


def build_report(source: Source) -> Report:
    """Build the report of a run of any kind; what was only recorded gets its curves without a judgement."""
    report = _BUILDERS.get(RunKind(source.run.kind), recording_report)(source)
    report = replace(report, facts=(*report.facts, *definitions_facts([source])))
    evidence = evidence_of(source)
    if evidence is None:
        return told(report, source.angles)
    sections = (*report.sections, *timing_section(source), hashes_section(evidence))
    return told(replace(report, sections=sections, evidence=to_element(evidence)), source.angles)


def hashes_section(evidence: Evidence) -> Section:
    """Return the hashes of what the report's numbers come from, and how they are verified."""
    rows = tuple((name, digest) for name, digest in evidence.hashes.items())
    titles = (Column("Of", number=False), Column("SHA-256", number=False, wide=True))
    words = (
        "Every number of this report can be computed again from the samples that it names. With data.csv beside it, or "
        "in the data folder of the run:"
    )
    return Section(
        "What it was made of", (Table("Content hashes.", titles, rows), Code(words, "sinew report verify report.html"))
    )


def told(report: Report, angles: Angles) -> Report:
    """Return a report with the angles in its prose as they are read; numbers of tables and axes are so already.

    What somebody has written or named stays as it was written: what is marked as quoted, or stands between “ and ”.
    """
    return replace(
        report,
        verdict=in_words(report.verdict, angles),
        facts=tuple(fact if fact.quoted else replace(fact, text=in_words(fact.text, angles)) for fact in report.facts),
        sections=tuple(
            replace(section, blocks=tuple(_told_block(block, angles) for block in section.blocks))
            for section in report.sections
        ),
    )


def _told_block(block: Block, angles: Angles) -> Block:
    match block:
        case Paragraph(text):
            return Paragraph(in_words(text, angles))
        case Table(caption, columns, rows):
            told = tuple(
                tuple(
                    cell if column.quoted else in_words(cell, angles) for column, cell in zip(columns, row, strict=True)
                )
                for row in rows
            )
            if any(NO_FIGURE in row for row in rows):
                caption += f" {NO_FIGURE} means: there is no such figure."
            return Table(in_words(caption, angles), columns, told)
        case Figure(name, svg, caption):
            return Figure(name, svg, in_words(caption, angles))
        case Code(caption, text):
            return Code(in_words(caption, angles), text)
