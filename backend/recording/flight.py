"""Flight records: samples of the seconds around each trip, from the ring buffer.

They are stored whether or not a run was recorded. Trips within the duration of a record share it, and it names them.
Records have a quota; the oldest are deleted for a new one, and an event reports that.
"""

import asyncio
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta

import numpy as np
from numpy.typing import NDArray

from backend.faults import Fault, describe_fault
from backend.realtime import Event, LoopExited, Ring, Stopped
from backend.recording import messages
from backend.recording.codec import pack_table, unpack
from backend.recording.reader import Columns
from backend.sample import INDEX, STORED_COLUMNS, STORED_NAMES
from backend.storage import Database, EventKind, NewFlight, Session, StorageError, events, flights
from backend.supervision import Part
from plant import T_s

BEFORE_S = 10.0
AFTER_S = 5.0
POLL_S = 0.25
DIED = "loop_died"
"""Name that replaces the fault if the loop process died."""

FLIGHT_RECORDER_PART = Part(messages.flight_recorder(), messages.flight_record_incomplete())

_LOG = logging.getLogger(__name__)


MAX_REPORTED_FOLLOWERS = 5
"""Number of trips sharing a record that its text names; the others are counted."""


@dataclass(eq=False)
class _Trip:
    """A trip that waits for its record.

    Compared by identity, because the thread that stores it removes it from the list.
    """

    ring: Ring
    fault: str
    tick: int
    text: str
    at: datetime
    is_last: bool = False
    followers: list[str] = field(default_factory=list)

    @property
    def is_due(self) -> bool:
        """Whether all samples of its record have been taken."""
        return self.is_last or self.ring.count >= self.tick + round(AFTER_S / T_s)

    def matches(self, ring: Ring, tick: int) -> bool:
        """Return whether a trip at ``tick`` belongs to this one's record."""
        return not self.is_last and ring is self.ring and 0 <= tick - self.tick < round(AFTER_S / T_s)

    @property
    def followed_by(self) -> str:
        """Text naming the trips that share the record; empty without any."""
        named, others = self.followers[:MAX_REPORTED_FOLLOWERS], len(self.followers) - MAX_REPORTED_FOLLOWERS
        return messages.following_trips(trips=named, others=others)


@dataclass(frozen=True)
class Quota:
    """Limits of the number and the total size of flight records."""

    records: int
    size_bytes: int


class FlightRecorder:
    """Stores flight records of trips. ``problem`` says why storing fails at present.

    ``ring`` returns the ring buffer of the current or last loop process. A trip whose fault ``is_expected`` gets no
    record.
    """

    def __init__(
        self,
        database: Database,
        ring: Callable[[], Ring],
        quota: Quota,
        is_expected: Callable[[Fault], bool] = lambda _fault: False,
    ) -> None:
        self.problem = ""
        self._is_expected = is_expected
        self._database = database
        self._ring = ring
        self._quota = quota
        self._waiting: list[_Trip] = []
        # Trips are reported in the event loop and stored in a thread.
        self._list_lock, self._drain_lock = threading.Lock(), threading.Lock()

    def on_event(self, event: Event | LoopExited) -> None:
        """Register a trip; a listener for ``LoopClient.listen``."""
        match event:
            case Stopped(fault=fault, arrived_tick=tick, detail=detail) if not self._is_expected(fault):
                text = describe_fault(fault, detail)
                ring = self._ring()
                self._trip(_Trip(ring, fault, tick, text, compute_sample_time(ring, tick)))
            case LoopExited(reason):
                self._end_of_ring()
                ring = self._ring()
                text = messages.tripped_by_loop_death(reason=reason)
                self._trip(
                    _Trip(
                        ring=ring,
                        fault=DIED,
                        tick=ring.count,
                        text=text,
                        at=compute_sample_time(ring, ring.count),
                        is_last=True,
                    )
                )
            case _:
                return

    def _trip(self, new: _Trip) -> None:
        with self._list_lock:
            for trip in self._waiting:
                if trip.matches(new.ring, new.tick):
                    delay_s = (new.tick - trip.tick) * T_s
                    trip.followers.append(messages.following_trip(fault=new.fault, delay_s=delay_s))
                    return
            self._waiting.append(new)

    async def run(self) -> None:
        """Store due records until cancelled."""
        while True:
            await asyncio.sleep(POLL_S)
            if self._due():
                await asyncio.to_thread(self.drain)

    def close(self) -> None:
        """Store all pending records as they are."""
        self._end_of_ring()
        self.drain()

    def drain(self) -> None:
        """Store due records. Database errors are not raised but set ``problem``."""
        with self._drain_lock:
            for trip in self._due():
                try:
                    self._store(trip)
                except StorageError as error:
                    self.problem = messages.flight_record_not_stored(reason=error.message)
                    _LOG.error(self.problem)
                    return
                with self._list_lock:
                    self._waiting.remove(trip)
            self.problem = ""

    def _due(self) -> list[_Trip]:
        ring = self._ring()
        with self._list_lock:
            # A replaced ring buffer, also after a reset with a dead watchdog, gets no more samples.
            due = [trip for trip in self._waiting if trip.is_due or trip.ring is not ring]
            for trip in due:
                trip.is_last = True  # later trips get their own record
            return due

    def _end_of_ring(self) -> None:
        with self._list_lock:
            for trip in self._waiting:
                trip.is_last = True

    def _store(self, trip: _Trip) -> None:
        since = max(0, trip.tick - round(BEFORE_S / T_s))
        first_tick, rows, _ = trip.ring.read(since, trip.tick + round(AFTER_S / T_s) - since)
        run_id = get_run_number(rows[: max(0, trip.tick - first_tick)])
        with self._database.session() as session:
            known = flights.known_run(session, run_id)
            # the event log has the trip, with the person who pressed STOP, unless it could not be written
            event = events.find_trip(session, trip.tick, trip.at)
            if event is None:
                event = events.add(session, EventKind.TRIP, trip.text, tick=trip.tick, at=trip.at)
            events.complete(session, event.id, run_id=known, followed_by=trip.followed_by)
            samples = pack_table(rows[:, STORED_COLUMNS].astype(np.float32))
            flight = NewFlight(
                event_id=event.id,
                fault=trip.fault,
                first_tick=first_tick,
                trip_tick=trip.tick,
                count=len(rows),
                fields=list(STORED_NAMES),
                samples=samples,
            )
            flights.add(session, flight)
            enforce_quota(session, self._quota)


def enforce_quota(session: Session, quota: Quota, of: str = "") -> None:
    """Delete the oldest records beyond the quota and log that.

    ``of`` triggers: their captures; empty: records of trips.
    """
    gone = flights.delete_oldest(session, quota.records, quota.size_bytes, of)
    if gone:
        text = messages.oldest_records_deleted(
            deleted=gone, captures=bool(of), kept=quota.records, size_bytes=quota.size_bytes
        )
        events.add(session, EventKind.FLIGHT_QUOTA, text)


def get_run_number(rows: NDArray[np.float64]) -> int:
    """Return the run of the last row of the ring buffer, 0 for none."""
    return int(rows[-1, INDEX["run"]]) if len(rows) else 0


def compute_sample_time(ring: Ring, tick: int) -> datetime:
    """Return the time of a recent tick; the ring buffer may have newer ones."""
    return datetime.now(UTC) - timedelta(seconds=max(0, ring.count - tick) * T_s)


def read_flight_columns(database: Database, event_id: int) -> Columns:
    """Return a flight record's samples by name, shape (N,).

    ``t`` [s] counts from the trip or trigger. Raises UnknownRecordError.
    """
    with database.reading() as session:
        flight = flights.get(session, event_id)
    table = unpack(flight.samples, len(flight.fields)).astype(np.float64)
    t = np.asarray((flight.first_tick - flight.trip_tick + np.arange(flight.count)) * T_s, np.float64)
    return {"t": t} | {name: table[:, index] for index, name in enumerate(flight.fields)}
