"""Packs samples into chunks, and computes the digest of a recording."""

import hashlib
import json
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from backend.storage import Session, recordings
from plant import SinewError

# Codec ---------------------------------------------------------------------------------------------
#
# Pack samples: float32 columns, bytes of equal weight side by side, zlib at its fastest; and their
# min/max summary.
#
# Neighbouring samples share sign, exponent and leading mantissa bytes; side by side these compress
# to a third.


Table = NDArray[np.float32]

BUCKET_TICKS = 50
"""Samples that a summary draws together: 20 buckets a second."""

_LEVEL = 1
_LITTLE_ENDIAN = np.dtype("<f4")
_WIDTH = _LITTLE_ENDIAN.itemsize


class CodecError(SinewError, ValueError):
    """The bytes are no table of so many columns."""


def pack_table(table: Table) -> bytes:
    """Pack a table [rows, columns], losslessly."""
    columns = np.ascontiguousarray(table.T, dtype=_LITTLE_ENDIAN)
    shuffled = columns.view(np.uint8).reshape(-1, _WIDTH).T
    return zlib.compress(shuffled.tobytes(), _LEVEL)


def unpack(packed: bytes, columns: int) -> Table:
    """Return the table [rows, columns] that was packed. Raises CodecError."""
    table: Table = unpack_alike([packed], columns, range(columns))[0]
    return table


def unpack_alike(packed: Sequence[bytes], columns: int, chosen: Sequence[int]) -> Table:
    """Return ``chosen`` columns of packed tables that have as many rows as each other: [tables, rows, chosen].

    At once, as a long recording has thousands of summaries. Raises CodecError.
    """
    inflated = [_inflate(one, columns) for one in packed]
    if len({len(one) for one in inflated}) != 1:
        raise CodecError("damaged samples: tables that should be of the same length are not")
    shuffled = np.frombuffer(b"".join(inflated), np.uint8).reshape(len(packed), _WIDTH, columns, -1)
    picked = np.moveaxis(shuffled[:, :, list(chosen)], 1, -1)
    values = np.ascontiguousarray(picked).view(_LITTLE_ENDIAN)[..., 0]
    return values.swapaxes(1, 2)


def _inflate(packed: bytes, columns: int) -> bytes:
    try:
        raw = zlib.decompress(packed)
    except zlib.error as error:
        raise CodecError(f"damaged samples: {error}") from error
    if len(raw) % (columns * _WIDTH):
        raise CodecError(f"damaged samples: {len(raw)} bytes are no table of {columns} columns")
    return raw


def summarise_buckets(table: Table) -> Table:
    """Smallest and largest of each column in each ``BUCKET_TICKS`` rows: [2 * buckets, columns], minima first.

    The last bucket may hold fewer rows. A bucket without any number gives nan.
    """
    starts = np.arange(0, len(table), BUCKET_TICKS)
    return np.concatenate((np.fmin.reduceat(table, starts), np.fmax.reduceat(table, starts)))


# Digest --------------------------------------------------------------------------------------------
#
# A recording as one number: the same for the same samples, however they are packed and wherever
# they are kept.


class SamplesDigest:
    """Computes the sha256 of samples that come piece by piece, in order.

    Of their columns and period as a line of JSON, then of each stretch without a gap its first tick, counted from the
    first of all, as 8 bytes, and its samples row by row as float32 with one kind of nan; little endian.
    """

    def __init__(self, fields: Sequence[str], period_s: float) -> None:
        head = json.dumps({"fields": list(fields), "period_s": period_s}, separators=(",", ":"))
        self._sha256 = hashlib.sha256(head.encode() + b"\n")
        self._expected: int | None = None

    def add(self, tick: int, table: Table) -> None:
        """Go on with consecutive samples [rows, columns], the first of them at ``tick`` from the first of all."""
        if tick != self._expected:
            self._sha256.update(tick.to_bytes(8, "little"))
        stored = np.array(table, np.dtype("<f4"), order="C")
        stored[np.isnan(stored)] = np.nan
        self._sha256.update(stored.tobytes())
        self._expected = tick + len(table)

    def hex(self) -> str:
        """Return the digest of all that came."""
        return self._sha256.hexdigest()


def compute_recording_digest(session: Session, run_id: int) -> str:
    """Return the ``SamplesDigest`` of a recording, in hex. Raises UnknownRecordError, CodecError."""
    recording, span = recordings.get(session, run_id), recordings.span(session, run_id)
    digest = SamplesDigest(recording.fields, recording.period_s)
    for chunk in recordings.chunks(session, run_id, span.first_tick, span.end_tick):
        digest.add(chunk.first_tick - span.first_tick, unpack(chunk.samples, len(recording.fields)))
    return digest.hex()
