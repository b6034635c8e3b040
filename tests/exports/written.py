"""Complete exports of samples in memory."""

from pathlib import Path
from tempfile import gettempdir

from backend.exports.base import export_columns
from backend.exports.formats import DataFormat, stream_export
from backend.recording.reader import Columns


def written(columns: Columns, kind: str) -> bytes:
    """Return an export in one piece."""
    return b"".join(stream_export(export_columns(columns, "samples"), DataFormat(kind), Path(gettempdir())))


def to_csv(columns: Columns) -> bytes:
    return written(columns, "csv")


def to_parquet(columns: Columns) -> bytes:
    return written(columns, "parquet")


def to_mat(columns: Columns) -> bytes:
    return written(columns, "mat")
