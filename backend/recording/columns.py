"""All signals of a run as arrays to compute with."""

import numpy as np
from numpy.typing import NDArray

from backend.recording.reader import read_samples
from backend.sample import STORED_NAMES
from backend.storage import Database, recordings
from backend.storage.records import UnknownRecordError

Columns = dict[str, NDArray[np.float64]]
"""Samples by column name in double precision, shape (N,) each, and ``t`` [s] from the run's first sample."""


def recorded_columns(database: Database, run_id: int) -> tuple[Columns, int]:
    """Return the samples of a run and how many are missing; empty columns for a run of which nothing was recorded."""
    try:
        with database.reading() as session:
            samples = read_samples(session, run_id)
            missed = recordings.get(session, run_id).missed
    except UnknownRecordError:
        return {name: np.empty(0) for name in ("t", *STORED_NAMES)}, 0
    return {"t": samples.t} | {name: column.astype(np.float64) for name, column in samples.columns.items()}, missed
