"""A run that is written into the database as the recorder stores it, without a loop: of any length at once."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from backend.recording.codec import pack_table, summarize_buckets
from backend.recording.recorder import CHUNK_TICKS
from backend.sample import STORED_NAMES
from backend.storage import recordings, runs
from backend.storage.database import Database
from backend.storage.recordings import Chunk
from backend.storage.runs import EndState, NewRun, RunKind
from plant.interface import T_s

FIRST_TICK = 4321
"""The loop has run for a while when the run begins: nothing counts from tick 0."""

R_M, R_J = 0.0075, 0.075


def store_run(
    database: Database,
    columns: Mapping[str, NDArray[np.floating]],
    missing: slice = slice(0, 0),
    fields: tuple[str, ...] = STORED_NAMES,
) -> int:
    """Store samples, other signals at 0, without the ticks of ``missing``; return the number of the run."""
    count = len(next(iter(columns.values())))
    table = np.zeros((count, len(fields)), np.float32)
    for name, column in columns.items():
        table[:, fields.index(name)] = column
    geometry = {"r_m": {"value": R_M}, "r_j": {"value": R_J}}
    with database.session() as session:
        new = NewRun(RunKind.SESSION, "simulator", "ideal", {"geometry": geometry}, "Ana", "0.1.0")
        run = runs.create(session, new).id
        recordings.begin(session, run, list(fields), T_s)
        parts = [slice(0, missing.start), slice(missing.stop, count)]
        for part in parts:
            for begin in range(part.start, part.stop, CHUNK_TICKS):
                rows = table[begin : min(begin + CHUNK_TICKS, part.stop)]
                packed = Chunk(FIRST_TICK + begin, len(rows), pack_table(summarize_buckets(rows)), pack_table(rows))
                recordings.add_chunks(session, run, [packed])
        if missing.stop > missing.start:
            recordings.add_gap(session, run, missing.stop - missing.start, "the disk was full")
        runs.end(session, run, EndState.COMPLETED, "")
    return run
