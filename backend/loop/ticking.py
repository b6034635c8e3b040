"""Whether the loop process ticks, as the service sees it in the ring."""

from collections.abc import Iterator
from contextlib import contextmanager

from backend.loop.commands import Command, SwitchDrives

HUNG_BEATS = 16
"""A loop that has not ticked for so many heartbeats hangs; it is killed, so that the card's watchdog takes over."""


class Ticking:
    """Looks at one loop process once a heartbeat."""

    def __init__(self) -> None:
        self._count = -1
        self._still = 0
        self._excused = 0

    @contextmanager
    def excused(self, command: Command) -> Iterator[None]:
        """Bear that it does not tick until it has answered: before drives come on it may have to try its watchdog.

        It waits for its card then, at zero volts; that it answers in time is seen to by whoever has sent the command.
        """
        waits = isinstance(command, SwitchDrives) and command.on
        self._excused += waits
        try:
            yield
        finally:
            self._excused -= waits

    def hangs(self, count: int) -> bool:
        """Look at the number of samples so far, and tell whether it has stood still for too long."""
        self._still = self._still + 1 if count == self._count and not self._excused else 0
        self._count = count
        return self._still >= HUNG_BEATS
