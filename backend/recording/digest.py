"""A recording as one number: the same for the same samples, however they are packed and wherever they are kept."""

import hashlib
import json
from collections.abc import Sequence

import numpy as np

from backend.recording.codec import Table, unpack
from backend.storage import Session, recordings


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


def digest_of_recording(session: Session, run_id: int) -> str:
    """Return the ``SamplesDigest`` of a recording, in hex. Raises UnknownRecordError, CodecError."""
    recording, span = recordings.get(session, run_id), recordings.span(session, run_id)
    digest = SamplesDigest(recording.fields, recording.period_s)
    for chunk in recordings.chunks(session, run_id, span.first_tick, span.end_tick):
        digest.add(chunk.first_tick - span.first_tick, unpack(chunk.samples, len(recording.fields)))
    return digest.hex()
