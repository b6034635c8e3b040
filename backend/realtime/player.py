"""Replay in place of control: writes one recorded row per tick.

It replaces ``Loop`` in the loop process, so the control loop has no code for replays. Nothing is measured, checked,
computed or written to a plant: a replay cannot cause a fault, and a stop only pauses it.
"""

import math
import time

import numpy as np

from backend.faults import Fault
from backend.realtime import messages
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

UNREADY = messages.replay_without_modes()

PRESENT = frozenset({"tick", "t", "mode", "run", "fault", "bank_entry", "lateness_s", "overruns"})
"""Columns of the replaying loop, not of the recording."""

_NOTHING = frozenset({"mode", "run", "fault", "bank_entry", "limits", "F_push"})
"""Columns that are 0 if unknown; the others are NaN."""


class PlayerLoop:
    """Plays one recording from its construction on.

    Stays at the last sample at the end. ``finished``: a Shutdown was received.
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
        self._since, self._from = 0, 0.0  # a tick and the sample that it shows, from which the others follow
        self._moved = True  # whether the service must be informed
        self._events: list[Event] = []

    def drain_events(self) -> list[Event]:
        """Return the events since the last call, oldest first."""
        events, self._events = self._events, []
        return events

    def handle(self, sequence: int, command: Command) -> None:
        """Execute or reject a command between two ticks; the reply is queued as an event."""
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
                refused = messages.not_a_replay_command()
        tick = self._tick
        self._events.append(Refused(sequence, tick, refused) if refused else Accepted(sequence, tick))

    def tick(self, lateness_s: float = 0.0, overruns: int = 0) -> None:
        """Execute a period: write the current row, and advance while playing."""
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
        """Do nothing: no plant is open."""

    @property
    def _sample(self) -> float:
        """Position in samples that the next tick shows, with its fraction."""
        return self._from + (self._tick - self._since) * self._speed if self._playing else self._from

    def _go(self, playing: bool, speed: float, sample: float) -> None:
        self._playing, self._speed, self._from, self._since = playing, speed, sample, self._tick
        self._moved = True

    def _play(self, order: PlayRecording) -> str:
        """Execute a command; return the reason of a rejection, "" if it is accepted."""
        last = self._samples - 1
        if order.sample is not None and not 0 <= order.sample <= last:
            return messages.sample_outside_recording(sample=order.sample, last=last)
        if order.speed is not None and not SPEED_MIN <= order.speed <= SPEED_MAX:
            return messages.speed_out_of_range(speed=order.speed, minimum=SPEED_MIN, maximum=SPEED_MAX)
        sample = self._sample if order.sample is None else float(order.sample)
        if order.playing and order.sample is None and sample >= last:
            sample = 0.0  # from the start, as it was at its end
        playing = self._playing if order.playing is None else order.playing
        self._go(playing and sample < last, self._speed if order.speed is None else order.speed, sample)
        return ""

    def _stop(self, stop: Stop) -> str:
        """Pause. STOP pressed by a person is answered with ``Stopped``.

        The service adds that no plant was driven.
        """
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
