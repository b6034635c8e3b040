"""Comparisons as comma-separated text, in SI: aligned curves with their differences, and what differs as a table."""

import csv
import io
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend import __version__
from backend.archive.comparison import compare
from backend.archive.differences import beside
from backend.plain_text import as_cell, as_comment
from backend.sample import FIELDS
from backend.schemas.comparison import AlignBy, ComparisonAsked, DifferencesAsked, RunComparison
from backend.storage.database import Database

_ROWS = 20_000
"""Lines that are written at once."""

_TABLE = ("what", "name", "label", "unit", "run", "value", "difference", "percent", "remark")


def curves_file(database: Database, asked: DifferencesAsked) -> Iterator[bytes]:
    """Yield a signal of all runs on the reference's samples, and its differences; nan where a run has none.

    Raises RefusalError, UnknownRecordError, UnknownSignalError, before the first piece.
    """
    import pyarrow as pa
    import pyarrow.csv

    with database.reading() as session:
        compared, found = compare(session, asked), beside(session, asked)
    # signals are written as finely as they were stored, times and differences in full
    own = found.own.astype(np.float32)
    meaning = next((f"{field.symbol}: {field.meaning}" for field in FIELDS if field.name == asked.signal), "")
    columns: dict[str, tuple[NDArray[Any], str, str]] = {}
    columns["t"] = (found.t, "s", f"time since the first sample of run {found.reference}")
    name, unit = asked.signal, found.unit
    columns[f"{name}_run_{found.reference}"] = own, unit, f"{meaning}; of run {found.reference}, the reference"
    for run, values in found.others.items():
        shift = f"its times shifted by {found.offsets[run]:+.6g} s" if run in found.offsets else found.reasons[run]
        columns[f"{name}_run_{run}"] = values.astype(np.float32), unit, f"{meaning}; of run {run}, {shift}"
    for run, values in found.others.items():
        words = f"run {run} minus run {found.reference}"
        columns[f"d_{name}_run_{run}"] = values - found.own, unit, words
    lines = [
        *_head(compared, asked),
        *(as_comment(f"{name} [{unit}] {words}") for name, (_, unit, words) in columns.items()),
    ]
    yield ("\n".join([*lines, ",".join(columns)]) + "\n").encode()
    plain = pyarrow.csv.WriteOptions(include_header=False, quoting_style="none")
    for begin in range(0, found.t.size, _ROWS):
        part = {name: column[begin : begin + _ROWS] for name, (column, _, _) in columns.items()}
        buffer = io.BytesIO()
        pyarrow.csv.write_csv(pa.table(part), buffer, plain)
        yield buffer.getvalue()


def table_file(database: Database, asked: ComparisonAsked) -> Iterator[bytes]:
    """Yield a line for each metric and differing setting of each run. Raises RefusalError, UnknownRecordError."""
    with database.reading() as session:
        found = compare(session, asked)
    text = io.StringIO()
    text.write(
        "\n".join([*_head(found, asked), as_comment("differences are to the reference, percent is of it")]) + "\n"
    )
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(_TABLE)
    for metric in found.metrics:
        for run, one in zip(found.runs, metric.values, strict=True):
            row = (one.value, one.difference, one.percent, one.reason)
            lines.writerow(map(as_cell, ("metric", metric.name, metric.label, metric.unit, run.id, *row)))
    for setting in found.settings:
        for run, value in zip(found.runs, setting.values, strict=True):
            remark = "not set" if value is None else ""
            of_setting = ("setting", setting.name, "", setting.unit, run.id, value, "", "", remark)
            lines.writerow(map(as_cell, of_setting))
    yield text.getvalue().encode()


def _head(found: RunComparison, asked: ComparisonAsked) -> Iterator[str]:
    said = f"comparison with run {found.reference}, Sinew {__version__}; SI units, angles in rad; {_aligned(asked)}"
    yield as_comment(said)
    for run in found.runs:
        where = run.not_aligned or f"t is its own time {run.offset_s or 0.0:+.6g} s"
        yield as_comment(f"run {run.id}: {run.title}, {run.started.isoformat()}, by {run.who}; {where}")


def _aligned(asked: ComparisonAsked) -> str:
    match asked.by:
        case AlignBy.BEGIN:
            return "aligned by the begin of each run"
        case AlignBy.STEP:
            return f"aligned by step {asked.number} of {asked.step}"
        case AlignBy.EVENT:
            return f"aligned by event {asked.number} of the kind {asked.event}"
