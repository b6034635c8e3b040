"""All signals of a run as arrays to compute with."""

import numpy as np
from numpy.typing import NDArray

from backend.recording.reader import read_envelope, read_samples
from backend.sample import STORED_NAMES
from backend.storage import recordings
from backend.storage.database import Database
from backend.storage.records import UnknownRecordError
from plant.interface import T_s

Columns = dict[str, NDArray[np.float64]]
"""Samples by column name in double precision, shape (N,) each, and ``t`` [s] from the run's first sample."""


def recorded_columns(database: Database, run_id: int) -> tuple[Columns, int]:
    """Return the samples of a run and how many are missing; empty columns for a run of which nothing was recorded."""
    try:
        with database.reading() as session:
            samples = read_samples(session, run_id)
            missed = recordings.get(session, run_id).missed
    except UnknownRecordError:
        return _empty(), 0
    return {"t": samples.t} | {name: column.astype(np.float64) for name, column in samples.columns.items()}, missed


def drawn_columns(database: Database, run_id: int, points: int = 2000) -> Columns:
    """Return what a drawing of a whole run needs, however long: each bucket's smallest and largest value in turn.

    Shape (M,) with M at most about 2 ``points``; empty columns for a run of which nothing was recorded.
    """
    try:
        with database.reading() as session:
            envelope = read_envelope(session, run_id, points)
    except UnknownRecordError:
        return _empty()
    columns: Columns = {"t": np.repeat(envelope.t, 2) + np.tile([0.0, 0.5 * envelope.width_s], envelope.t.size)}
    for name, low in envelope.minimum.items():
        columns[name] = np.column_stack((low, envelope.maximum[name])).ravel().astype(np.float64)
    return columns


def missing_between(columns: Columns) -> int:
    """Return how many ticks are lacking between the first sample and the last."""
    t = columns["t"]
    return round((t[-1] - t[0]) / T_s) + 1 - t.size if t.size else 0


def _empty() -> Columns:
    return {name: np.empty(0) for name in ("t", *STORED_NAMES)}
