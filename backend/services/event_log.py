"""The event log: commands, refusals, faults and runs with time and author."""

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
from backend.services import messages
from backend.storage import Database, EventKind, UnfitError, events
from backend.supervision import Part

# Event log -----------------------------------------------------------------------------------------
# Publishes marks on the time axis at once, and stores events in the database as fast as it accepts
# them.


EVENT_LOG_PART = Part("The event log", "Events wait in memory until it has restarted.")

BOUND = 10_000
"""Events that wait in memory while the database accepts none: several hours, a few MB."""

BATCH = 500
"""Events that one transaction stores."""

RETRY_S = 1.0
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Entry:
    """One event to be stored."""

    kind: EventKind
    text: str
    tick: int | None
    """Sample of the event; None for an event without a place on the time axis."""

    who: str
    run: int | None
    at: datetime
    lost: int = 0
    """Number of lost events that this entry represents."""


@dataclass(frozen=True)
class MarkAdded:
    """Event: a mark was added to the time axis."""

    mark: EventMessage


class EventLog:
    """Accepts events at once and stores them in a task.

    Events that cannot be stored wait in memory, in order and with their time. Above ``bound`` events the newest are
    lost, and an entry with their number is stored in their place.
    """

    def __init__(self, database: Database, events: EventBus, bound: int = BOUND) -> None:
        self._database = database
        self._events = events
        self._bound = bound
        self._waiting: deque[_Entry] = deque()
        self._in_progress = 0  # the first entries of ``_waiting``, which are being stored
        self._arrived = asyncio.Event()
        self._error = ""

    @property
    def problem(self) -> str:
        """Why no event can be stored; empty if storing works."""
        if not self._error:
            return ""
        lost = sum(entry.lost for entry in self._waiting)
        waiting = sum(not entry.lost for entry in self._waiting)
        return messages.events_not_stored(reason=self._error, waiting=waiting, lost=lost)

    def add_mark(self, kind: MarkKind, text: str, tick: int, who: str = "", run: int | None = None) -> None:
        """Add an event with a mark at ``tick``.

        ``who`` is empty for an event that no user has caused.
        """
        mark = EventMessage(tick=tick, kind=kind, text=f"{text} ({who})" if who else text)
        self._events.publish(MarkAdded(mark))
        self._add(_Entry(kind=EventKind(kind), text=text, tick=tick, who=who, run=run, at=datetime.now(UTC)))

    def add_entry(self, kind: EventKind, text: str, who: str = "") -> None:
        """Add an event without a mark on the time axis."""
        self._add(_Entry(kind=kind, text=text, tick=None, who=who, run=None, at=datetime.now(UTC)))

    async def run(self) -> None:
        """Store events until cancelled; finishes a transaction in progress."""
        while True:
            while self._waiting:
                if not await self._store_next():
                    await asyncio.sleep(RETRY_S)
            self._arrived.clear()
            await self._arrived.wait()

    def close(self) -> None:
        """Store the waiting events; those that the database does not accept go to the log."""
        while self._waiting:
            batch = list(islice(self._waiting, BATCH))
            done = self._store(batch)
            self._remove_first(done)
            if done < len(batch):
                break
        for entry in self._waiting:
            _log.error("The event log did not store an event: %s", entry.text)

    def _add(self, entry: _Entry) -> None:
        by, run = f" by {entry.who}" if entry.who else "", "" if entry.run is None else f", run {entry.run}"
        _log.info("%s: %s%s%s", entry.kind, entry.text, by, run, extra=EVENT)
        if len(self._waiting) - self._in_progress < self._bound:
            self._waiting.append(entry)
        else:
            is_last_a_count = self._waiting[-1].lost and len(self._waiting) > self._in_progress
            lost = self._waiting.pop().lost + 1 if is_last_a_count else 1
            text = messages.later_events_lost(count=lost)
            self._waiting.append(
                _Entry(kind=EventKind.NOTE, text=text, tick=entry.tick, who="", run=None, at=entry.at, lost=lost)
            )
            _log.error("The event log dropped an event: %s", entry.text)
        self._arrived.set()

    async def _store_next(self) -> bool:
        """Store the oldest entries; return whether the database has accepted all of them."""
        batch = list(islice(self._waiting, BATCH))
        self._in_progress = len(batch)
        storing = asyncio.ensure_future(asyncio.to_thread(self._store, batch))
        try:
            await asyncio.shield(storing)
        finally:
            done = await storing  # a cancellation waits for the transaction in progress
            self._in_progress = 0
            self._remove_first(done)
        return done == len(batch)

    def _remove_first(self, count: int) -> None:
        for _ in range(count):
            self._waiting.popleft()

    def _store(self, batch: Sequence[_Entry]) -> int:
        """Store a batch in one transaction.

        Return how many of its first entries need no further attempt.
        """
        try:
            self._insert(batch)
        except (UnfitError, ValueError) as error:
            return self._store_singly(batch, error)
        except Exception as error:
            if not self._error:
                _log.error("The event log cannot store events: %s", error)
            self._error = str(error)
            return 0
        self._error = ""
        return len(batch)

    def _store_singly(self, batch: Sequence[_Entry], error: Exception) -> int:
        """Store entries one by one.

        An invalid one goes to the log and is dropped, so that it blocks no other.
        """
        if len(batch) == 1:
            _log.error("The event log did not store an event: %s: %r", error, batch[0].text)
            return 1
        for position, entry in enumerate(batch):
            if not self._store([entry]):
                return position
        return len(batch)

    def _insert(self, batch: Sequence[_Entry]) -> None:
        with self._database.session() as session:
            for entry in batch:
                who, run, tick, at = entry.who, entry.run, entry.tick, entry.at
                events.add(session, entry.kind, entry.text, who=who, run_id=run, tick=tick, at=at)


# Rejection log -------------------------------------------------------------------------------------
# Logs refused commands with author and reason. In a flood of them, most are only counted.


MOST = 10
"""Different refusals of a window that get an entry; repetitions and further ones are counted."""

WINDOW_S, LONGEST_WINDOW_S = 10.0, 600.0
"""First and longest window [s]. The window doubles while refusals are counted, so that a day of refused commands
leads to a few thousand entries at most."""

TEXT_MAX = 500
"""Longest entry [characters]: the reason may contain the refused text."""


class CallLater(Protocol):
    """The method ``call_later`` of an event loop."""

    def __call__(self, delay: float, callback: Callable[[], None], /) -> object:
        """Call ``callback`` after ``delay`` [s]."""
        ...


class RejectionLog:
    """Logs refused commands; ``call_later`` ends a window."""

    def __init__(self, event_log: EventLog, call_later: CallLater) -> None:
        self._event_log, self._call_later = event_log, call_later
        self._window_s = WINDOW_S
        self._logged: set[tuple[str, str]] = set()
        self._repetitions: Counter[tuple[str, str]] = Counter()
        self._others = 0

    def add(self, what: str, reason: str, who: str) -> None:
        """Log that the command ``what`` of ``who`` was refused.

        Angles in ``reason`` are in SI units.
        """
        text = escape_line(messages.command_refused(command=what, reason=reason))
        entry = (text if len(text) <= TEXT_MAX else f"{text[: TEXT_MAX - 1]}…", who)
        if entry in self._logged:
            self._repetitions[entry] += 1
        elif len(self._logged) == MOST:
            self._others += 1
        else:
            if not self._logged:
                self._call_later(self._window_s, self.close)
            self._logged.add(entry)
            self._add_entry(*entry)

    def close(self) -> None:
        """End the window: log the numbers of repeated and of further refusals."""
        for (text, who), count in self._repetitions.items():
            self._add_entry(messages.refusal_repeated(refusal=text, count=count, window_s=self._window_s), who)
        if self._others:
            self._add_entry(messages.further_commands_refused(count=self._others, window_s=self._window_s), "")
        has_counted = bool(self._repetitions or self._others)
        self._window_s = min(2.0 * self._window_s, LONGEST_WINDOW_S) if has_counted else WINDOW_S
        self._logged.clear()
        self._repetitions.clear()
        self._others = 0

    def _add_entry(self, text: str, who: str) -> None:
        self._event_log.add_entry(EventKind.REFUSAL, text, who)
