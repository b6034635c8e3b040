"""Which report a run gets."""

from backend.reports.actuator_identification import actuator_identification_report
from backend.reports.compliance import compliance_report
from backend.reports.document import Report
from backend.reports.motor_identification import motor_identification_report
from backend.reports.recording import recording_report
from backend.reports.source import Source
from backend.reports.spring_identification import spring_identification_report
from backend.reports.tracking import tracking_report
from backend.storage.runs import RunKind

_BUILDERS = {
    RunKind.TRACKING: tracking_report,
    RunKind.COMPLIANCE: compliance_report,
    RunKind.ACTUATOR_IDENTIFICATION: actuator_identification_report,
    RunKind.MOTOR_IDENTIFICATION: motor_identification_report,
    RunKind.SPRING_IDENTIFICATION: spring_identification_report,
}


def build_report(source: Source) -> Report:
    """Build the report of a run of any kind; what was only recorded gets its curves without a judgement."""
    return _BUILDERS.get(RunKind(source.run.kind), recording_report)(source)
