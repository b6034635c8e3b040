"""Packing of samples into chunks, and the digest of a recording."""

import hashlib
import json
import zlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from backend.recording import messages
from backend.storage import Session, recordings
from plant import SinewError

# Codec ---------------------------------------------------------------------------------------------
# Packed samples: float32 columns with bytes of equal significance grouped, zlib at its fastest level; and their min/max
# summary.
#
# Neighbouring samples share sign, exponent and leading mantissa bytes; grouped, these compress to a third.


Table = NDArray[np.float32]

BUCKET_TICKS = 50
"""Samples per bucket of a summary: 20 buckets per second."""

_LEVEL = 1
_LITTLE_ENDIAN = np.dtype("<f4")
_WIDTH = _LITTLE_ENDIAN.itemsize


class CodecError(SinewError, ValueError):
    """Bytes that are not a table with the expected number of columns."""


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
    """Return ``chosen`` columns of packed tables with equal numbers of rows.

    Shape [tables, rows, chosen]. Tables are unpacked together because a long recording has thousands of summaries.
    Raises CodecError.
    """
    inflated = [_inflate(one, columns) for one in packed]
    if len({len(one) for one in inflated}) != 1:
        raise CodecError(messages.tables_differ_in_length())
    shuffled = np.frombuffer(b"".join(inflated), np.uint8).reshape(len(packed), _WIDTH, columns, -1)
    picked = np.moveaxis(shuffled[:, :, list(chosen)], 1, -1)
    values = np.ascontiguousarray(picked).view(_LITTLE_ENDIAN)[..., 0]
    return values.swapaxes(1, 2)


def _inflate(packed: bytes, columns: int) -> bytes:
    try:
        raw = zlib.decompress(packed)
    except zlib.error as error:
        raise CodecError(messages.samples_not_unpacked(reason=str(error))) from error
    if len(raw) % (columns * _WIDTH):
        raise CodecError(messages.samples_are_no_table(size_bytes=len(raw), columns=columns))
    return raw


def summarize_buckets(table: Table) -> Table:
    """Return minima and maxima per ``BUCKET_TICKS`` rows: [2 * buckets, columns].

    Minima come first. The last bucket may have fewer rows. A bucket without any number gives NaN.
    """
    starts = np.arange(0, len(table), BUCKET_TICKS)
    return np.concatenate((np.fmin.reduceat(table, starts), np.fmax.reduceat(table, starts)))


# Digest --------------------------------------------------------------------------------------------
# Digest of a recording: the same for the same samples, however they are packed and wherever they are stored.


class SamplesDigest:
    """Computes the sha256 of samples that are added part by part, in order.

    The digest covers columns and period as a line of JSON, then, for each range without a gap, its first tick relative
    to the first of all as 8 bytes, and its samples row by row as float32 with one kind of NaN; little endian.
    """

    def __init__(self, fields: Sequence[str], period_s: float) -> None:
        head = json.dumps({"fields": list(fields), "period_s": period_s}, separators=(",", ":"))
        self._sha256 = hashlib.sha256(head.encode() + b"\n")
        self._expected: int | None = None

    def add(self, tick: int, table: Table) -> None:
        """Add consecutive samples [rows, columns], starting at ``tick`` from the first."""
        if tick != self._expected:
            self._sha256.update(tick.to_bytes(8, "little"))
        stored = np.array(table, np.dtype("<f4"), order="C")
        stored[np.isnan(stored)] = np.nan
        self._sha256.update(stored.tobytes())
        self._expected = tick + len(table)

    def hex(self) -> str:
        """Return the digest of all samples added."""
        return self._sha256.hexdigest()


def compute_recording_digest(session: Session, run_id: int) -> str:
    """Return the ``SamplesDigest`` of a recording, in hex.

    Raises UnknownRecordError, CodecError.
    """
    recording, span = recordings.get(session, run_id), recordings.span(session, run_id)
    digest = SamplesDigest(recording.fields, recording.period_s)
    for chunk in recordings.chunks(session, run_id, span.first_tick, span.end_tick):
        digest.add(chunk.first_tick - span.first_tick, unpack(chunk.samples, len(recording.fields)))
    return digest.hex()
