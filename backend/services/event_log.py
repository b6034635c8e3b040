"""The event log: what happened and who asked for it, refused commands included."""

import asyncio
import logging
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import islice
from typing import Protocol

from backend.event_bus import EventBus
from backend.logs import EVENT
from backend.plain_text import escape_line
from backend.schemas import EventMessage, MarkKind
from backend.storage import Database, EventKind, UnfitError, events
from backend.supervision import Part

# Journal -------------------------------------------------------------------------------------------
#
# What happened and who asked for it: marks on the time axis at once, rows in the database as they
# can be written.


EVENT_LOG_PART = Part("The journal", "Events wait in memory meanwhile.")

BOUND = 10_000
"""So many events wait in memory while the database takes none: hours of them, at most some MB."""

BATCH = 500
RETRY_S = 1.0
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Entry:
    """One event; ``lost`` is how many others it stands for, ``tick`` None where no sample is the one."""

    kind: EventKind
    text: str
    tick: int | None
    who: str
    run: int | None
    at: datetime
    lost: int = 0


@dataclass(frozen=True)
class MarkAdded:
    """A mark is on the time axis."""

    mark: EventMessage


class EventLog:
    """Takes marks from the event loop; a task writes them, so that a slow disk delays nobody.

    What cannot be written waits in memory, in order and with the time at which it happened; ``problem`` says so. Past
    ``bound`` events, the next ones are lost: how many stands in their place.
    """

    def __init__(self, database: Database, events: EventBus, bound: int = BOUND) -> None:
        self._database = database
        self._events = events
        self._bound = bound
        self._waiting: deque[_Entry] = deque()
        self._under_way = 0  # so many of the first of those are being written at this moment
        self._arrived = asyncio.Event()
        self._error = ""

    @property
    def problem(self) -> str:
        """Why nothing can be written at present, "" while all is well."""
        if not self._error:
            return ""
        lost = sum(entry.lost for entry in self._waiting)
        past = f", {lost} more were lost" if lost else ""
        kept = sum(not entry.lost for entry in self._waiting)
        return f"events cannot be stored: {self._error}; {kept} wait in memory{past}"

    def add_mark(self, kind: MarkKind, text: str, tick: int, who: str = "", run: int | None = None) -> None:
        """Put a mark at ``tick``; ``who`` is empty when nobody asked for what happened."""
        mark = EventMessage(tick=tick, kind=kind, text=f"{text} ({who})" if who else text)
        self._events.publish(MarkAdded(mark))
        self._keep(_Entry(kind=EventKind(kind), text=text, tick=tick, who=who, run=run, at=datetime.now(UTC)))

    def add_entry(self, kind: EventKind, text: str, who: str = "") -> None:
        """Keep an event that is nothing on the time axis: for the log alone."""
        self._keep(_Entry(kind=kind, text=text, tick=None, who=who, run=None, at=datetime.now(UTC)))

    async def run(self) -> None:
        """Write until cancelled; a transaction that is under way then is waited for."""
        while True:
            while self._waiting:
                if not await self._write_next():
                    await asyncio.sleep(RETRY_S)
            self._arrived.clear()
            await self._arrived.wait()

    def close(self) -> None:
        """Write what still waits; what the database does not take goes to the log."""
        while self._waiting:
            batch = list(islice(self._waiting, BATCH))
            done = self._write(batch)
            self._forget(done)
            if done < len(batch):
                break
        for entry in self._waiting:
            _log.error("The event log did not store an event: %s", entry.text)

    def _keep(self, entry: _Entry) -> None:
        by, run = f" by {entry.who}" if entry.who else "", "" if entry.run is None else f", run {entry.run}"
        _log.info("%s: %s%s%s", entry.kind, entry.text, by, run, extra=EVENT)
        if len(self._waiting) - self._under_way < self._bound:
            self._waiting.append(entry)
        else:
            counts = self._waiting[-1].lost and len(self._waiting) > self._under_way
            lost = self._waiting.pop().lost + 1 if counts else 1
            text = f"{lost} events that followed could not be kept"
            self._waiting.append(
                _Entry(kind=EventKind.NOTE, text=text, tick=entry.tick, who="", run=None, at=entry.at, lost=lost)
            )
            _log.error("The event log lost an event: %s", entry.text)
        self._arrived.set()

    async def _write_next(self) -> bool:
        """Write the oldest entries; whether the database has taken them."""
        batch = list(islice(self._waiting, BATCH))
        self._under_way = len(batch)
        writing = asyncio.ensure_future(asyncio.to_thread(self._write, batch))
        try:
            await asyncio.shield(writing)
        finally:
            done = await writing  # whoever cancels this waits for the transaction that is under way
            self._under_way = 0
            self._forget(done)
        return done == len(batch)

    def _forget(self, count: int) -> None:
        for _ in range(count):
            self._waiting.popleft()

    def _write(self, batch: Sequence[_Entry]) -> int:
        """Write all of ``batch`` in one transaction; return how many of its first entries are dealt with."""
        try:
            self._store(batch)
        except (UnfitError, ValueError) as error:
            return self._write_singly(batch, error)
        except Exception as error:
            if not self._error:
                _log.error("The event log cannot store events: %s", error)
            self._error = str(error)
            return 0
        self._error = ""
        return len(batch)

    def _write_singly(self, batch: Sequence[_Entry], error: Exception) -> int:
        """Write what can be written; what never can is logged and left out, so that it does not hold up the rest."""
        if len(batch) == 1:
            _log.error("The event log did not store an event: %s: %r", error, batch[0].text)
            return 1
        for position, entry in enumerate(batch):
            if not self._write([entry]):
                return position
        return len(batch)

    def _store(self, batch: Sequence[_Entry]) -> None:
        with self._database.session() as session:
            for entry in batch:
                who, run, tick, at = entry.who, entry.run, entry.tick, entry.at
                events.add(session, entry.kind, entry.text, who=who, run_id=run, tick=tick, at=at)


# RejectionLog ------------------------------------------------------------------------------------------
#
# Refused commands in the log: who asked for what, and why it was refused; a flood of them is
# counted.


MOST = 10
"""Different refusals that get an entry of their own in a window; what repeats one of them is counted beside it."""

WINDOW_S, LONGEST_WINDOW_S = 10.0, 600.0
"""A window [s] doubles as long as one follows the other with something that was only counted: at most some
thousand entries come of a day of refused commands."""

TEXT_MAX = 500
"""Longest entry [characters]: the reason may repeat what was asked for."""


class Clock(Protocol):
    """What calls later: an event loop."""

    def __call__(self, delay: float, callback: Callable[[], None], /) -> object:
        """Call ``callback`` after ``delay`` [s]."""
        ...


class RejectionLog:
    """Writes refusals into the journal; ``call_later`` ends a window."""

    def __init__(self, event_log: EventLog, call_later: Clock) -> None:
        self._event_log, self._call_later = event_log, call_later
        self._window_s = WINDOW_S
        self._told: set[tuple[str, str]] = set()
        self._again: Counter[tuple[str, str]] = Counter()
        self._others = 0

    def add(self, what: str, reason: str, who: str) -> None:
        """Keep that ``what`` was refused to ``who``; the reason has angles in SI, as all texts of the log."""
        text = escape_line(f"{what} refused: {reason}")
        entry = (text if len(text) <= TEXT_MAX else f"{text[: TEXT_MAX - 1]}…", who)
        if entry in self._told:
            self._again[entry] += 1
        elif len(self._told) == MOST:
            self._others += 1
        else:
            if not self._told:
                self._call_later(self._window_s, self.close)
            self._told.add(entry)
            self._record(*entry)

    def close(self) -> None:
        """End the window: tell how often each of its refusals came again, and how many others came."""
        for (text, who), count in self._again.items():
            self._record(f"{text} ({_times(count)} more in {self._window_s:g} s)", who)
        if self._others:
            commands = "command was" if self._others == 1 else "commands were"
            self._record(f"{self._others} further {commands} refused in {self._window_s:g} s", "")
        flooded = bool(self._again or self._others)
        self._window_s = min(2.0 * self._window_s, LONGEST_WINDOW_S) if flooded else WINDOW_S
        self._told.clear()
        self._again.clear()
        self._others = 0

    def _record(self, text: str, who: str) -> None:
        self._event_log.add_entry(EventKind.REFUSAL, text, who)


def _times(count: int) -> str:
    return "once" if count == 1 else f"{count} times"
