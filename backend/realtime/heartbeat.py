"""The service's heartbeat to the loop process, and its own check of the card's registers."""

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

from backend.realtime.channel import Channel
from backend.realtime.commands import Heartbeat
from backend.realtime.ipc import encode
from backend.supervision import Part
from plant import WATCHDOG_S, Card, Stillness, cache_compiled

# Card guard ----------------------------------------------------------------------------------------
#
# The service's own look at the card's registers, which it shares with the loop and the watchdog.


WATCHDOG_MONITOR_PART = Part(
    "The watch over the card's watchdog", "A watchdog that dies now is found by the loop alone."
)

POLL_S = 0.05
"""How often the service looks [s]."""

LAST_RESORT_S = WATCHDOG_S + 0.1
"""The outputs of a dead loop are cleared by the service after so long without a write [s]: the watchdog comes first."""

_LOG = logging.getLogger(__name__)


class WatchdogMonitor:
    """Looks at one card; ``problem`` says what is wrong with its watchdog.

    Clearing the outputs is the last resort where the loop and the watchdog are both dead. It works because the service
    holds the simulator's registers. Into a rig's card nobody but the loop can look: what is shown of it is a mirror,
    and what is left behind a dead loop is that card's own watchdog and the safety module.
    """

    def __init__(self, card: Card) -> None:
        self.problem = ""
        self._card = card
        self._polls = Stillness(POLL_S)
        self._writes = Stillness(POLL_S)

    @property
    def watchdog_silent_s(self) -> float:
        """For how long the watchdog has not been seen to look [s]."""
        return self._polls.still_s

    @property
    def is_watchdog_lost(self) -> bool:
        """Whether nobody would take the drives away if the loop died: found by the loop, or seen here."""
        state = self._card.state()
        seen_dead = state.armed and state.drive_enabled and self._polls.still_s > WATCHDOG_S
        return state.watchdog_dead or (seen_dead and not state.mirror)

    def poll(self, loop_ended: bool) -> bool:
        """Look once, at the times LOOK_S apart; return whether there is anything left to guard."""
        state = self._card.state()
        self._polls.update(state.polls)
        unwritten_s = self._writes.update(state.writes)
        if self.is_watchdog_lost and not self.problem:
            self._set_problem("the card's watchdog is dead: reset starts a new loop with a new one")
        if loop_ended and state.drive_enabled and unwritten_s > LAST_RESORT_S:
            if state.mirror:  # it stays as it is: what was last known
                if not self.problem:
                    self._set_problem(
                        f"the loop is dead: the rig's card cuts the drives by its watchdog, {state.watchdog_s:g} s "
                        "after the last write, which cannot be seen from here; look at the rig, then reset"
                    )
                return False
            self._card.expire()
            self._set_problem(
                "the loop and the card's watchdog were both dead: the service cleared the outputs itself; "
                "look at the rig, then reset"
            )
        return not loop_ended or self._card.state().drive_enabled

    async def run(self, loop: Process | None) -> None:
        """Look until the loop process has ended, or is known to have ended, and the drives are off."""
        while self.poll(loop_ended=loop is None or loop.returncode is not None):
            await asyncio.sleep(POLL_S)

    def _set_problem(self, problem: str) -> None:
        self.problem = problem
        _LOG.error(problem)


# Heartbeat -----------------------------------------------------------------------------------------
#
# The service's heartbeat to the loop process, from a thread that needs neither the event loop nor
# Python's lock.
#
# An event loop on a busy machine can be late by tenths of a second without being in trouble, and
# linear algebra in another thread can keep Python's lock for longer than the loop waits; a stop of
# the actuator for that would teach operators to ignore stops. So the thread runs compiled code,
# ahead of ordinary programs where that is granted. It falls silent once the event loop has not
# shown itself for STALE_S. A process that is killed or stopped falls silent at once.


HEARTBEAT_S = 0.05
"""So often that the loop, which stops when it hears nothing for the worker's SILENCE_S, bears six that come late."""

STALE_S = 3.0
"""An event loop that has not shown itself for so long [s] hangs."""

_PRIORITY = 50
"""Of SCHED_FIFO: below the loop's own."""

_NS = 1_000_000_000
_PERIOD_NS, _STALE_NS = round(HEARTBEAT_S * _NS), round(STALE_S * _NS)
_MONOTONIC = time.CLOCK_MONOTONIC
_FLAGS = int(socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
_STOPPED, _REFRESHED, _SILENT_UNTIL, _SENT = range(4)

# libc's by name, not by address, so that the compiled code can be kept; pointers as whole numbers of their size.
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
            # A full queue or a closed end is for others to notice.
            _send(fd, packet.ctypes.data, packet.size, _FLAGS)
            words[_SENT] = now_ns


class HeartbeatSender:
    """Beats on a channel: ``run`` is the work of a thread. ``refresh`` is called by the event loop while it lives."""

    def __init__(self, channel: Channel) -> None:
        self._words = np.zeros(4, np.int64)
        self._words[_REFRESHED] = self._words[_SENT] = time.monotonic_ns()
        self._packet = np.frombuffer(encode(Heartbeat()), np.uint8).copy()
        self._fd = channel.fileno()
        self._is_stopped = False

    def run(self) -> None:
        """Beat until ``stop``, after which the channel may be closed; may be run anew when it has failed."""
        self._words[_STOPPED] = int(self._is_stopped)
        compile_heartbeat()
        with suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        _send_beats(self._fd, self._packet, self._words)
        if not self._is_stopped:
            raise RuntimeError("the heartbeat ended without being told to")

    def refresh(self) -> None:
        """Take note that the event loop lives."""
        self._words[_REFRESHED] = time.monotonic_ns()

    @property
    def age_s(self) -> float:
        """Time since the last beat [s]."""
        return float(time.monotonic_ns() - self._words[_SENT]) / _NS

    def pause(self, duration_s: float) -> None:
        """Do not beat for so long."""
        self._words[_SILENT_UNTIL] = time.monotonic_ns() + round(duration_s * _NS)

    def stop(self) -> None:
        """Let ``run`` return."""
        self._is_stopped = True
        self._words[_STOPPED] = 1


def compile_heartbeat() -> None:
    """Compile the heartbeat, which takes a second the first time, before there is a loop that waits for it."""
    stopped = np.array([1, 0, 0, 0])
    _send_beats(-1, np.zeros(1, np.uint8), stopped)
