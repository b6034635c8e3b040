"""Content hashes: what a report was made of, so that whoever has the same can tell that it is the same."""

import hashlib
import zlib

import numpy as np

from backend.recording.columns import Columns
from backend.sample import STORED_NAMES
from plant.interface import T_s

BLOCK_S = 1.0
"""Samples have a check sum for each signal and stretch of this length [s]: it says where one was changed."""

_BLOCK = round(BLOCK_S / T_s)


def of_samples(columns: Columns) -> str:
    """Return the SHA-256 of all samples as they are stored, in single precision, signal by signal."""
    found = hashlib.sha256()
    for name in _present(columns):
        found.update(_stored(columns, name))
    return found.hexdigest()


def blocks_of(columns: Columns) -> dict[str, list[str]]:
    """Return for each signal the check sum of each stretch of its samples."""
    size = columns["t"].size
    return {
        name: [_check(stored[4 * start : 4 * (start + _BLOCK)]) for start in range(0, size, _BLOCK)]
        for name, stored in ((name, _stored(columns, name)) for name in _present(columns))
    }


def _present(columns: Columns) -> list[str]:
    return [name for name in STORED_NAMES if name in columns]


def _check(stored: bytes) -> str:
    return f"{zlib.crc32(stored):08x}"


def _stored(columns: Columns, name: str) -> bytes:
    stored = np.ascontiguousarray(columns[name], dtype="<f4")
    return np.where(np.isnan(stored), np.float32(np.nan), stored).astype("<f4").tobytes()  # one kind of nan
