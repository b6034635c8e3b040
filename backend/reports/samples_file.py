"""Samples of a run read back from a file that was exported, as they are stored."""

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from backend.exports.base import Batch, Facts, ImportRefusedError, described
from backend.exports.formats import DataFormat, read
from backend.exports.importer import require_told
from backend.exports.writers import heading_problem, schema_problem
from backend.recording.reader import Columns
from backend.reports.differences import Difference
from backend.sample import ADDED_LATER, STORED_NAMES

SUFFIXES = tuple(f".{kind}" for kind in DataFormat)


class SamplesFileError(ValueError):
    """A file that does not hold the samples of a run."""


def read_samples_file(file: Path) -> tuple[Columns, tuple[Difference, ...]]:
    """Return the columns of an export, ``t`` [s] and every stored signal, and how the file is not as it was exported.

    Raises SamplesFileError.
    """
    try:
        facts, batches = read(file)
        parts = list(batches)
    except (ImportRefusedError, OSError) as error:
        raise SamplesFileError(f"{file} cannot be read: {error}") from None
    missing = [name for name in STORED_NAMES if name not in facts.names and name not in ADDED_LATER]
    if "t" not in facts.names or "q" in missing:
        raise SamplesFileError(f"{file}: the column {missing[0]} is missing; it is no export of a run's samples")
    names = ("t", *(name for name in STORED_NAMES if name in facts.names))
    columns = {name: np.concatenate([part[name] for part in parts]).astype(np.float64) for name in names}
    # What an older version did not store was not measured; where the account has its check sum, that differs.
    columns |= {name: np.full(columns["t"].size, np.nan) for name in missing}
    return columns, tuple(_problems(file, facts, parts))


def _problems(file: Path, facts: Facts, parts: Sequence[Batch]) -> Iterator[Difference]:
    try:
        require_told(facts, parts)
    except ImportRefusedError as error:
        yield Difference("the file of the samples", "samples as they were exported", str(error))
    known = {column.name: column.unit for column in described(facts.fields)}
    for column in facts.columns:
        if column.unit != known[column.name]:
            yield Difference(f"unit of {column.name} in {file.name}", f"[{column.unit}]", f"[{known[column.name]}]")
    if file.suffix == ".csv" and (problem := heading_problem(file, facts)):
        yield Difference(f"units and meanings in {file.name}", "the lines of its export", problem)
    if file.suffix == ".parquet" and (problem := schema_problem(file, facts)):
        yield Difference(f"units and meanings in {file.name}", "the columns of its export", problem)
