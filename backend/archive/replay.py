"""The moment of a recording that the replay's 3D view shows. One view for all: whoever moved it last is seen."""

import asyncio
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from backend.models.run import standing
from backend.recording.flight import flight_columns
from backend.recording.reader import read_samples
from backend.sample import INDEX, NAMES
from backend.storage import runs
from backend.storage.database import Database
from plant.dynamics import Obstacle
from plant.interface import T_s

_NEEDED = ("q", "q_ref", "S", "theta_A", "theta_B", "F_A", "F_B", "F_push", "F_ext_hat", "F_wall")


class Replay:
    """Holds one row of a recording in the shape of a newest sample, and the wall that stood then."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._shown: tuple[NDArray[np.float64] | None, Obstacle | None] = None, None

    def row(self) -> NDArray[np.float64] | None:
        """Return the moment shown, one value per field of a sample; None before the first."""
        return self._shown[0]

    def wall(self) -> Obstacle | None:
        """Return the wall that stood in the joint's way at the moment shown; None for none, and for none known."""
        return self._shown[1]

    async def show(self, run_id: int, t: float) -> None:
        """Show the sample at ``t`` [s] of a run. Raises UnknownRecordError; stays where it is past the run's end."""
        shown = await asyncio.to_thread(self._read, run_id, t)
        if shown is not None:
            self._shown = shown

    async def show_flight(self, event_id: int, t: float) -> None:
        """Show the sample of a flight record nearest to ``t`` [s] from its trip. Raises UnknownRecordError."""
        columns = await asyncio.to_thread(flight_columns, self._database, event_id)
        if columns["t"].size:
            nearest = int(np.argmin(np.abs(columns["t"] - t)))
            self._shown = _row({name: columns[name][nearest] for name in _NEEDED if name in columns}), None

    def _read(self, run_id: int, t: float) -> tuple[NDArray[np.float64], Obstacle | None] | None:
        with self._database.reading() as session:
            samples = read_samples(session, run_id, _NEEDED, t, t + T_s)
            walls = runs.get(session, run_id).set_to.walls or ()
        if not len(samples.t):
            return None
        row = _row({name: column[0] for name, column in samples.columns.items()})
        return row, standing(walls, float(samples.t[0]) + 0.5 * T_s)


def _row(values: Mapping[str, float]) -> NDArray[np.float64]:
    row = np.full(len(NAMES), np.nan)
    for name, value in values.items():
        row[INDEX[name]] = value
    return row
