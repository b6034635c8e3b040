"""Absolute deadlines of the loop, and statistics of its timing."""

import ctypes
import os
import resource
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from backend.realtime import messages
from backend.realtime.ring_buffer import Ring
from backend.response_docs import describe_field
from backend.sample import INDEX
from plant import T_s

# Pacer ---------------------------------------------------------------------------------------------
# Absolute deadlines on the monotonic clock, and the real-time privileges that the machine grants.
#
# A deadline missed by a whole period is skipped and counted as an overrun; it is never made up for by faster ticks,
# which on hardware would be a burst of commands.


_LIBC = ctypes.CDLL(None, use_errno=True)
_PR_SET_TIMERSLACK = 29
_PR_GET_TIMERSLACK = 30
_MCL_CURRENT = 1
_MCL_FUTURE = 2
_MCL_ONFAULT = 4
_NS = 1_000_000_000
_TIMER_SLACK_NS = 1
_PRIORITY = 60
"""SCHED_FIFO priority: above the interrupt threads' default of 50, below the kernel's own watchdogs."""


@dataclass(frozen=True)
class RealTimeStatus:
    """Real-time privileges of the control loop.

    ``refusals`` lists privileges that were not granted, with remedies. ``priority`` is that of SCHED_FIFO, 0 under
    standard scheduling.
    """

    priority: int = field(metadata=describe_field("priority of SCHED_FIFO; 0 under standard scheduling"))
    memory_locked: bool
    timer_slack_ns: int
    refusals: tuple[str, ...] = field(
        metadata=describe_field("privileges that were not granted, with reason and remedy")
    )


def request_real_time() -> RealTimeStatus:
    """Request FIFO scheduling, locked memory and 1 ns timer slack for this process.

    Returns what was granted.
    """
    refusals: list[str] = []
    _LIBC.prctl(_PR_SET_TIMERSLACK, ctypes.c_ulong(_TIMER_SLACK_NS), 0, 0, 0)
    priority = 0
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
        priority = _PRIORITY
    except OSError as error:
        refusals.append(messages.priority_not_granted(priority=_PRIORITY, reason=error.strerror))
    # Under a finite limit a later allocation would fail instead of being unlocked.
    unlimited = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0] == resource.RLIM_INFINITY
    future = _MCL_FUTURE if unlimited else 0
    memory_locked = _LIBC.mlockall(_MCL_CURRENT | _MCL_ONFAULT | future) == 0
    if not memory_locked:
        refusals.append(messages.memory_not_locked(reason=os.strerror(ctypes.get_errno())))
    slack_ns = _LIBC.prctl(_PR_GET_TIMERSLACK, 0, 0, 0, 0)
    return RealTimeStatus(priority, memory_locked, slack_ns, tuple(refusals))


def _sleep_until(deadline_ns: int) -> None:
    # Sleeps until an absolute time, also after a signal; calling libc by ctypes would cost more.
    time.sleep(max(deadline_ns - time.monotonic_ns(), 0) / _NS)


class Pacer:
    """Waits for consecutive deadlines, ``period_s`` apart.

    ``overruns`` is the number of deadlines skipped so far. ``now_ns`` and ``sleep_until`` are the monotonic clock [ns].
    """

    def __init__(
        self,
        period_s: float,
        now_ns: Callable[[], int] = time.monotonic_ns,
        sleep_until: Callable[[int], None] = _sleep_until,
    ) -> None:
        self._period_ns = round(period_s * _NS)
        self._now_ns = now_ns
        self._sleep_until = sleep_until
        self._deadline_ns = now_ns()
        self.overruns = 0

    def resume(self) -> None:
        """Continue from now after an intended pause, which counts no overruns."""
        self._deadline_ns = self._now_ns()

    def met(self) -> float:
        """Record a period ended by an external clock; return its lateness [s].

        Lateness is relative to the previous period. Each whole period beyond the one that was due counts as an overrun.
        """
        now_ns = self._now_ns()
        late_ns = max(now_ns - self._deadline_ns - self._period_ns, 0)
        self.overruns += late_ns // self._period_ns
        self._deadline_ns = now_ns
        return late_ns / _NS

    def wait(self) -> float:
        """Sleep until the next deadline; return the lateness [s].

        The lateness is always less than a period plus the wake-up time. If the caller is late by more than a whole
        period, the missed deadlines are skipped.
        """
        self._deadline_ns += self._period_ns
        behind_ns = self._now_ns() - self._deadline_ns
        if behind_ns >= self._period_ns:
            skipped = behind_ns // self._period_ns
            self.overruns += skipped
            self._deadline_ns += skipped * self._period_ns
        elif behind_ns < 0:
            self._sleep_until(self._deadline_ns)
        return (self._now_ns() - self._deadline_ns) / _NS


# Timing --------------------------------------------------------------------------------------------
# Timing of the loop, from the samples of the last seconds.


WINDOW_TICKS = 5000


@dataclass(frozen=True)
class Timing:
    """Rate [Hz] and lateness [s] over the last ``WINDOW_TICKS`` samples.

    ``overruns`` counts since the loop started. The rate accounts for skipped deadlines; all values except ``overruns``
    are NaN before the first samples.
    """

    rate_Hz: float
    lateness_p50_s: float
    lateness_p99_s: float
    overruns: int


def compute_timing(ring: Ring) -> Timing:
    """Return the timing of the loop that writes ``ring``."""
    end = ring.count
    _, rows, _ = ring.read(max(0, end - WINDOW_TICKS), WINDOW_TICKS)
    if len(rows) < 2:
        return Timing(np.nan, np.nan, np.nan, 0)
    overruns = rows[:, INDEX["overruns"]]
    periods = len(rows) - 1 + overruns[-1] - overruns[0]
    p50, p99 = np.percentile(rows[:, INDEX["lateness_s"]], [50.0, 99.0])
    return Timing(float((len(rows) - 1) / (periods * T_s)), float(p50), float(p99), int(overruns[-1]))


LATENESS_EDGES_S = (0.0, 20e-6, 50e-6, 100e-6, 200e-6, 500e-6, 1e-3, 2e-3, 5e-3, np.inf)
"""Boundaries of the histogram's classes [s]; the last class has no upper one."""


def count_lateness(ring: Ring) -> list[int]:
    """Return the number of control steps in the ring buffer per class of lateness."""
    end = ring.count
    _, rows, _ = ring.read(max(0, end - ring.capacity), ring.capacity)
    counts, _ = np.histogram(np.maximum(rows[:, INDEX["lateness_s"]], 0.0), LATENESS_EDGES_S)
    return [int(count) for count in counts]
