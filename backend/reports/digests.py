"""Content hashes: what a report was made of, so that whoever has the same can tell that it is the same."""

import hashlib
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.recording.reader import Columns
from backend.sample import STORED_NAMES
from plant.interface import T_s

BLOCK_S = 1.0
"""Samples have a check sum for each signal and stretch of this length [s]: it says where one was changed."""

HASHED = ("t", *STORED_NAMES)
_BLOCK = round(BLOCK_S / T_s)


def of_samples(columns: Columns) -> str:
    """Return the SHA-256 of all samples signal by signal: their times, then what is stored of each."""
    found = hashlib.sha256()
    for name in _present(columns):
        found.update(_stored(columns, name).tobytes())
    return found.hexdigest()


def blocks_of(columns: Columns) -> dict[str, list[str]]:
    """Return for each signal, and their times, the check sum of each stretch of its samples."""
    size = columns["t"].size
    return {
        name: [_check(stored[start : start + _BLOCK]) for start in range(0, size, _BLOCK)]
        for name, stored in ((name, _stored(columns, name)) for name in _present(columns))
    }


def _present(columns: Columns) -> list[str]:
    return [name for name in HASHED if name in columns]


def _check(stored: NDArray[Any]) -> str:
    return f"{zlib.crc32(stored.tobytes()):08x}"


def _stored(columns: Columns, name: str) -> NDArray[Any]:
    """Return times in whole ns, which every format gives back; signals in single precision, with one kind of nan."""
    if name == "t":
        return np.rint(1e9 * columns["t"]).astype("<f8")
    stored = np.ascontiguousarray(columns[name], dtype="<f4")
    return np.where(np.isnan(stored), np.float32(np.nan), stored).astype("<f4")
