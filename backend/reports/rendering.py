"""One file of a run or of a series, by its kind: what is asked for in a process of its own.

What draws and sets type is loaded there, when the first report is asked for: the service only names these functions.
"""

from collections.abc import Sequence

from backend.reports.source import Source


def render(source: Source, kind: str) -> bytes:
    """Return the report as "html" or "pdf"."""
    from backend.reports.build import build_report
    from backend.reports.html import to_html
    from backend.reports.pdf import to_pdf

    report = build_report(source)
    return to_pdf(report) if kind == "pdf" else to_html(report).encode()


def render_series(sources: Sequence[Source], kind: str) -> bytes:
    """Return the report of a series as "html" or "pdf"."""
    from backend.reports.html import to_html
    from backend.reports.pdf import to_pdf
    from backend.reports.series import series_report

    report = series_report(sources)
    return to_pdf(report) if kind == "pdf" else to_html(report).encode()
