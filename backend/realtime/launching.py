"""Start of a loop process, which loads its modules while the service starts."""

import asyncio
import sys
from asyncio.subprocess import DEVNULL, Process
from contextlib import suppress

from backend.realtime.channel import Channel, channel_pair
from backend.realtime.ring_buffer import Ring
from plant import Card


class LoopProcess:
    """Loop process without a plant yet, with its shared memory; outputs untouched.

    Call ``take`` or ``discard``.
    """

    def __init__(self, process: Process, ring: Ring, card: Card, channel: Channel) -> None:
        self.process, self.ring, self.card, self.channel = process, ring, card, channel
        self._taken = False

    def take(self) -> "LoopProcess | None":
        """Take ownership; return None if it was taken before or the process has ended."""
        if self._taken or self.process.returncode is not None:
            return None
        self._taken = True
        return self

    async def discard(self) -> None:
        """End the process unless it was taken."""
        if not self._taken:
            self._taken = True
            self.channel.close()
            with suppress(ProcessLookupError):
                self.process.kill()
            await self.process.wait()


async def launch_loop(parameters: str) -> LoopProcess:
    """Start a loop process and prepare it for a plant with ``parameters``.

    The plant itself is selected later.
    """
    ring, card = Ring.create(), Card.create()
    channel, theirs = channel_pair()
    with theirs:
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-P",  # the working directory may contain a signal.py, or another package called backend
            *("-m", "backend.realtime.process", str(ring.fd), str(theirs.fileno()), str(card.fd), parameters),
            stdin=DEVNULL,
            pass_fds=(ring.fd, theirs.fileno(), card.fd),
        )
    return LoopProcess(process, ring, card, channel)
