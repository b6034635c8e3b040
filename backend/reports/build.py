"""Which report a run gets."""

from backend.reports.actuator_identification import actuator_identification_report
from backend.reports.document import Report
from backend.reports.source import Source
from backend.reports.tracking import tracking_report
from backend.storage.runs import RunKind


def build_report(source: Source) -> Report:
    """Build the report of a run of any kind; what was only recorded gets its curves without a judgement."""
    if source.run.kind == RunKind.ACTUATOR_IDENTIFICATION:
        return actuator_identification_report(source)
    return tracking_report(source)
