"""One file of a run, by its kind: what is asked for in a process of its own.

What draws and sets type is loaded there, when the first report is asked for: the service only names these functions.
"""

from collections.abc import Callable

from backend.recording.columns import Columns
from backend.reports.exports import to_csv, to_mat, to_parquet
from backend.reports.source import Source

EXPORTS: dict[str, Callable[[Columns], bytes]] = {"csv": to_csv, "parquet": to_parquet, "mat": to_mat}


def render(source: Source, kind: str) -> bytes:
    """Return the report as "html" or "pdf"."""
    from backend.reports.build import build_report
    from backend.reports.html import to_html
    from backend.reports.pdf import to_pdf

    report = build_report(source)
    return to_pdf(report) if kind == "pdf" else to_html(report).encode()


def export(columns: Columns, kind: str) -> bytes:
    """Return all samples as "csv", "parquet" or "mat"."""
    return EXPORTS[kind](columns)
