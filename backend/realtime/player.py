"""A recording in place of control: a row each tick as it was recorded, and no more than a player's commands.

It stands where ``Loop`` stands in the loop process, so that the loop that controls knows nothing of it. Nothing is
measured, checked, decided or written here: no fault can come of what is played, and no stop has anything to stop.
"""

import math
import time

import numpy as np

from backend.faults import Fault
from backend.realtime.commands import (
    SPEED_MAX,
    SPEED_MIN,
    Accepted,
    Command,
    Event,
    Heartbeat,
    PlayerMoved,
    PlayRecording,
    Refused,
    Shutdown,
    Stop,
    Stopped,
)
from backend.realtime.modes import Mode
from backend.realtime.ring_buffer import SampleRing
from backend.sample import FIELDS, INDEX
from plant import RecordedSamples, T_s

UNREADY = "a recording is played: nothing real moves, and no mode starts"
REFUSED = "a recording is played: nothing real moves, so it takes no commands but play, pause, speed and position"

PRESENT = frozenset({"tick", "t", "mode", "run", "fault", "bank_entry", "lateness_s", "overruns"})
"""What a row says of the loop that plays, not of what was recorded."""

_NOTHING = frozenset({"mode", "run", "fault", "bank_entry", "limits", "F_push"})
"""Columns that are 0 where nothing is known; the others are nan."""


class PlayerLoop:
    """Plays one recording, beginning as it is made; at its end it stands at the last sample.

    ``finished`` tells that a Shutdown has been asked for.
    """

    mode = Mode.OFF
    readiness = (UNREADY, False)

    def __init__(self, recording: RecordedSamples, ring: SampleRing) -> None:
        names = [name for name in recording.columns if name in INDEX and name not in PRESENT]
        self._places = [INDEX[name] for name in names]
        self._recorded = np.column_stack([recording.columns[name].astype(np.float32) for name in names])
        self._row = np.array([0.0 if field.name in _NOTHING else math.nan for field in FIELDS])
        self._ring, self.finished = ring, False
        self._tick, self._samples = 0, len(recording)
        self._playing, self._speed = True, 1.0
        self._since, self._from = 0, 0.0  # a tick and the sample that it shows: it goes on from there
        self._moved = True  # what the service was not told of yet
        self._events: list[Event] = []

    def drain_events(self) -> list[Event]:
        """Events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def handle(self, sequence: int, command: Command) -> None:
        """Carry out a command between two ticks, or refuse it; the answer is queued as an event."""
        match command:
            case PlayRecording():
                refused = self._play(command)
            case Stop():
                refused = self._stop(command)
            case Heartbeat():
                refused = ""
            case Shutdown():
                self.finished, refused = True, ""
            case _:
                refused = REFUSED
        tick = self._tick
        self._events.append(Refused(sequence, tick, refused) if refused else Accepted(sequence, tick))

    def tick(self, lateness_s: float = 0.0, overruns: int = 0) -> None:
        """One period: the row of where the player stands, and one step on while it plays."""
        if self._moved:
            self._events.append(PlayerMoved(self._tick, self._playing, self._speed, self._sample, self._samples))
            self._moved = False
        row = self._row
        row[self._places] = self._recorded[int(self._sample)]
        row[_TICK], row[_T], row[_LATENESS], row[_OVERRUNS] = self._tick, self._tick * T_s, lateness_s, overruns
        self._ring.append(row)
        self._tick += 1
        if self._playing and self._sample >= self._samples - 1:
            self._go(False, self._speed, self._samples - 1)

    def close(self) -> None:
        """Nothing is driven, nothing to let go of."""

    @property
    def _sample(self) -> float:
        """Sample that the next tick shows, and how far it is on the way to the one after it."""
        return self._from + (self._tick - self._since) * self._speed if self._playing else self._from

    def _go(self, playing: bool, speed: float, sample: float) -> None:
        self._playing, self._speed, self._from, self._since = playing, speed, sample, self._tick
        self._moved = True

    def _play(self, order: PlayRecording) -> str:
        """Carry out an order; return why it is refused, "" where it is not."""
        last = self._samples - 1
        if order.sample is not None and not 0 <= order.sample <= last:
            return f"sample {order.sample} is outside the recording: it has the samples 0 to {last}"
        if order.speed is not None and not SPEED_MIN <= order.speed <= SPEED_MAX:
            return f"a speed of {order.speed:g} is outside {SPEED_MIN:g} to {SPEED_MAX:g}"
        sample = self._sample if order.sample is None else float(order.sample)
        if order.playing and order.sample is None and sample >= last:
            sample = 0.0  # played again after its end
        playing = self._playing if order.playing is None else order.playing
        self._go(playing and sample < last, self._speed if order.speed is None else order.speed, sample)
        return ""

    def _stop(self, stop: Stop) -> str:
        """Pause. Whoever pressed STOP has to hear of it: that nothing was driven is told by who knows the plant."""
        begun_s = time.perf_counter()
        self._go(False, self._speed, self._sample)
        if stop.fault is Fault.STOP_PRESSED:
            elapsed_ms = 1e3 * (time.perf_counter() - begun_s)
            self._events.append(
                Stopped(
                    fault=stop.fault,
                    hard=stop.hard,
                    arrived_tick=self._tick,
                    zero_tick=self._tick,
                    milliseconds=elapsed_ms,
                    detail=stop.detail,
                )
            )
        return ""


_TICK, _T, _LATENESS, _OVERRUNS = (INDEX[name] for name in ("tick", "t", "lateness_s", "overruns"))
