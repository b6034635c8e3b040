"""A run's bundle with its report, made where none was handed out yet."""

from collections.abc import Iterator
from pathlib import Path

from backend.analysis.evaluation import catch_up
from backend.archive.imports import look_over
from backend.exports import bundle
from backend.exports.base import ExportError, ImportRefusedError
from backend.reports.model import load_source
from backend.reports.rendering import render
from backend.storage import results, runs
from backend.storage.database import Database
from backend.storage.runs import EndState, RunKind


def bundle_pieces(database: Database, run_id: int, folder: Path) -> Iterator[bytes]:
    """Return the bundle of a run, piece by piece; sessions have no report.

    Raises UnknownRecordError, and ExportError for what no installation would take in.
    """
    with database.reading() as session:
        run = runs.get(session, run_id)
        try:
            look_over(run)
        except ImportRefusedError as error:
            raise ExportError(f"run {run_id}: {error}") from None
        kept = results.newest_report(session, run_id, "html")
    report = None if kept is None else kept.content
    if report is None:
        catch_up(database, [run_id])
        source = load_source(database, run_id)
        if source.run.kind != RunKind.SESSION and source.run.end_state != EndState.RUNNING:
            report = render(source, "html")
    return bundle.write_bundle(database, run_id, report, folder)
