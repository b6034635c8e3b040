"""The output side of the simulated card: registers that outlive the loop process, and the watchdog that clears them.

A card keeps its last voltages when the program that wrote them dies; what takes the drives away then is its watchdog,
by the drive-enable line. So the imitation keeps its registers in shared memory and its watchdog in a process of its own
(``python -m plant.card FD``): a kill -9 of the loop leaves both as it would leave the card.
"""

import mmap
import os
import select
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from plant.interface import MotorCommand, PlantError

WATCHDOG_S = 0.5
"""Without a write for so long [s] the watchdog clears the outputs. Virtual machines pause for up to 0.3 s."""

POLL_S = 0.01
"""How often the watchdog looks [s]. A longer time between two looks counts as two of these: the machine stood still."""

_WRITES, _U_A, _U_B, _ARMED, _ENABLED, _EXPIRED, _TRIPPED, _LOOKS = range(8)
_BYTES = 8 * 8


class WatchdogExpiredError(PlantError):
    """The card's watchdog has taken the drives away; only acknowledging brings them back."""


class CardState(NamedTuple):
    """The registers as anybody may read them.

    ``writes`` and ``looks`` count the loop's writes and the watchdog's looks. ``u_A``, ``u_B`` [V] are what reaches the
    motors: zero without drive-enable.
    """

    writes: int
    looks: int
    armed: bool
    drive_enabled: bool
    expired: bool
    safety_tripped: bool
    u_A: float
    u_B: float


class Card:
    """The registers behind a file descriptor of shared memory."""

    def __init__(self, fd: int) -> None:
        self.fd = fd
        self._memory = mmap.mmap(fd, _BYTES)
        self._words = memoryview(self._memory).cast("d")
        self._watchdog: subprocess.Popen[bytes] | None = None

    @classmethod
    def create(cls) -> "Card":
        """Make registers, all zero: outputs at zero volts, drives off."""
        fd = os.memfd_create("sinew-card")
        os.ftruncate(fd, _BYTES)
        return cls(fd)

    def state(self) -> CardState:
        """Read the registers."""
        words = self._words
        enabled = bool(words[_ENABLED])
        u_A, u_B = (words[_U_A], words[_U_B]) if enabled else (0.0, 0.0)
        flags = bool(words[_ARMED]), enabled, bool(words[_EXPIRED]), bool(words[_TRIPPED])
        return CardState(int(words[_WRITES]), int(words[_LOOKS]), *flags, u_A, u_B)

    def arm(self) -> None:
        """Start the watchdog's process, enable the drives."""
        root = str(Path(__file__).resolve().parents[1])
        self._watchdog = subprocess.Popen(
            [sys.executable, "-m", "plant.card", str(self.fd)],
            stdin=subprocess.PIPE,  # its end tells the watchdog that nobody can write any more
            pass_fds=(self.fd,),
            env=os.environ | {"PYTHONPATH": root},
        )
        self.rearm()
        self._words[_ARMED] = 1.0

    def rearm(self) -> None:
        """Enable the drives again after the watchdog has expired."""
        self._words[_U_A] = self._words[_U_B] = 0.0
        self._words[_EXPIRED] = 0.0
        self._words[_ENABLED] = 1.0

    @property
    def drives(self) -> bool:
        """Whether the drive-enable line is on."""
        return bool(self._words[_ENABLED])

    def put(self, command: MotorCommand, safety_tripped: bool) -> None:
        """Write the outputs and feed the watchdog. Raises WatchdogExpiredError; the write is ignored then."""
        words = self._words
        words[_WRITES] += 1.0
        words[_TRIPPED] = float(safety_tripped)
        if words[_EXPIRED]:
            raise WatchdogExpiredError(f"the card's watchdog heard nothing for {WATCHDOG_S:g} s and cut the drives")
        words[_U_A], words[_U_B] = command

    def disarm(self) -> None:
        """Zero volts, drives off, and no watchdog any more. Safe to call twice."""
        words = self._words
        words[_U_A] = words[_U_B] = words[_ENABLED] = words[_ARMED] = 0.0
        if self._watchdog is not None:
            self._watchdog.communicate()
            self._watchdog = None

    def expire(self) -> None:
        """Clear the outputs and take the drives away: what the watchdog does when its time is over."""
        words = self._words
        words[_ENABLED] = words[_U_A] = words[_U_B] = 0.0
        words[_EXPIRED] = 1.0

    def looked(self) -> None:
        """Let the watchdog show that it is at work."""
        self._words[_LOOKS] += 1.0

    def close(self) -> None:
        """Unmap and close the descriptor. Safe to call twice."""
        if self.fd >= 0:
            self._words.release()
            self._memory.close()
            os.close(self.fd)
            self.fd = -1

    def __del__(self) -> None:
        """Let go with the last reader: a loop process that is started anew gets a card of its own."""
        if hasattr(self, "_words"):
            self.close()


def watch(card: Card, writers: int) -> None:
    """Be the watchdog until the drives are off and ``writers``, a descriptor, has come to its end."""
    written, silence_s, looked_s = -1, 0.0, time.monotonic()
    while True:
        orphaned = bool(select.select([writers], [], [], POLL_S)[0])
        if orphaned:
            time.sleep(POLL_S)
        now_s = time.monotonic()
        state = card.state()
        silence_s = 0.0 if state.writes != written else silence_s + min(now_s - looked_s, 2.0 * POLL_S)
        written, looked_s = state.writes, now_s
        card.looked()
        if state.armed and not state.expired and silence_s > WATCHDOG_S:
            card.expire()
        if orphaned and not state.drive_enabled:
            return


if __name__ == "__main__":
    watch(Card(int(sys.argv[1])), sys.stdin.fileno())
