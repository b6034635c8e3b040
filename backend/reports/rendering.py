"""Renders the report of a run or of a series as a file, in a worker process.

Drawing and typesetting are imported with the first report, not when the service starts.
"""

from collections.abc import Sequence

from backend.reports.run_data import RunData


def render_report(source: RunData, kind: str) -> bytes:
    """Return the report as "html" or "pdf"."""
    from backend.reports.build import build_report
    from backend.reports.model import to_html
    from backend.reports.pdf import to_pdf

    report = build_report(source)
    return to_pdf(report) if kind == "pdf" else to_html(report).encode()


def render_series_report(sources: Sequence[RunData], kind: str) -> bytes:
    """Return the report of a series as "html" or "pdf"."""
    from backend.reports.model import to_html
    from backend.reports.pdf import to_pdf
    from backend.reports.series import series_report

    report = series_report(sources)
    return to_pdf(report) if kind == "pdf" else to_html(report).encode()
