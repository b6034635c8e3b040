"""What goes to the page in binary, little endian; the one definition of both layouts.

A frame of the websocket /api/live: uint64 first tick, uint32 count, uint32 missed; then for each stored field, in the
order of ``backend.sample.STORED``, ``count`` float32. ``missed`` is how many samples this client was not sent just
before this frame. The header is 16 bytes long, so that a Float32Array can look at the columns without copying them.

Curves of a recording: float64 width of a bucket [s], uint64 number of the first bucket (bucket k begins k widths after
the run's first sample), uint32 buckets, uint32 values per bucket (1: the sample itself, 2: smallest and largest); then
for each signal, in the order asked for, its smallest values and, of 2, its largest, float32; nan where samples are
missing. The header is 24 bytes long for the same reason.
"""

import struct
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from backend.sample import STORED, STORED_COLUMNS

_HEADER = struct.Struct("<QII")
_CURVES_HEADER = struct.Struct("<dQII")
CURVES_HEADER_BYTES = _CURVES_HEADER.size
HEADER_BYTES = _HEADER.size


class Frame(NamedTuple):
    """A decoded frame; ``columns`` is float32 of shape (len(STORED), count)."""

    first_tick: int
    missed: int
    columns: NDArray[np.float32]


def pack(first_tick: int, rows: NDArray[np.float64], missed: int = 0) -> bytes:
    """Return the frame of ``rows``, shape (count, len(FIELDS)), one row per tick from ``first_tick`` on."""
    columns = rows[:, STORED_COLUMNS].T.astype("<f4", order="C")
    return _HEADER.pack(first_tick, len(rows), min(missed, 0xFFFFFFFF)) + columns.tobytes()


def with_missed(frame: bytes, missed: int) -> bytes:
    """Return ``frame`` with another number of missed samples; the columns are shared by all clients."""
    first_tick, count, _ = _HEADER.unpack_from(frame)
    return _HEADER.pack(first_tick, count, min(missed, 0xFFFFFFFF)) + frame[HEADER_BYTES:]


def count_of(frame: bytes) -> int:
    """Return how many samples a frame carries."""
    return int(_HEADER.unpack_from(frame)[1])


def unpack(frame: bytes) -> Frame:
    """Return what ``pack`` packed. ValueError for a frame of the wrong length."""
    first_tick, count, missed = _HEADER.unpack_from(frame)
    if len(frame) != HEADER_BYTES + 4 * count * len(STORED):
        raise ValueError(f"a frame of {count} samples cannot be {len(frame)} bytes long")
    columns = np.frombuffer(frame, dtype="<f4", offset=HEADER_BYTES).reshape(len(STORED), count)
    return Frame(first_tick, missed, columns)


def pack_curves(first_bucket: int, width_s: float, signals: Sequence[Sequence[NDArray[np.float32]]]) -> bytes:
    """Return the curves of ``signals``: of each, one array (samples) or two (smallest, largest), all of one length."""
    columns = [np.asarray(column, "<f4") for signal in signals for column in signal]
    header = _CURVES_HEADER.pack(width_s, first_bucket, columns[0].size, len(signals[0]))
    return header + b"".join(column.tobytes() for column in columns)
