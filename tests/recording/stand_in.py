"""What the recorder stands between: a writer of samples in place of the loop, and stored runs."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from backend.faults import FAULTS
from backend.realtime.commands import RunEnded
from backend.realtime.modes import Cause
from backend.realtime.ring_buffer import WIDTH, Ring
from backend.recording.recorder import Recorder
from backend.sample import INDEX
from backend.storage import runs
from backend.storage.database import Database
from backend.storage.runs import NewRun, Run, RunKind
from plant import Message

Rows = NDArray[np.float64]


class Writer:
    """Stands in for the loop: appends samples whose values follow from their tick, then tells which run has ended."""

    def __init__(self, ring: Ring) -> None:
        self.ring = ring
        self.listeners: list[Callable[[RunEnded], None]] = []
        self._run = 0

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
        if self._run not in (0, run):
            why = FAULTS[fault] if fault else Cause.ASKED_FOR
            for tell in self.listeners:
                tell(RunEnded(int(ticks[0]), self._run, completed=not fault, why=why))
        self._run = run
        return rows


def recorder_of(writer: Writer, database: Database) -> Recorder:
    """Return a recorder of what is written from now on."""
    recorder = Recorder(database, writer.ring)
    writer.listeners.append(recorder.on_event)
    return recorder


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


def read_problem(problem: str) -> tuple[str, Message]:
    """Return the code of a problem, and its reason."""
    assert isinstance(problem, Message)
    reason = problem.values["reason"]
    assert isinstance(reason, Message)
    return problem.code, reason
