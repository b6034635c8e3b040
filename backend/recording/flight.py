"""The flight record: what the ring holds of the seconds around each trip, whether or not a run was recorded."""

import asyncio
import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from backend.faults import EXPLAINED
from backend.loop.access import LoopDied
from backend.loop.commands import Event, Stopped
from backend.loop.ring import Ring
from backend.recording.codec import pack, unpack
from backend.recording.columns import Columns
from backend.sample import INDEX, STORED_NAMES
from backend.storage import Database, StorageError, events, flights, runs
from backend.storage.flights import NewFlight
from backend.storage.records import UnknownRecordError
from backend.supervision import Part
from plant.interface import T_s

BEFORE_S = 10.0
AFTER_S = 5.0
LOOK_S = 0.25
DIED = "loop_died"
"""What stands in place of the fault when the loop process died."""

PART = Part("The flight recorder", "The record of a trip may come late, or lack what the ring no longer holds.")

_STORED = [INDEX[name] for name in STORED_NAMES]
_LOG = logging.getLogger(__name__)


@dataclass(eq=False)
class _Trip:
    """One that waits for its record: an identity of its own, as the thread that stores it takes it from the list."""

    ring: Ring
    fault: str
    tick: int
    text: str
    is_last: bool = False

    @property
    def due(self) -> bool:
        """Whether all that belongs to it has happened."""
        return self.is_last or self.ring.count >= self.tick + round(AFTER_S / T_s)


class FlightRecorder:
    """Hears of trips and keeps their records. ``problem`` says why one cannot be stored at present.

    ``ring`` returns the ring of the loop process that runs at present, or ran last.
    """

    def __init__(self, database: Database, ring: Callable[[], Ring]) -> None:
        self.problem = ""
        self._database = database
        self._ring = ring
        self._waiting: list[_Trip] = []
        self._storing = threading.Lock()

    def hear(self, event: Event | LoopDied) -> None:
        """Take note of a trip; a listener for ``LoopAccess.listen``."""
        match event:
            case Stopped(fault=fault, arrived_tick=tick, detail=detail):
                text = " ".join(filter(None, (EXPLAINED[fault].message, detail)))
                self._waiting.append(_Trip(self._ring(), fault, tick, text))
            case LoopDied(reason):
                self._end_of_ring()
                ring = self._ring()
                self._waiting.append(_Trip(ring, DIED, ring.count, f"The control loop died: {reason}", True))

    async def run(self) -> None:
        """Store what is due until cancelled."""
        while True:
            await asyncio.sleep(LOOK_S)
            if any(trip.due for trip in self._waiting):
                await asyncio.to_thread(self.drain)

    def close(self) -> None:
        """Store what still waits, as it is."""
        self._end_of_ring()
        self.drain()

    def drain(self) -> None:
        """Store what is due. Never raises for the database's sake: see ``problem``."""
        with self._storing:
            for trip in [trip for trip in self._waiting if trip.due]:
                try:
                    self._store(trip)
                except StorageError as error:
                    self.problem = f"the flight record of a trip cannot be stored: {error}"
                    _LOG.error(self.problem)
                    return
                self._waiting.remove(trip)
            self.problem = ""

    def _end_of_ring(self) -> None:
        # Changed one by one, in place: a thread may be storing from the list.
        for trip in tuple(self._waiting):
            trip.is_last = True

    def _store(self, trip: _Trip) -> None:
        since = max(0, trip.tick - round(BEFORE_S / T_s))
        first_tick, rows, _ = trip.ring.read(since, trip.tick + round(AFTER_S / T_s) - since)
        moving = rows[: max(0, trip.tick - first_tick), INDEX["run"]]
        run_id = int(moving[-1]) if len(moving) else 0
        with self._database.session() as session:
            try:
                known = runs.get(session, run_id).id if run_id else None
            except UnknownRecordError:
                known = None
            event = events.add(session, "trip", trip.text, run_id=known, tick=trip.tick)
            samples = pack(rows[:, _STORED].astype(np.float32))
            flight = NewFlight(event.id, trip.fault, first_tick, trip.tick, len(rows), list(STORED_NAMES), samples)
            flights.add(session, flight)


def flight_columns(database: Database, event_id: int) -> Columns:
    """Return a flight record's samples by name, shape (N,), with ``t`` [s] counted from the trip.

    Raises UnknownRecordError.
    """
    with database.reading() as session:
        flight = flights.get(session, event_id)
    table = unpack(flight.samples, len(flight.fields)).astype(np.float64)
    t = np.asarray((flight.first_tick - flight.trip_tick + np.arange(flight.count)) * T_s, np.float64)
    return {"t": t} | {name: table[:, index] for index, name in enumerate(flight.fields)}
