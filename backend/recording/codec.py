"""Pack samples: float32 columns, bytes of equal weight side by side, zlib at its fastest; and their min/max summary.

Neighbouring samples share sign, exponent and leading mantissa bytes; side by side these compress to a third.
"""

import zlib

import numpy as np
from numpy.typing import NDArray

Table = NDArray[np.float32]

BUCKET_TICKS = 50
"""Samples that a summary draws together: 20 buckets a second."""

_LEVEL = 1
_LITTLE_ENDIAN = np.dtype("<f4")
_WIDTH = _LITTLE_ENDIAN.itemsize


class CodecError(ValueError):
    """The bytes are no table of so many columns."""


def pack(table: Table) -> bytes:
    """Pack a table [rows, columns], losslessly."""
    columns = np.ascontiguousarray(table.T, dtype=_LITTLE_ENDIAN)
    shuffled = columns.view(np.uint8).reshape(-1, _WIDTH).T
    return zlib.compress(shuffled.tobytes(), _LEVEL)


def unpack(packed: bytes, columns: int) -> Table:
    """Return the table [rows, columns] that was packed. Raises CodecError."""
    try:
        raw = np.frombuffer(zlib.decompress(packed), np.uint8)
    except zlib.error as error:
        raise CodecError(f"damaged samples: {error}") from error
    if raw.size % (columns * _WIDTH):
        raise CodecError(f"damaged samples: {raw.size} bytes are no table of {columns} columns")
    values = np.ascontiguousarray(raw.reshape(_WIDTH, -1).T).view(_LITTLE_ENDIAN)
    return values.reshape(columns, -1).T


def summarise(table: Table) -> Table:
    """Smallest and largest of each column in each ``BUCKET_TICKS`` rows: [2 * buckets, columns], minima first.

    The last bucket may hold fewer rows. A bucket without any number gives nan.
    """
    starts = np.arange(0, len(table), BUCKET_TICKS)
    return np.concatenate((np.fmin.reduceat(table, starts), np.fmax.reduceat(table, starts)))
