"""What whoever drives the loop may count on, be the loop live in its own process or stepped headless in this one."""

import asyncio
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, TypeVar

from backend.loop.commands import Accepted, Command, Event, Refused
from backend.loop.pacer import Granted
from backend.loop.ring import Ring


@dataclass(frozen=True)
class LoopDied:
    """The loop process ended unasked; nothing controls the plant until it is started again."""

    reason: str


class LoopDiedError(Exception):
    """There is no loop to command, or it died while it was waited for; the message says why."""


_Result = TypeVar("_Result")


async def result_of(awaited: asyncio.Future[_Result], timeout_s: float) -> _Result:
    """Wait for a result. Raises TimeoutError only where there is none yet when this process gets to look.

    From Python 3.12 on ``asyncio.wait_for`` throws away a result that came while the event loop stood still for longer
    than the timeout; a loop process was killed for that although it had answered.
    """
    await asyncio.wait((awaited,), timeout=timeout_s)
    if not awaited.done():
        raise TimeoutError
    return awaited.result()


Listener = Callable[[Event | LoopDied], None]


class LoopAccess(Protocol):
    """Commands in, events and samples out. Not for several threads: all calls from one event loop."""

    @property
    def ring(self) -> Ring:
        """Samples of the loop that runs at present; another ring after a new start."""
        ...

    @property
    def granted(self) -> Granted | None:
        """What the machine granted to the loop; None while there is no loop, and for one that keeps to no clock."""
        ...

    def listen(self, listener: Listener) -> Callable[[], None]:
        """Call ``listener`` with each event from now on; return what to call to end that."""
        ...

    async def send(self, command: Command) -> Accepted | Refused:
        """Hand over a command and wait for the loop's answer. Raises LoopDiedError."""
        ...

    async def advance(self, seconds: float) -> None:
        """Let the loop tick for so many seconds of its own time. Raises LoopDiedError."""
        ...

    async def advance_until(self, reached: Callable[[], bool], timeout_s: float) -> None:
        """Let the loop tick until ``reached()``; raises TimeoutError after ``timeout_s`` of its time, LoopDiedError.

        Headless it is asked after every tick, live a few times per 0.1 s: ask for what lasts, not for a passing moment.
        """
        ...
