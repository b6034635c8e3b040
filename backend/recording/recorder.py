"""Recording of every sample of a run from the ring buffer to the database.

Obstacles that were present are stored with the run.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from backend.faults import Fault
from backend.models import StoredWall, build_stored_wall
from backend.realtime import Event, LoopExited, Ring, RunEnded, WallChanged
from backend.recording import messages
from backend.recording.codec import Table, pack_table, summarize_buckets
from backend.sample import INDEX, STORED_COLUMNS, STORED_NAMES
from backend.storage import (
    Chunk,
    Database,
    EndState,
    EventKind,
    GoneError,
    NotRecordableError,
    Session,
    StorageError,
    UnknownRecordError,
    events,
    recordings,
    runs,
)
from backend.supervision import Part
from plant import ErrorCode, InvariantError, Obstacle, SinewError, T_s

# Obstacles -----------------------------------------------------------------------------------------
# Obstacles present in the stored samples, from events of the loop.


_MOST_WAITING = 10_000


class ObstacleChanges:
    """Pending changes of the obstacle, until their samples are stored.

    Belongs to the recorder. Events and samples arrive separately: an event may arrive before its sample is read, or
    slightly later.
    """

    def __init__(self) -> None:
        self._waiting: list[WallChanged] = []
        self._current: Obstacle | None = None
        self._first_tick = 0
        self._begins = False

    def add(self, change: WallChanged) -> None:
        """Add a change."""
        self._waiting.append(change)
        if len(self._waiting) > _MOST_WAITING:  # before a run only the last change counts
            self._current = self._waiting.pop(0).wall

    def reset(self) -> None:
        """Reset for a new loop, whose plant has no obstacle."""
        self._waiting, self._current = [], None

    def begin(self, tick: int) -> None:
        """Start a run with the sample at ``tick``."""
        self._first_tick, self._begins = tick, True

    def until(self, tick: int) -> list[StoredWall]:
        """Return the obstacles of the run for its samples up to ``tick``."""
        due = [change for change in self._waiting if change.tick <= tick]
        walls = []
        if self._begins:
            before = [change.wall for change in due if change.tick <= self._first_tick]
            current = before[-1] if before else self._current
            walls = [] if current is None else [build_stored_wall(0.0, current)]
            due = due[len(before) :]
        return walls + [build_stored_wall(max(change.tick - self._first_tick, 0) * T_s, change.wall) for change in due]

    def discard_until(self, tick: int) -> None:
        """Discard changes up to ``tick``, whose samples are stored."""
        due = [change for change in self._waiting if change.tick <= tick]
        self._current = due[-1].wall if due else self._current
        self._waiting = self._waiting[len(due) :]
        self._begins = False


# Recorder ------------------------------------------------------------------------------------------
# Recording of every sample of a run from the ring buffer to the database, without state that a crash could lose.
#
# The position in the ring buffer advances only after its samples were committed. If the database fails, the loop
# continues, the ring buffer holds the last minute, and samples overwritten meanwhile are counted as missed.
#
# Inconsistent samples end the recording of a run, with an entry in the event log and a gap: its stored part is safe,
# and the next run is recorded.
#
# The end of a run follows from an event of the loop, or from the loop's exit; samples only show where. It is written
# only here, once the last sample is stored.


CHUNK_TICKS = 1000
CHUNKS_AT_ONCE = 20
"""Largest number of chunks stored together: a transaction costs more than a chunk."""
DRAIN_PERIOD_S = 0.25

RECORDER_PART = Part(messages.recorder(), messages.runs_complete_within_a_minute())

_TICK, _RUN = INDEX["tick"], INDEX["run"]
_LOG = logging.getLogger(__name__)

Rows = NDArray[np.float64]
_Note = LoopExited | RunEnded | WallChanged | Ring


class RecordingError(SinewError):
    """The last samples of a run could not be stored."""

    category = ErrorCode.UNAVAILABLE


class Recorder:
    """Records the runs of a ring buffer's samples.

    Runs in its own thread, or whenever ``drain`` is called. ``problem`` says why storing fails at present; empty if it
    does not.
    """

    def __init__(self, database: Database, ring: Ring) -> None:
        self.problem = ""
        self._database = database
        self._ring = ring
        self._position = ring.count
        self._run = 0
        self._next_tick = 0
        # Data being written. After the death of a thread between commit and the next step it may be written already.
        self._beginning = self._storing = -1
        self._refused_run = 0
        # Runs whose recording ended early, and how many of their samples followed.
        self._skipped: dict[int, int] = {}
        # Runs with all samples stored but without an end event; end events that are not written yet.
        self._open: set[int] = set()
        self._run_ends: dict[int, RunEnded] = {}
        self._notes: deque[_Note] = deque()
        self._obstacle_changes = ObstacleChanges()
        self._closing = threading.Event()
        self._one_at_a_time = threading.Lock()

    @property
    def run(self) -> int:
        """Run being recorded, 0 for none."""
        return self._run

    def on_event(self, event: Event | LoopExited) -> None:
        """Queue events that samples do not contain; a listener for ``LoopClient.listen``."""
        if isinstance(event, LoopExited | WallChanged) or (isinstance(event, RunEnded) and event.run):
            self._notes.append(event)

    def follow(self, ring: Ring) -> None:
        """Record from the ring buffer of a new loop process after the current one.

        The current one is drained first.
        """
        self._notes.append(ring)

    def run_recording(self) -> None:
        """Record until stopped; runs in a thread that may be restarted after an error."""
        while not self._closing.wait(DRAIN_PERIOD_S):
            self.drain()

    def end(self) -> None:
        """End ``run_recording``."""
        self._closing.set()

    def close(self) -> None:
        """Store all remaining samples; a run that is still open ends as stopped.

        Raises RecordingError if that fails.
        """
        self._closing.set()
        self.drain()
        self._attempt(lambda: self._finish(EndState.STOPPED, messages.recorder_closed()))
        if self.problem:
            raise RecordingError(self.problem)

    def drain(self) -> None:
        """Store all whole seconds and all ended runs.

        Database errors are not raised but set ``problem``.
        """
        self._attempt(self._drain)

    def drain_if_due(self) -> None:
        """Drain if enough samples for one transaction or an end event are pending.

        For loops without real time.
        """
        waiting = self._ring.count - self._position
        if self._notes or self._run_ends or waiting >= CHUNKS_AT_ONCE * CHUNK_TICKS:
            self.drain()

    def _attempt(self, step: Callable[[], None]) -> None:
        try:
            with self._one_at_a_time:
                step()
        except GoneError as error:
            self._report(messages.samples_not_stored(reason=error.message))
        except StorageError as error:
            self._report(messages.database_takes_no_samples(reason=error.message))
        except Exception as error:
            _LOG.exception("The recorder failed.")
            self._report(messages.samples_not_stored(reason=str(error)))
        else:
            self.problem = ""

    def _report(self, problem: str) -> None:
        if problem != self.problem:
            _LOG.error(problem)
        self.problem = problem

    def _drain(self) -> None:
        while self._notes:
            self._handle_note(self._notes[0])
            self._notes.popleft()
        # a run is completely in the ring buffer when its end is reported
        while self._store_next(partial=self._run in self._run_ends):
            pass
        self._write_ends()

    def _handle_note(self, note: _Note) -> None:
        match note:
            case RunEnded():
                self._run_ends[note.run] = note
            case WallChanged():
                self._obstacle_changes.add(note)
            case LoopExited(reason):
                self._finish(EndState.LINK_LOST, messages.loop_died(reason=reason))
            case Ring():
                self._finish(EndState.LINK_LOST, messages.loop_restarted())
                self._ring, self._position = note, 0
                self._obstacle_changes.reset()

    def _finish(self, end_state: EndState, detail: str) -> None:
        while self._store_next(partial=True):
            pass
        self._write_ends()
        for run in (self._open | {self._run}) - {0}:
            self._end(run, end_state, detail)

    def _write_ends(self) -> None:
        """Write the reported ends of runs whose samples are all stored."""
        for run, end in list(self._run_ends.items()):
            self._end(run, *describe_end(end))
            del self._run_ends[run]

    def _end(self, run: int, end_state: EndState, detail: str) -> None:
        # samples of an unknown run were rejected
        with suppress(UnknownRecordError), self._database.session() as session:
            if skipped := self._skipped.get(run):
                recordings.add_gap(session, run, skipped, messages.samples_omitted(count=skipped))
            runs.end(session, run, end_state, detail)
        self._open.discard(run)
        if run == self._run:
            self._run = 0
        self._skipped.pop(run, None)

    def _store_next(self, *, partial: bool) -> bool:
        """Store the next chunks; return False if there are none.

        ``partial``: also a short chunk; otherwise only at the end of a run or of the ring buffer.
        """
        try:
            self._position, rows, missed = self._ring.read(self._position, CHUNKS_AT_ONCE * CHUNK_TICKS)
        except InvariantError as error:  # the skipped samples become a gap in the ticks
            _LOG.critical("The recorder continues with the newest sample: %s", error)
            self._position = self._ring.count
            return False
        if not len(rows):
            return False
        invalid = _count_invalid(rows)
        if invalid:
            self._end_recording(messages.invalid_sample(run=rows[0, _RUN], tick=rows[0, _TICK]), invalid)
            self._position += invalid
            return True
        run, tick = int(rows[0, _RUN]), int(rows[0, _TICK])
        if run == self._run != 0 and tick < self._next_tick:
            self._end_recording(messages.tick_not_increasing(tick=tick, previous=self._next_tick - 1), 0)
        if self._run and run != self._run:
            self._leave_run(tick)
        if run not in (0, self._run, self._refused_run):
            self._begin_run(run, tick, missed)
        length = _stretch(rows)
        if run == self._run != 0:
            if length == len(rows) and not partial:
                length -= length % CHUNK_TICKS
            if not length:
                return False
            self._store(rows[:length])
        elif run in self._skipped:
            self._skipped[run] += length
        self._position += length
        return True

    def _end_recording(self, reason: str, samples: int) -> None:
        """End the recording of the run for a reason; its further samples are counted.

        ``samples`` are omitted so far.
        """
        _LOG.critical("The samples are not consistent: %s", reason)
        if not self._run:
            return
        text = messages.rest_not_recorded(reason=reason)
        with self._database.session() as session:
            recordings.add_gap(session, self._run, 0, text)
            found = messages.finding_about_run(run_id=self._run, finding=text)
            events.add(session, EventKind.RECORDING, found, tick=self._next_tick)
        self._open.add(self._run)
        self._skipped[self._run] = samples
        self._refused_run, self._run = self._run, 0

    def _begin_run(self, run: int, tick: int, missed: int) -> None:
        again, self._beginning = self._beginning == run, run
        try:
            with self._database.session() as session:
                if not (again and recordings.is_begun(session, run)):
                    recordings.begin(session, run, list(STORED_NAMES), T_s)
                    if missed:
                        recordings.add_gap(session, run, missed, messages.first_samples_lost(count=missed))
        except (UnknownRecordError, NotRecordableError) as error:
            with self._database.session() as session:
                text = messages.samples_not_recorded(run_id=run, reason=str(error))
                events.add(session, EventKind.RECORDING, text, tick=tick)
            self._refused_run = run
        else:
            self._run, self._next_tick = run, tick
            self._obstacle_changes.begin(tick)

    def _store(self, rows: Rows) -> None:
        table = rows[:, STORED_COLUMNS].astype(np.float32)
        tick = int(rows[0, _TICK])
        again, self._storing = self._storing == tick, tick
        with self._database.session() as session:
            if not (again and recordings.has_chunk(session, self._run, tick)):
                self._note_gap(session, tick)
                recordings.add_chunks(session, self._run, _split_chunks(tick, table))
                runs.save_walls(session, self._run, self._obstacle_changes.until(tick + len(rows) - 1))
        self._next_tick = tick + len(rows)
        self._obstacle_changes.discard_until(self._next_tick - 1)

    def _leave_run(self, tick: int) -> None:
        """Finish a run without further samples; ``tick`` is the next one."""
        if tick != self._next_tick:
            with self._database.session() as session:
                self._note_gap(session, tick)
        self._open.add(self._run)
        self._run = 0

    def _note_gap(self, session: Session, tick: int) -> None:
        missed = tick - self._next_tick
        if missed:
            text = messages.samples_overwritten(count=missed, tick=self._next_tick)
            recordings.add_gap(session, self._run, missed, text)


def _split_chunks(tick: int, table: Table) -> list[Chunk]:
    """Pack a table that begins at ``tick``; all chunks except the last are full."""
    parts = [table[at : at + CHUNK_TICKS] for at in range(0, len(table), CHUNK_TICKS)]
    return [
        Chunk(tick + CHUNK_TICKS * index, len(part), pack_table(summarize_buckets(part)), pack_table(part))
        for index, part in enumerate(parts)
    ]


def describe_end(end: RunEnded) -> tuple[EndState, str]:
    """Return the end state of a run and its description."""
    if end.completed:
        return EndState.COMPLETED, ""
    if not isinstance(end.why, Fault):
        return EndState.STOPPED, messages.program_stopped()
    if end.why is Fault.SERVICE_ENDED:  # the detail says who ended it
        return runs.derive_end_state(end.why), end.detail or messages.run_ended_with_service()
    if not end.detail:
        return runs.derive_end_state(end.why), end.why.value
    return runs.derive_end_state(end.why), messages.stopped_by_fault(fault=end.why, detail=end.detail)


def _stretch(rows: Rows) -> int:
    """Return the number of leading rows of one run without a gap."""
    breaks = np.flatnonzero((np.diff(rows[:, _RUN]) != 0) | (np.diff(rows[:, _TICK]) != 1))
    return int(breaks[0]) + 1 if len(breaks) else len(rows)


def _count_invalid(rows: Rows) -> int:
    """Return the number of leading rows with an invalid run or tick.

    Valid are integers from 0 on.
    """
    named = rows[:, [_RUN, _TICK]]
    valid = np.flatnonzero(((named >= 0.0) & (np.floor(named) == named) & np.isfinite(named)).all(axis=1))
    return int(valid[0]) if len(valid) else len(rows)
