"""Binary formats that the service sends to the page, little endian.

Frame of the websocket /api/live: uint64 first tick, uint32 count, uint32 missed; then for each stored field, in the
order of ``backend.sample.STORED``, ``count`` values float32. ``missed`` is the number of samples just before this
frame that this client did not get. The header has 16 bytes, so that a Float32Array can map the columns without a copy.

Curves of a recording: float64 width of a bucket [s], uint64 index of the first bucket (bucket k begins k widths after
the run's first sample), uint32 buckets, uint32 values per bucket (1: the sample itself, 2: smallest and largest); then
for each signal, in the requested order, its smallest and, with 2 values, its largest values, float32; NaN where
samples are missing. The header has 24 bytes for the same reason.
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


def pack_frame(first_tick: int, rows: NDArray[np.float64], missed: int = 0) -> bytes:
    """Encode ``rows``, shape (count, len(FIELDS)), as a frame.

    ``rows`` has one row per tick from ``first_tick`` on.
    """
    columns = rows[:, STORED_COLUMNS].T.astype("<f4", order="C")
    return _HEADER.pack(first_tick, len(rows), min(missed, 0xFFFFFFFF)) + columns.tobytes()


def replace_missed_count(frame: bytes, missed: int) -> bytes:
    """Return ``frame`` with another number of missed samples.

    Clients share the columns and differ only in this number.
    """
    first_tick, count, _ = _HEADER.unpack_from(frame)
    return _HEADER.pack(first_tick, count, min(missed, 0xFFFFFFFF)) + frame[HEADER_BYTES:]


def read_sample_count(frame: bytes) -> int:
    """Return the number of samples in a frame."""
    return int(_HEADER.unpack_from(frame)[1])


def unpack_frame(frame: bytes) -> Frame:
    """Decode a frame of ``pack_frame``. Raises ValueError for a wrong length."""
    first_tick, count, missed = _HEADER.unpack_from(frame)
    if len(frame) != HEADER_BYTES + 4 * count * len(STORED):
        raise ValueError(f"a frame of {count} samples cannot be {len(frame)} bytes long")
    columns = np.frombuffer(frame, dtype="<f4", offset=HEADER_BYTES).reshape(len(STORED), count)
    return Frame(first_tick, missed, columns)


def pack_curves(first_bucket: int, width_s: float, signals: Sequence[Sequence[NDArray[np.float32]]]) -> bytes:
    """Encode the curves of ``signals``.

    ``signals`` has for each signal one array (samples) or two (smallest, largest), all of the same length.
    """
    columns = [np.asarray(column, "<f4") for signal in signals for column in signal]
    header = _CURVES_HEADER.pack(width_s, first_bucket, columns[0].size, len(signals[0]))
    return header + b"".join(column.tobytes() for column in columns)
