"""Samples of a run read back from a file that was exported, as they are stored."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from backend.exports.errors import ImportRefusedError
from backend.exports.facts import Batch, Facts
from backend.exports.formats import DataFormat, read
from backend.exports.taking_in import require_told
from backend.recording.columns import Columns
from backend.sample import ADDED_LATER, STORED_NAMES

SUFFIXES = tuple(f".{kind}" for kind in DataFormat)


class SamplesFileError(ValueError):
    """A file that does not hold the samples of a run."""


def read_samples_file(file: Path) -> tuple[Columns, str]:
    """Return the columns of an export, ``t`` [s] and every stored signal, and why they are not those of its export.

    "" where they are. Raises SamplesFileError.
    """
    try:
        facts, batches = read(file)
        parts = list(batches)
    except (ImportRefusedError, OSError) as error:
        raise SamplesFileError(f"{file} cannot be read: {error}") from None
    missing = [name for name in STORED_NAMES if name not in facts.names and name not in ADDED_LATER]
    if missing:
        raise SamplesFileError(f"{file}: the column {missing[0]} is missing; it is no export of a run's samples")
    names = ("t", *(name for name in STORED_NAMES if name in facts.names))
    columns = {name: np.concatenate([part[name] for part in parts]).astype(np.float64) for name in names}
    return columns, _problem(facts, parts)


def _problem(facts: Facts, parts: Sequence[Batch]) -> str:
    try:
        require_told(facts, parts)
    except ImportRefusedError as error:
        return str(error)
    return ""
