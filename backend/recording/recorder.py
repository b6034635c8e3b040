"""Move every sample of a run from the ring to the database; nothing is kept here that a crash could lose.

A position in the ring advances only after its samples were committed. When the database cannot take them, the loop goes
on, the ring keeps the last minute, and what is overwritten meanwhile is counted as missed.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from backend.faults import FAULTS, Fault
from backend.loop.access import LoopDied
from backend.loop.commands import Event, ProgramEnded
from backend.loop.ring import Ring
from backend.recording.codec import pack, summarise
from backend.sample import INDEX, STORED_COLUMNS, STORED_NAMES
from backend.storage import Database, GoneError, Session, StorageError, events, recordings, runs
from backend.storage.recordings import Chunk, NotRecordableError
from backend.storage.records import UnknownRecordError
from backend.storage.runs import EndState
from backend.supervision import Part
from plant.interface import T_s

CHUNK_TICKS = 1000
DRAIN_PERIOD_S = 0.25

PART = Part("The recorder", "The ring keeps the last minute of samples: runs are whole if it is back within that time.")

_TICK, _RUN, _FAULT = INDEX["tick"], INDEX["run"], INDEX["fault"]
_LOG = logging.getLogger(__name__)

Rows = NDArray[np.float64]
_Note = LoopDied | ProgramEnded | Ring


class RecordingError(Exception):
    """The last samples of a run could not be stored."""


class Recorder:
    """Records the runs that a ring's samples name, either in a thread of its own or whenever ``drain`` is called.

    ``problem`` says why nothing can be stored at present; it is empty while all is well. ``ended_by`` is what a run is
    said to have ended by when the service ends.
    """

    def __init__(self, database: Database, ring: Ring) -> None:
        self.problem = ""
        self.ended_by = "service ended"
        self._database = database
        self._ring = ring
        self._position = ring.count
        self._run = 0
        self._next_tick = 0
        # What is being written. It may be written already when it is found here again: of a thread that died between
        # the commit and the step after it.
        self._beginning = self._storing = -1
        self._refused_run = 0
        self._ended: set[int] = set()
        self._cut_short: set[int] = set()
        self._notes: deque[_Note] = deque()
        self._closing = threading.Event()
        self._one_at_a_time = threading.Lock()

    @property
    def run(self) -> int:
        """Run being recorded, 0 for none."""
        return self._run

    def hear(self, event: Event | LoopDied) -> None:
        """Take note of what the samples cannot tell; a listener for ``LoopAccess.listen``."""
        if isinstance(event, LoopDied | ProgramEnded):
            self._notes.append(event)

    def follow(self, ring: Ring) -> None:
        """Record from another ring, that of a new loop process, once the present one has been emptied."""
        self._notes.append(ring)

    def keep_recording(self) -> None:
        """Record until told to end; the work of a thread, which may be started anew should it die."""
        while not self._closing.wait(DRAIN_PERIOD_S):
            self.drain()

    def end(self) -> None:
        """Let ``keep_recording`` return."""
        self._closing.set()

    def close(self) -> None:
        """Store what is left; a run that is still open ends as stopped. Raises RecordingError when that fails."""
        self._closing.set()
        self.drain()
        self._attempt(lambda: self._finish(EndState.STOPPED, "the recorder was closed while the run went on"))
        if self.problem:
            raise RecordingError(self.problem)

    def drain(self) -> None:
        """Store all whole seconds and all ended runs. Never raises for the database's sake: see ``problem``."""
        self._attempt(self._drain)

    def _attempt(self, step: Callable[[], None]) -> None:
        try:
            with self._one_at_a_time:
                step()
        except GoneError as error:
            self._report(f"samples cannot be stored: {error}")
        except StorageError as error:
            self._report(f"samples cannot be stored: {error}; free space on the disk or make the database writable")
        except Exception as error:
            _LOG.exception("recording failed")
            self._report(f"samples cannot be stored: {error}")
        else:
            self.problem = ""

    def _report(self, problem: str) -> None:
        if problem != self.problem:
            _LOG.error(problem)
        self.problem = problem

    def _drain(self) -> None:
        while self._notes:
            self._heed(self._notes[0])
            self._notes.popleft()
        while self._store_next(partial=False):
            pass
        for run in self._ended & self._cut_short:  # more than one where the database could not be written for a while
            with self._database.session() as session:
                # Corrects what samples alone show as complete; a fault in them says more.
                if runs.get(session, run).end_state == EndState.COMPLETED:
                    runs.end(session, run, EndState.STOPPED, "the program was ended before its end")
            self._cut_short.remove(run)

    def _heed(self, note: _Note) -> None:
        match note:
            case ProgramEnded(run=run, completed=completed):
                if not completed:
                    self._cut_short.add(run)
            case LoopDied(reason):
                self._finish(EndState.LINK_LOST, f"the loop process died: {reason}")
            case Ring():
                self._finish(EndState.LINK_LOST, "the loop process was replaced")
                self._ring, self._position = note, 0

    def _finish(self, end_state: EndState, detail: str) -> None:
        while self._store_next(partial=True):
            pass
        if self._run:
            self._end_run(end_state, detail, self._next_tick)

    def _store_next(self, *, partial: bool) -> bool:
        """Store the next chunk, a short one only where a run or the ring (``partial``) ends; False if there is none."""
        self._position, rows, missed = self._ring.read(self._position, CHUNK_TICKS)
        if not len(rows):
            return False
        run, tick = int(rows[0, _RUN]), int(rows[0, _TICK])
        if self._run and run != self._run:
            self._end_run(*self._end_of(rows[0]), tick)
        if run not in (0, self._run, self._refused_run):
            self._begin_run(run, tick, missed)
        length = _stretch(rows)
        if run == self._run != 0:
            if length == len(rows) < CHUNK_TICKS and not partial:
                return False
            self._store(rows[:length])
        self._position += length
        return True

    def _begin_run(self, run: int, tick: int, missed: int) -> None:
        again, self._beginning = self._beginning == run, run
        try:
            with self._database.session() as session:
                if not (again and recordings.is_begun(session, run)):
                    recordings.begin(session, run, list(STORED_NAMES), T_s)
                    if missed:
                        recordings.add_gap(session, run, missed, f"up to {missed} samples before the first were lost")
        except (UnknownRecordError, NotRecordableError) as error:
            with self._database.session() as session:
                events.add(session, "recording", f"samples of run {run} are not recorded: {error}", tick=tick)
            self._refused_run = run
        else:
            self._run, self._next_tick = run, tick

    def _store(self, rows: Rows) -> None:
        table = rows[:, STORED_COLUMNS].astype(np.float32)
        tick = int(rows[0, _TICK])
        again, self._storing = self._storing == tick, tick
        with self._database.session() as session:
            if not (again and recordings.has_chunk(session, self._run, tick)):
                self._note_gap(session, tick)
                chunk = Chunk(tick, len(rows), pack(summarise(table)), pack(table))
                recordings.add_chunk(session, self._run, chunk)
        self._next_tick = tick + len(rows)

    def _end_run(self, end_state: EndState, detail: str, tick: int) -> None:
        with self._database.session() as session:
            self._note_gap(session, tick)
            runs.end(session, self._run, end_state, detail)
        self._ended.add(self._run)
        self._run = 0

    def _end_of(self, following: NDArray[np.float64]) -> tuple[EndState, str]:
        """Tell from the first sample after a run why it ended."""
        fault = FAULTS[int(following[_FAULT])]
        if fault is Fault.NONE:
            return EndState.COMPLETED, ""
        if fault is Fault.SERVICE_ENDED:
            return runs.end_state_of(fault), self.ended_by
        return runs.end_state_of(fault), fault.value

    def _note_gap(self, session: Session, tick: int) -> None:
        missed = tick - self._next_tick
        if missed:
            text = f"{missed} samples from tick {self._next_tick} on were overwritten before they could be stored"
            recordings.add_gap(session, self._run, missed, text)


def _stretch(rows: Rows) -> int:
    """Count the leading rows of one run without a gap."""
    breaks = np.flatnonzero((np.diff(rows[:, _RUN]) != 0) | (np.diff(rows[:, _TICK]) != 1))
    return int(breaks[0]) + 1 if len(breaks) else len(rows)
