"""The moment of a recording that the replay's 3D view shows. One view for all: whoever moved it last is seen."""

import asyncio

import numpy as np
from numpy.typing import NDArray

from backend.recording.reader import read_samples
from backend.sample import INDEX, NAMES
from backend.storage import Database
from plant.interface import T_s

_NEEDED = ("q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B", "F_push")


class Replay:
    """Holds one row of a recording in the shape of a newest sample."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._row: NDArray[np.float64] | None = None

    def row(self) -> NDArray[np.float64] | None:
        """Return the moment shown, one value per field of a sample; None before the first."""
        return self._row

    async def show(self, run_id: int, t: float) -> None:
        """Show the sample at ``t`` [s] of a run. Raises UnknownRecordError; stays where it is past the run's end."""
        row = await asyncio.to_thread(self._read, run_id, t)
        if row is not None:
            self._row = row

    def _read(self, run_id: int, t: float) -> NDArray[np.float64] | None:
        with self._database.reading() as session:
            samples = read_samples(session, run_id, _NEEDED, t, t + T_s)
        if not len(samples.t):
            return None
        row = np.full(len(NAMES), np.nan)
        for name, column in samples.columns.items():
            row[INDEX[name]] = column[0]
        return row
