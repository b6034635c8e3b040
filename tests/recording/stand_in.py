"""What the recorder stands between: a writer of samples in place of the loop, and stored runs."""

import numpy as np
from numpy.typing import NDArray

from backend.loop.ring import WIDTH, Ring
from backend.sample import INDEX
from backend.storage import Database, runs
from backend.storage.runs import NewRun, Run, RunKind

Rows = NDArray[np.float64]


class Writer:
    """Stands in for the loop: appends samples whose values follow from their tick."""

    def __init__(self, ring: Ring) -> None:
        self.ring = ring

    def write(self, count: int, run: int = 0, fault: int = 0) -> Rows:
        """Append samples and return them [count, WIDTH]."""
        ticks = self.ring.count + np.arange(count)
        rows: NDArray[np.float64] = np.sin(ticks[:, None] * 1e-3 + np.arange(WIDTH))
        rows[:, INDEX["tick"]] = ticks
        rows[:, INDEX["t"]] = ticks * 1e-3
        rows[:, INDEX["run"]] = run
        rows[:, INDEX["fault"]] = fault
        rows[:, INDEX["S_true"]] = np.nan
        for row in rows:
            self.ring.append(row)
        return rows


def new_run(database: Database) -> Run:
    with database.session() as session:
        return runs.create(
            session,
            NewRun(
                kind=RunKind.SESSION,
                plant="simulator",
                parameters_name="ideal",
                parameters={},
                who="Ana",
                software="0.1.0",
            ),
        )


def stored_run(database: Database, run_id: int) -> Run:
    with database.reading() as session:
        return runs.get(session, run_id)
