"""The formats of an export, by their names: how each is written and read."""

from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum
from pathlib import Path

from backend.exports import csv_file, mat_file, mcap_file, parquet_file
from backend.exports.errors import ImportRefusedError
from backend.exports.facts import Batch, Facts
from backend.exports.files import write_whole
from backend.exports.source import Export


class DataFormat(StrEnum):
    """Formats that samples can be downloaded in."""

    CSV = "csv"
    PARQUET = "parquet"
    MAT = "mat"
    MCAP = "mcap"


MEDIA_TYPES = {
    DataFormat.CSV: "text/csv; charset=utf-8",
    DataFormat.PARQUET: "application/vnd.apache.parquet",
    DataFormat.MAT: "application/x-matlab-data",
    DataFormat.MCAP: "application/octet-stream",
}

_READ = {
    DataFormat.CSV: csv_file.read,
    DataFormat.PARQUET: parquet_file.read,
    DataFormat.MAT: mat_file.read,
    DataFormat.MCAP: mcap_file.read,
}


def pieces(export: Export, kind: DataFormat, folder: Path) -> Iterator[bytes]:
    """Return the file piece by piece; ``folder`` has room for what a format has to turn. Raises ExportError."""
    match kind:
        case DataFormat.CSV:
            return csv_file.write(export)
        case DataFormat.PARQUET:
            return parquet_file.write(export)
        case DataFormat.MAT:
            return mat_file.write(export, folder)
        case DataFormat.MCAP:
            return mcap_file.write(export)


def write_file(export: Export, kind: DataFormat, file: Path) -> None:
    """Write the whole file or none. Raises ExportError, OSError."""
    write_whole(pieces(export, kind, file.parent), file)


def read(file: Path) -> tuple[Facts, Iterator[Batch]]:
    """Return facts and samples of an export; its name says the format.

    Raises ImportRefusedError, also while the samples are read, OSError.
    """
    kind = file.suffix.removeprefix(".").lower()
    if kind not in set(DataFormat):
        raise ImportRefusedError(f"it is none of {', '.join(f'.{one}' for one in DataFormat)}")
    file.stat()  # one that is not there is no matter of its content
    with _refused():
        facts, batches = _READ[DataFormat(kind)](file)
    return facts, _each(batches)


def _each(batches: Iterator[Batch]) -> Iterator[Batch]:
    with _refused():
        yield from batches


@contextmanager
def _refused() -> Iterator[None]:
    """Refuse whatever a library stumbles over in a file: it may be anybody's."""
    try:
        yield
    except (ImportRefusedError, GeneratorExit):
        raise
    except Exception as error:
        first = (str(error).splitlines() or [type(error).__name__])[0]
        raise ImportRefusedError(f"it is damaged, or no file of this kind: {first}") from error
