"""Runs with samples that a test chooses."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from backend.recording.codec import pack_table, summarize_buckets
from backend.storage import recordings
from backend.storage.database import Database
from backend.storage.recordings import Chunk
from plant.interface import T_s
from tests.recording.stand_in import new_run

CHUNK = 700
"""Samples of a chunk: no multiple of a summary's bucket, so that buckets stand at no round places."""


def recorded_run(
    database: Database,
    signals: Mapping[str, Sequence[float] | NDArray[np.float64]],
    lost: range = range(0),
    first: int = 40,
) -> int:
    """Store a run with these signals from tick ``first`` on, but for the samples ``lost``; return its number."""
    run = new_run(database).id
    table = np.column_stack([np.asarray(values, np.float32) for values in signals.values()])
    chunks = []
    for begin in range(0, len(table), CHUNK):
        kept = [k for k in range(begin, min(begin + CHUNK, len(table))) if k not in lost]
        for part in np.split(kept, np.flatnonzero(np.diff(kept) > 1) + 1) if kept else []:
            rows = table[part]
            chunks.append(Chunk(first + int(part[0]), len(part), pack_table(summarize_buckets(rows)), pack_table(rows)))
    with database.session() as session:
        recordings.begin_imported(session, run, list(signals), T_s, len(lost), "lost on purpose" if lost else "")
        recordings.add_chunks(session, run, chunks)
    return run
