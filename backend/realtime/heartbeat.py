"""Heartbeat from the service to the loop process, and monitoring of the watchdog."""

import asyncio
import logging
import os
import socket
import time
from asyncio.subprocess import Process
from contextlib import suppress
from typing import Any

import numba
import numpy as np
from numba.core.types import ExternalFunction, int32, intp, uintp
from numpy.typing import NDArray

from backend.realtime import messages
from backend.realtime.channel import Channel
from backend.realtime.commands import Heartbeat
from backend.realtime.ipc import encode
from backend.supervision import Part
from plant import WATCHDOG_S, Card, Stillness, cache_compiled

# Watchdog monitor ----------------------------------------------------------------------------------
# The service's own monitoring of the card's registers, which it shares with the loop and the watchdog.


WATCHDOG_MONITOR_PART = Part(messages.watchdog_monitor(), messages.watchdog_death_unnoticed())

POLL_S = 0.05
"""Polling period of the service [s]."""

LAST_RESORT_S = WATCHDOG_S + 0.1
"""Time without a write [s] after which the service clears the outputs of a dead loop: later than the watchdog."""

_LOG = logging.getLogger(__name__)


class WatchdogMonitor:
    """Monitors the watchdog of one card; ``problem`` describes its failure.

    Clearing the outputs is the last resort if loop and watchdog are both dead. It works because the service shares the
    simulator's registers. Only the loop can access a rig's card: its registers here are a mirror, and if the loop dies,
    that card's own watchdog and the safety module remain.
    """

    def __init__(self, card: Card) -> None:
        self.problem = ""
        self._card = card
        self._polls = Stillness(POLL_S)
        self._writes = Stillness(POLL_S)

    @property
    def watchdog_silent_s(self) -> float:
        """Time since the watchdog's last observed poll [s]."""
        return self._polls.still_s

    @property
    def is_watchdog_lost(self) -> bool:
        """Whether the watchdog is dead, as detected by the loop or here."""
        state = self._card.state()
        seen_dead = state.armed and state.drive_enabled and self._polls.still_s > WATCHDOG_S
        return state.watchdog_dead or (seen_dead and not state.mirror)

    def poll(self, loop_ended: bool) -> bool:
        """Check once, called every POLL_S; return whether monitoring must continue."""
        state = self._card.state()
        self._polls.update(state.polls)
        unwritten_s = self._writes.update(state.writes)
        if self.is_watchdog_lost and not self.problem:
            self._set_problem(messages.watchdog_dead())
        if loop_ended and state.drive_enabled and unwritten_s > LAST_RESORT_S:
            if state.mirror:  # a mirror keeps the last known state
                if not self.problem:
                    self._set_problem(messages.loop_died_with_mirror(watchdog_s=state.watchdog_s))
                return False
            self._card.expire()
            self._set_problem(messages.loop_and_watchdog_died())
        return not loop_ended or self._card.state().drive_enabled

    async def run(self, loop: Process | None) -> None:
        """Monitor until the loop process has ended and the drives are off.

        ``loop`` None: it has ended.
        """
        while self.poll(loop_ended=loop is None or loop.returncode is not None):
            await asyncio.sleep(POLL_S)

    def _set_problem(self, problem: str) -> None:
        self.problem = problem
        _LOG.error(problem)


# Heartbeat -----------------------------------------------------------------------------------------
# Heartbeat to the loop process, from a thread that needs neither the event loop nor the GIL.
#
# On a busy machine an event loop can be late by tenths of a second without a fault, and linear algebra in another
# thread can hold the GIL for longer than the loop's timeout; stopping the actuator for that would teach operators to
# ignore stops. The thread therefore runs compiled code, with real-time priority if it is granted. It stops sending when
# the event loop has not refreshed it for STALE_S. If the process is killed or stopped, it stops at once.


HEARTBEAT_S = 0.05
"""Period of the heartbeat [s]; the loop, whose timeout is the worker's SILENCE_S, tolerates six late ones."""

STALE_S = 3.0
"""Time without a refresh after which the event loop is considered hung [s]."""

_PRIORITY = 50
"""SCHED_FIFO priority, below the loop's."""

_NS = 1_000_000_000
_PERIOD_NS, _STALE_NS = round(HEARTBEAT_S * _NS), round(STALE_S * _NS)
_MONOTONIC = time.CLOCK_MONOTONIC
_FLAGS = int(socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
_STOPPED, _REFRESHED, _SILENT_UNTIL, _SENT = range(4)

# By name, not address, so that numba can cache the code; pointers are integers of their size.
_send: Any = ExternalFunction("send", intp(int32, intp, uintp, int32))
_sleep: Any = ExternalFunction("clock_nanosleep", int32(int32, int32, intp, intp))
_now: Any = ExternalFunction("clock_gettime", int32(int32, intp))


@cache_compiled
@numba.njit(nogil=True)
def _send_beats(fd: int, packet: NDArray[np.uint8], words: NDArray[np.int64]) -> None:
    period = np.array([0, _PERIOD_NS])
    clock = np.zeros(2, np.int64)
    while words[_STOPPED] == 0:
        _sleep(_MONOTONIC, 0, period.ctypes.data, 0)
        _now(_MONOTONIC, clock.ctypes.data)
        now_ns = clock[0] * _NS + clock[1]
        if now_ns - words[_REFRESHED] < _STALE_NS and now_ns >= words[_SILENT_UNTIL]:
            # A full queue or a closed end is detected elsewhere.
            _send(fd, packet.ctypes.data, packet.size, _FLAGS)
            words[_SENT] = now_ns


class HeartbeatSender:
    """Sends heartbeats on a channel.

    ``run`` is the work of a thread; the event loop calls ``refresh`` while it is alive.
    """

    def __init__(self, channel: Channel) -> None:
        self._words = np.zeros(4, np.int64)
        self._words[_REFRESHED] = self._words[_SENT] = time.monotonic_ns()
        self._packet = np.frombuffer(encode(Heartbeat()), np.uint8).copy()
        self._fd = channel.fileno()
        self._is_stopped = False

    def run(self) -> None:
        """Send until ``stop``, after which the channel may be closed; may run again."""
        self._words[_STOPPED] = int(self._is_stopped)
        compile_heartbeat()
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        _send_beats(self._fd, self._packet, self._words)
        if not self._is_stopped:
            raise RuntimeError("the heartbeat ended without a request")

    def refresh(self) -> None:
        """Record that the event loop is alive."""
        self._words[_REFRESHED] = time.monotonic_ns()

    @property
    def age_s(self) -> float:
        """Time since the last heartbeat [s]."""
        return float(time.monotonic_ns() - self._words[_SENT]) / _NS

    def pause(self, duration_s: float) -> None:
        """Send no heartbeat for a duration [s]."""
        self._words[_SILENT_UNTIL] = time.monotonic_ns() + round(duration_s * _NS)

    def stop(self) -> None:
        """End ``run``."""
        self._is_stopped = True
        self._words[_STOPPED] = 1


def compile_heartbeat() -> None:
    """Compile the heartbeat, which takes a second at first, before a loop needs it."""
    stopped = np.array([1, 0, 0, 0])
    _send_beats(-1, np.zeros(1, np.uint8), stopped)
