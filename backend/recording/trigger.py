"""Trigger capture: samples around a condition on a signal, as a flight record."""

import asyncio
import logging
import threading
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from datetime import datetime
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from backend.event_bus import EventBus, StateChanged
from backend.realtime import Ring
from backend.recording import messages
from backend.recording.codec import pack_table
from backend.recording.derived_signals import Derived, compute_signal, find_source_columns
from backend.recording.flight import Quota, compute_sample_time, enforce_quota, get_run_number
from backend.sample import COMBINED_SIGNAL_BY_NAME, INDEX, STORED_COLUMNS, STORED_NAMES, UNIT_BY_SIGNAL
from backend.storage import TRIGGER, Database, Document, EventKind, NewFlight, StorageError, events, flights, settings
from backend.supervision import Part
from plant import T_s

# Condition -----------------------------------------------------------------------------------------
# Condition on a signal: a level, an edge through a level, or a window. NaN never meets it.


class ConditionKind(StrEnum):
    """Kind of a condition."""

    ABOVE = "above"
    BELOW = "below"
    RISING = "rising"
    FALLING = "falling"
    INSIDE = "inside"
    OUTSIDE = "outside"


WINDOWS = (ConditionKind.INSIDE, ConditionKind.OUTSIDE)
EDGES = (ConditionKind.RISING, ConditionKind.FALLING)


@dataclass(frozen=True)
class Condition:
    """Condition of a signal against ``level``; a window extends to ``upper``.

    The signal is a column of the sample, a combined one, or ``derived``: a formula as of the condition's creation. An
    edge is a sample beyond the level after one that is not: it requires two neighbouring samples that are not NaN.
    """

    signal: str
    kind: ConditionKind
    level: float
    upper: float | None = None
    derived: Derived | None = None

    @property
    def unit(self) -> str:
        """SI unit of the signal."""
        return UNIT_BY_SIGNAL[self.signal] if self.derived is None else self.derived.unit

    def values(self, rows: NDArray[np.float64], lengths: dict[str, float]) -> NDArray[np.float64]:
        """Return the signal of rows of the ring buffer [n, WIDTH].

        ``lengths`` are those of the geometry [m], by name.
        """
        signal = COMBINED_SIGNAL_BY_NAME.get(self.signal) if self.derived is None else self.derived
        if signal is None:
            return rows[:, INDEX[self.signal]]
        columns = {name: rows[:, INDEX[name]] for name in find_source_columns([signal])}
        return compute_signal(signal, columns, lengths, len(rows))

    def met(self, values: NDArray[np.float64], previous: float) -> NDArray[np.bool_]:
        """Return for each of ``values`` whether it meets the condition.

        ``previous`` is the sample before the first.
        """
        before = np.concatenate(([previous], values[:-1]))
        match self.kind:
            case ConditionKind.ABOVE:
                return values > self.level
            case ConditionKind.BELOW:
                return values < self.level
            case ConditionKind.RISING:
                return (before <= self.level) & (values > self.level)
            case ConditionKind.FALLING:
                return (before >= self.level) & (values < self.level)
            case ConditionKind.INSIDE:
                return (values >= self.level) & (values <= self._upper)
            case ConditionKind.OUTSIDE:
                return (values < self.level) | (values > self._upper)

    def first(self, values: NDArray[np.float64], previous: float) -> int | None:
        """Return the index of the first value that meets the condition, or None."""
        at = np.flatnonzero(self.met(values, previous))
        return int(at[0]) if len(at) else None

    @property
    def _upper(self) -> float:
        return np.inf if self.upper is None else self.upper

    def describe(self) -> str:
        """Return a description of the condition in SI units."""
        if self.kind in WINDOWS:
            return messages.window_condition(
                signal=self.signal, kind=self.kind, lower=self.level, upper=self._upper, unit=self.unit
            )
        if self.kind in EDGES:
            return messages.edge_condition(signal=self.signal, kind=self.kind, level=self.level, unit=self.unit)
        return messages.level_condition(signal=self.signal, kind=self.kind, level=self.level, unit=self.unit)


# Trigger -------------------------------------------------------------------------------------------
# Trigger: samples around a condition on a signal, stored as a flight record.
#
# It evaluates every sample from the ring buffer. Samples overwritten before they were read are NaN in the capture, and
# its text counts them.


POLL_S = 0.05
AT_ONCE = 8192
SETTING = "trigger"
"""Setting with the armed condition, which the next start of the service reports; null for none."""

TRIGGER_PART = Part(messages.trigger(), messages.capture_incomplete())

_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class Armed:
    """Armed condition with its numbers of samples and captures.

    ``before``: samples up to the trigger, ``after``: samples from it on. ``captures``: number before it disarms.
    ``who`` armed it, at ``at``.
    """

    condition: Condition
    before: int
    after: int
    captures: int
    who: str
    at: datetime

    def document(self) -> Document:
        """Return the document that is stored with a capture."""
        return asdict(self.condition) | {
            "says": self.condition.describe(),
            "before": self.before,
            "after": self.after,
            "captures": self.captures,
        }


@dataclass(eq=False)
class _Capture:
    """One capture: samples before the trigger in ``lead``, from it on in ``blocks``.

    ``have`` is the number of samples in ``blocks``.
    """

    armed: Armed
    ring: Ring
    tick: int
    at: datetime
    number: int
    run: int
    lead: NDArray[np.float32] | None = None
    blocks: list[NDArray[np.float32]] = field(default_factory=list)
    lost: int = 0
    have: int = 0
    ended: str = ""

    @property
    def first_tick(self) -> int:
        """Tick of its first sample: a loop that had just started has fewer than requested."""
        return max(0, self.tick - self.armed.before)

    def read_lead(self) -> None:
        """Read the samples before the trigger, once; overwritten ones are NaN."""
        if self.lead is None:
            wanted = self.tick - self.first_tick
            _, rows, overwritten = self.ring.read(self.first_tick, wanted)
            missing = min(overwritten, wanted)
            self.lead = np.full((wanted, len(STORED_NAMES)), np.nan, np.float32)
            self.lead[missing:] = rows[: wanted - missing, STORED_COLUMNS]
            self.lost += missing

    @property
    def wanted(self) -> int:
        """Number of samples still missing."""
        return self.armed.after - self.have

    def take(self, rows: NDArray[np.float64]) -> None:
        self.blocks.append(rows[:, STORED_COLUMNS].astype(np.float32))
        self.have += len(rows)

    def lack(self, count: int) -> None:
        """Add NaN for overwritten samples."""
        self.blocks.append(np.full((count, len(STORED_NAMES)), np.nan, np.float32))
        self.have += count
        self.lost += count

    @property
    def text(self) -> str:
        """Text with the condition and the missing samples."""
        before = self.tick - self.first_tick
        missing = []
        if before < self.armed.before:
            missing.append(messages.lead_too_short(recorded_s=before * T_s, wanted_s=self.armed.before * T_s))
        if self.have < self.armed.after:
            missing.append(
                messages.capture_ended_early(
                    recorded_s=self.have * T_s, wanted_s=self.armed.after * T_s, reason=self.ended
                )
            )
        if self.lost:
            missing.append(messages.samples_missing(count=self.lost))
        return messages.captured(
            condition=self.armed.condition.describe(), number=self.number, captures=self.armed.captures, gaps=missing
        )


@dataclass
class TriggerStatus:
    """State of the trigger: captures so far, and samples ``left`` of the current one."""

    armed: Armed
    captured: int = 0
    left: int = 0
    ended: str = ""
    """Why it was disarmed; empty while armed."""


@dataclass(frozen=True)
class Triggered:
    """The condition was met at a tick; ``text`` describes it."""

    tick: int
    text: str


class Trigger:
    """Evaluates one condition at a time.

    ``problem`` says why storing fails at present. ``ring`` returns the ring buffer of the current or last loop process;
    ``lengths`` those of the joint's geometry [m]. ``status`` is None if nothing was armed since the service started.
    """

    def __init__(
        self,
        database: Database,
        ring: Callable[[], Ring],
        quota: Quota,
        lengths: Callable[[], dict[str, float]],
        events: EventBus,
    ) -> None:
        self.problem = ""
        self.status: TriggerStatus | None = None
        self._events = events
        self._database, self._present, self._quota, self._lengths = database, ring, quota, lengths
        self._ring = ring()
        self._position = 0
        self._previous = np.nan
        self._capture: _Capture | None = None
        self._waiting: list[_Capture] = []
        self._storing = threading.Lock()

    @property
    def is_armed(self) -> bool:
        """Whether a condition is armed, or a capture is in progress."""
        return self.status is not None and not self.status.ended

    def arm(self, armed: Armed) -> None:
        """Arm a condition from the next sample on."""
        self._ring = self._present()
        self._position = self._ring.count
        _, rows, _ = self._ring.read(max(self._position - 1, 0), 1)
        self._previous = self._compute_last_value(rows, armed.condition)
        self.status = TriggerStatus(armed)
        self._events.publish(StateChanged())

    def disarm(self, why: str) -> None:
        """Disarm; samples of a capture in progress are stored."""
        if self._capture is not None:
            self._finish(self._capture, why)
        if self.status is not None and self.is_armed:
            self.status.ended = why
            self._events.publish(StateChanged())

    def save_armed(self, who: str) -> None:
        """Store the armed condition for the report at the next start. Raises StorageError."""
        armed = self.status.armed if self.status is not None and self.is_armed else None
        document = None if armed is None else armed.document() | {"who": armed.who}
        with self._database.session() as session:
            settings.save(session, SETTING, document, who)

    async def run(self) -> None:
        """Evaluate new samples and store complete captures until cancelled."""
        while True:
            await asyncio.sleep(POLL_S)
            self.step()
            if self._capture is not None and self._capture.lead is None:
                await asyncio.to_thread(self._capture.read_lead)
            if self._waiting:
                await asyncio.to_thread(self.drain)
                self._events.publish(StateChanged())

    def close(self) -> None:
        """End with the service; samples of a capture in progress are stored."""
        self.step()
        self.disarm(messages.service_ended())
        self.drain()

    def step(self) -> None:
        """Evaluate all new samples."""
        if not self.is_armed:
            return
        present = self._present()
        self._evaluate(self._ring)
        if present is not self._ring:
            if self._capture is not None:
                self._finish(self._capture, messages.loop_ended())
            self._ring, self._position, self._previous = present, 0, np.nan
            self._evaluate(present)

    def _evaluate(self, ring: Ring) -> None:
        while self.is_armed and self._position < ring.count:
            first, rows, missed = ring.read(self._position, AT_ONCE)
            if missed:
                self._previous = np.nan
                if self._capture is not None:
                    self._capture.lack(min(missed, self._capture.wanted))
                    self._finish_if_whole()
            self._position = first + len(rows)
            self._take(ring, first, rows)

    def _take(self, ring: Ring, first: int, rows: NDArray[np.float64]) -> None:
        while len(rows) and self.status is not None and self.is_armed:
            condition = self.status.armed.condition
            if self._capture is None:
                at = condition.first(condition.values(rows, self._lengths()), self._previous)
                if at is None:
                    break
                self._begin(ring, first + at, rows[at:])
                first, rows = first + at, rows[at:]
            capture = self._capture
            assert capture is not None
            taken = min(capture.wanted, len(rows))
            capture.take(rows[:taken])
            self._previous = self._compute_last_value(rows[:taken], condition)
            first, rows = first + taken, rows[taken:]
            self.status.left = capture.wanted
            self._finish_if_whole()
        if len(rows) and self.status is not None:
            self._previous = self._compute_last_value(rows, self.status.armed.condition)

    def _begin(self, ring: Ring, tick: int, rows: NDArray[np.float64]) -> None:
        assert self.status is not None
        armed, number = self.status.armed, self.status.captured + 1
        self._capture = _Capture(
            armed=armed,
            ring=ring,
            tick=tick,
            at=compute_sample_time(ring, tick),
            number=number,
            run=get_run_number(rows[:1]),
        )
        self._events.publish(Triggered(tick, messages.triggered(condition=armed.condition.describe())))

    def _finish_if_whole(self) -> None:
        if self._capture is not None and self._capture.wanted == 0:
            self._finish(self._capture, "")

    def _finish(self, capture: _Capture, why: str) -> None:
        assert self.status is not None
        capture.ended = why
        self._capture = None
        self.status.captured, self.status.left = capture.number, 0
        if capture.number == capture.armed.captures:
            self.status.ended = messages.captures_complete()
        self._waiting.append(capture)
        self._events.publish(StateChanged())

    def _compute_last_value(self, rows: NDArray[np.float64], condition: Condition) -> float:
        return float(condition.values(rows[-1:], self._lengths())[0]) if len(rows) else np.nan

    def drain(self) -> None:
        """Store complete captures. Database errors are not raised but set ``problem``."""
        with self._storing:
            while self._waiting:
                try:
                    self._store(self._waiting[0])
                except StorageError as error:
                    self.problem = messages.capture_not_stored(reason=error.message)
                    _LOG.error(self.problem)
                    return
                del self._waiting[0]
            self.problem = ""

    def _store(self, capture: _Capture) -> None:
        capture.read_lead()
        assert capture.lead is not None
        armed, table = capture.armed, np.concatenate([capture.lead, *capture.blocks])
        with self._database.session() as session:
            event = events.add(
                session,
                EventKind.TRIGGER,
                capture.text,
                who=armed.who,
                run_id=flights.known_run(session, capture.run),
                tick=capture.tick,
                detail={TRIGGER: armed.document()},
                at=capture.at,
            )
            samples = pack_table(table)
            flights.add(
                session,
                NewFlight(
                    event_id=event.id,
                    fault=TRIGGER,
                    first_tick=capture.first_tick,
                    trip_tick=capture.tick,
                    count=len(table),
                    fields=list(STORED_NAMES),
                    samples=samples,
                ),
            )
            enforce_quota(session, self._quota, TRIGGER)
            if capture.number == armed.captures and not self.is_armed:
                settings.save(session, SETTING, None, armed.who)


def load_armed_trigger(database: Database) -> Document | None:
    """Return the condition armed when the service last ended, or None, and clear it."""
    with database.session() as session:
        stored = settings.newest(session, SETTING)
        if stored is None or stored.value is None:
            return None
        settings.save(session, SETTING, None, "")
    found: Document = stored.value
    return found
