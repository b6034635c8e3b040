"""Output side of the simulated card: its registers and its watchdog.

A card keeps its last voltages when the program that wrote them dies; its watchdog then disables the drives through the
drive-enable line. The simulated card therefore keeps its registers in shared memory and runs its watchdog in a separate
process (``python -m plant.safety_card FD``): kill -9 of the loop has the same effect as with a real card.

Loop and watchdog monitor each other. The watchdog counts its polls, and a loop that detects a stopped count disables
the drives itself. Before the drives are enabled, a proof test shows that the watchdog disables them.
"""

import mmap
import os
import select
import subprocess
import sys
import time
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import NamedTuple

from plant import messages
from plant.interface import MotorCommand, PlantError

# Change timeout ------------------------------------------------------------------------------------
# Time without a change, measured on a machine that may itself be paused.


class Stillness:
    """Time since a value last changed, for a caller that polls every ``period_s`` [s].

    A longer time between two polls counts as two periods: the machine was paused, and the monitored process with it.
    """

    def __init__(self, period_s: float) -> None:
        self._max_step_s = 2.0 * period_s
        self._last_value: Hashable = None
        self._checked_s = 0.0
        self.still_s = 0.0

    def update(self, value: Hashable, now_s: float | None = None) -> float:
        """Return how long ``value`` has been the same [s].

        ``now_s`` is the monotonic clock.
        """
        now_s = time.monotonic() if now_s is None else now_s
        self.still_s = (
            self.still_s + min(now_s - self._checked_s, self._max_step_s) if value == self._last_value else 0.0
        )
        self._last_value, self._checked_s = value, now_s
        return self.still_s


# Card ----------------------------------------------------------------------------------------------


WATCHDOG_S = 0.5
"""Time without a write after which the watchdog clears the outputs [s]. Virtual machines pause for up to 0.3 s."""

TRIAL_S = 0.1
"""Watchdog time during the proof test [s], shorter so that it delays the start by no more."""

POLL_S = 0.01
"""Polling period of the watchdog [s]."""

_WRITE_S = 1e-3
"""Period of the loop's writes [s]."""

_START_TIMEOUT_S = 20.0
"""Time that the watchdog's process may take to start on a busy machine [s]."""

_PRIORITY = 70
"""SCHED_FIFO priority above the loop's: a runaway loop must not block its watchdog."""

_WRITES, _U_A, _U_B, _ARMED, _ENABLED, _EXPIRED, _TRIPPED, _POLLS, _LIMIT_S, _DEAD, _MIRROR = range(11)
_BYTES = 11 * 8


class WatchdogExpiredError(PlantError):
    """The card's watchdog has disabled the drives; acknowledging enables them again."""


class WatchdogDeadError(PlantError):
    """The watchdog is dead; the drives stay off until a new one has been started."""


class CardState(NamedTuple):
    """Values of the registers, readable by every process.

    ``writes`` and ``polls`` count the loop's writes and the watchdog's polls; ``watchdog_dead``: the loop detected that
    the polls stopped. ``u_A``, ``u_B`` [V] are the voltages at the motors: zero without drive-enable. The watchdog
    expires after ``watchdog_s`` [s] without a write. ``mirror``: the values are the loop's last knowledge of a card
    that no other process can read.
    """

    writes: int
    polls: int
    armed: bool
    drive_enabled: bool
    expired: bool
    safety_tripped: bool
    watchdog_dead: bool
    mirror: bool
    watchdog_s: float
    u_A: float
    u_B: float


class Card:
    """Registers in shared memory, identified by a file descriptor."""

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._memory = mmap.mmap(fd, _BYTES)
        self._words = memoryview(self._memory).cast("d")
        self._watchdog: subprocess.Popen[bytes] | None = None
        self._watchdog_polls = Stillness(_WRITE_S)

    @classmethod
    def create(cls) -> "Card":
        """Create registers, all zero: outputs at zero volts, drives off."""
        fd = os.memfd_create("sinew-card")
        os.ftruncate(fd, _BYTES)
        return cls(fd)

    def state(self) -> CardState:
        """Return the values of the registers."""
        words = self._words
        enabled = bool(words[_ENABLED])
        u_A, u_B = (words[_U_A], words[_U_B]) if enabled else (0.0, 0.0)
        armed, expired, tripped, dead, mirror = (
            bool(words[register]) for register in (_ARMED, _EXPIRED, _TRIPPED, _DEAD, _MIRROR)
        )
        counts = int(words[_WRITES]), int(words[_POLLS])
        return CardState(*counts, armed, enabled, expired, tripped, dead, mirror, words[_LIMIT_S], u_A, u_B)

    @property
    def watchdog_pid(self) -> int | None:
        """Process id of the watchdog that this object has started."""
        return None if self._watchdog is None else self._watchdog.pid

    def start_watchdog(self) -> None:
        """Start the watchdog's process, without waiting for it; the drives stay off."""
        self._words[_LIMIT_S] = WATCHDOG_S
        self._watchdog = subprocess.Popen(
            [sys.executable, "-P", "-m", "plant.safety_card", str(self.fd)],  # -P: nothing from the working directory
            stdin=subprocess.PIPE,  # EOF means that no writer is left
            pass_fds=(self.fd,),
        )

    def arm(self) -> None:
        """Run the proof test of the watchdog, then enable the drives.

        The test enables the drives at zero volts and writes nothing, with the watchdog's time reduced to TRIAL_S: the
        line must be off within WATCHDOG_S. Raises PlantError if it is not.
        """
        if self._watchdog is None:
            self.start_watchdog()
        words = self._words
        self._await_watchdog()
        words[_LIMIT_S], words[_ARMED] = TRIAL_S, 1.0
        self.rearm()
        has_cut = self._wait_until(lambda: bool(words[_EXPIRED]), WATCHDOG_S) and not self.drives_on
        words[_LIMIT_S] = WATCHDOG_S
        if not has_cut:
            self.disarm()
            raise PlantError(messages.watchdog_test_failed(within_s=WATCHDOG_S))
        self.rearm()

    def rearm(self) -> None:
        """Enable the drives after the watchdog has expired.

        Raises PlantError if the watchdog is dead.
        """
        if self._words[_DEAD]:
            raise PlantError(messages.watchdog_dead())
        self._words[_U_A] = self._words[_U_B] = 0.0
        self._words[_EXPIRED] = 0.0
        self._words[_ENABLED] = 1.0

    def _await_watchdog(self) -> None:
        if self._watchdog is not None and not self._wait_until(lambda: self._words[_POLLS] > 0.0, _START_TIMEOUT_S):
            self.disarm()
            raise PlantError(messages.watchdog_did_not_start(within_s=_START_TIMEOUT_S))

    @staticmethod
    def _wait_until(reached: Callable[[], bool], within_s: float) -> bool:
        waiting = Stillness(_WRITE_S)
        while not reached():
            if waiting.update(None) > within_s:
                return False
            time.sleep(_WRITE_S)
        return True

    @property
    def drives_on(self) -> bool:
        """Whether the drive-enable line is on."""
        return bool(self._words[_ENABLED])

    def write(self, command: MotorCommand, safety_tripped: bool) -> None:
        """Write the outputs, feed the watchdog and check that it runs.

        Raises WatchdogExpiredError or WatchdogDeadError; the drives are then off and the write is ignored.
        """
        self.set_trip(safety_tripped)
        self.feed()
        self.set_outputs(command)

    def feed(self) -> None:
        """Feed the watchdog. Raises as ``write`` does."""
        words = self._words
        words[_WRITES] += 1.0
        if self._watchdog is not None and self._watchdog_polls.update(words[_POLLS]) > WATCHDOG_S:
            words[_ENABLED] = words[_U_A] = words[_U_B] = 0.0
            words[_DEAD] = 1.0
        if words[_DEAD]:
            raise WatchdogDeadError(messages.watchdog_not_responding(silent_s=WATCHDOG_S))
        if words[_EXPIRED]:
            raise WatchdogExpiredError(messages.watchdog_expired(watchdog_s=words[_LIMIT_S]))

    def set_outputs(self, command: MotorCommand) -> None:
        """Set the voltages of the analog outputs [V].

        With the drives on they reach the motors.
        """
        self._words[_U_A], self._words[_U_B] = command

    def set_trip(self, safety_tripped: bool) -> None:
        """Set the safety module's trip signal."""
        self._words[_TRIPPED] = float(safety_tripped)

    def set_drives(self, *, on: bool) -> None:
        """Set the drive-enable line; an expired watchdog keeps it off."""
        self._words[_ENABLED] = float(on and not self._words[_EXPIRED])

    def clear_expiration(self) -> None:
        """Clear the expiration, so that the drives can be enabled again."""
        self._words[_EXPIRED] = 0.0

    def start_watching(self, limit_s: float) -> None:
        """Start the watchdog with this limit, expiration cleared.

        Raises PlantError if it did not start.
        """
        words = self._words
        self._await_watchdog()
        words[_LIMIT_S], words[_EXPIRED] = limit_s, 0.0
        words[_WRITES] += 1.0
        words[_ARMED] = 1.0

    def mirror(self, state: CardState) -> None:
        """Publish the loop's knowledge of a card that no other process can read."""
        words = self._words
        words[_MIRROR] = 1.0
        words[_WRITES] += 1.0
        words[_LIMIT_S] = state.watchdog_s
        words[_ARMED], words[_ENABLED], words[_EXPIRED], words[_TRIPPED] = (
            float(flag) for flag in (state.armed, state.drive_enabled, state.expired, state.safety_tripped)
        )
        words[_U_A], words[_U_B] = state.u_A, state.u_B

    def disarm(self) -> None:
        """Zero volts, drives off, watchdog ended. Safe to call twice."""
        words = self._words
        words[_U_A] = words[_U_B] = words[_ENABLED] = words[_ARMED] = 0.0
        if self._watchdog is not None:
            try:
                self._watchdog.communicate(timeout=1.0)
            except subprocess.TimeoutExpired:
                self._watchdog.kill()
                self._watchdog.communicate()
            self._watchdog = None

    def kill_watchdog(self) -> None:
        """Kill the watchdog, to test the reaction."""
        if self._watchdog is not None:
            self._watchdog.kill()

    def expire(self) -> None:
        """Clear the outputs and disable the drives, as the watchdog does when it expires."""
        words = self._words
        words[_ENABLED] = words[_U_A] = words[_U_B] = 0.0
        words[_EXPIRED] = 1.0

    def count_poll(self) -> None:
        """Count a poll of the watchdog."""
        self._words[_POLLS] += 1.0

    def close(self) -> None:
        """Unmap the memory and close the descriptor. Safe to call twice."""
        if self.fd >= 0:
            self._words.release()
            self._memory.close()
            os.close(self.fd)
            self.fd = -1

    def __del__(self) -> None:
        """Release the registers with the last reader.

        A restarted loop process has its own card.
        """
        if hasattr(self, "_words"):
            self.close()


def run_watchdog(card: Card, writers: int) -> None:
    """Run the watchdog until the drives are off and ``writers`` is at EOF.

    ``writers`` is a file descriptor that the writing process holds open.
    """
    silence = Stillness(POLL_S)
    while True:
        is_orphaned = bool(select.select([writers], [], [], POLL_S)[0])
        if is_orphaned:
            time.sleep(POLL_S)
        state = card.state()
        silent_s = silence.update((state.writes, state.armed, state.expired))
        card.count_poll()
        if state.armed and not state.expired and silent_s > state.watchdog_s:
            card.expire()
        if is_orphaned and not state.drive_enabled:
            return


if __name__ == "__main__":
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(_PRIORITY))
    run_watchdog(Card(int(sys.argv[1])), sys.stdin.fileno())
