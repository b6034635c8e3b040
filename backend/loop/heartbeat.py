"""The service's heartbeat to the loop process, from a thread of its own.

An event loop on a busy machine can be late by tenths of a second without being in trouble; a stop of the actuator for
that would teach operators to ignore stops. The thread beats on, and falls silent once the event loop has not shown
itself for STALE_S. A process that is killed, stopped or starved falls silent at once.
"""

import threading
import time
from contextlib import suppress

from backend.loop.channel import Channel, ChannelClosedError, encode
from backend.loop.commands import Heartbeat

HEARTBEAT_S = 0.05
"""So often that the loop, which hears nothing for 0.34 s before it stops, bears six that come late."""

STALE_S = 3.0
"""An event loop that has not shown itself for so long [s] hangs."""


class Heart:
    """Beats on a channel from construction to ``stop``; ``shown`` is called by the event loop while it lives."""

    def __init__(self, channel: Channel) -> None:
        self._channel = channel
        self._shown_at = self._beaten_at = time.monotonic()
        self._silent_until = 0.0
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._beat, name="heartbeat", daemon=True)
        self._thread.start()

    def shown(self) -> None:
        """Take note that the event loop lives."""
        self._shown_at = time.monotonic()

    @property
    def age_s(self) -> float:
        """Time since the last beat [s]."""
        return time.monotonic() - self._beaten_at

    def pause(self, duration_s: float) -> None:
        """Do not beat for so long."""
        self._silent_until = time.monotonic() + duration_s

    def stop(self) -> None:
        """End the thread; the channel may be closed afterwards."""
        self._stopped.set()
        self._thread.join()

    def _beat(self) -> None:
        beat = encode(Heartbeat())
        while not self._stopped.wait(HEARTBEAT_S):
            now = time.monotonic()
            if now - self._shown_at < STALE_S and now >= self._silent_until:
                with suppress(ChannelClosedError):
                    self._channel.send(beat)
                self._beaten_at = now
