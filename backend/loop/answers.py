"""Commands on their way to the loop process, each waiting for its answer."""

import asyncio
from collections.abc import Iterator
from contextlib import contextmanager

from backend.loop.access import LoopDiedError
from backend.loop.commands import Accepted, Event, Refused

Answer = asyncio.Future[Accepted | Refused]


class Answers:
    """Numbers commands and hands each answer to whoever waits for it."""

    def __init__(self) -> None:
        self._waiting: dict[int, Answer] = {}
        self._sequence = 0

    @contextmanager
    def expected(self) -> Iterator[tuple[int, Answer]]:
        """Give a number and the answer that will come to it, for the block."""
        self._sequence += 1
        sequence = self._sequence
        answer: Answer = asyncio.get_running_loop().create_future()
        self._waiting[sequence] = answer
        try:
            yield sequence, answer
        finally:
            del self._waiting[sequence]

    def take(self, event: Event) -> None:
        """Hand on an event that is an answer."""
        if isinstance(event, Accepted | Refused):
            answer = self._waiting.get(event.sequence)
            if answer is not None and not answer.done():
                answer.set_result(event)

    def fail(self, died: LoopDiedError) -> None:
        """Tell all who wait that no answer will come."""
        for answer in self._waiting.values():
            if not answer.done():
                answer.set_exception(died)
