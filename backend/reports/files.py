"""What a run leaves in a folder: the report to read, the data and the metrics to compute with."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from backend.analysis.evaluation import catch_up
from backend.exports.base import stored_or_none
from backend.exports.formats import DataFormat, pieces, write_all
from backend.models.run import CRITERIA
from backend.reports.build import build_report
from backend.reports.html import to_html
from backend.reports.pdf import to_pdf
from backend.reports.source import Source, load_source
from backend.reports.verdict import verdict_of
from backend.storage.database import Database
from backend.storage.runs import EndState
from backend.units import Angles


def write_files(database: Database, run_id: int, folder: Path, angles: Angles = Angles.DEGREES) -> tuple[Path, ...]:
    """Write report.html, report.pdf, data.csv and metrics.json, all or none; make the folder where it is missing.

    ``angles`` is for the report; data and metrics are in SI. A run that was left behind gets its result first.

    Raises UnknownRecordError, ExportError, OSError.
    """
    catch_up(database, [run_id])
    source = load_source(database, run_id, angles)
    report = build_report(source)
    contents = {
        "report.html": to_html(report).encode(),
        "report.pdf": to_pdf(report),
        "metrics.json": json.dumps(metrics_document(source), indent=2, ensure_ascii=False).encode() + b"\n",
    }
    folder.mkdir(parents=True, exist_ok=True)
    data = pieces(stored_or_none(database, run_id), DataFormat.CSV, folder)
    write_all({**{folder / name: (content,) for name, content in contents.items()}, folder / "data.csv": data})
    return tuple(folder / name for name in ("report.html", "report.pdf", "data.csv", "metrics.json"))


def metrics_document(source: Source) -> dict[str, Any]:
    """Return what a program wants to know of a run: figures by name with units, criteria, steps, models."""
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
        "verdict": verdict_of(metrics, criteria).sentence,
        "labels": {item.name: item.label for item in figures},
        "units": {item.name: item.unit for item in figures},
        "criteria": CRITERIA.write(criteria),
        "steps": [asdict(step) for step in (metrics.steps or () if metrics else ())],
        "identification": None
        if found is None
        else {"estimate": found.id, "model": found.model, "quality": found.quality, "verdict": found.verdict},
    }
