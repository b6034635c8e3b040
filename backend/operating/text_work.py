"""What is computed for whoever asks, in processes of their own, within limits: texts that people write, and previews.

A text may be made to be slow, a preview holds Python's lock for up to half a second, and what holds it holds STOP up.
What viewers ask has another process than what operators do, so that nobody without the right to operate makes an
operator wait.
"""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Any, ParamSpec, TypeVar

from backend.auth.authentication import Person
from backend.departure import LOOK_S, HasLeft, unless_left
from backend.errors import Because, RefusalError
from backend.operating.work_places import WorkPlaces, is_operator
from backend.workers import Offload

P = ParamSpec("P")
T = TypeVar("T")

PLACES = 32
VIEWERS_PLACES = 24
PLACES_EACH = 8
"""Texts of one person under way or waiting: a browser sends six requests at a time."""

PREVIEWS = 32
VIEWERS_PREVIEWS = 24
PREVIEWS_EACH = 12
"""Previews of one person: a slider that moves asks for the next one before the last one is there."""


Compute = Callable[..., Awaitable[Any]]
"""Computes ``work(*asked)`` somewhere, as ``asyncio.to_thread`` does in a thread."""


class TextWork:
    """Belongs to the service's event loop."""

    def __init__(self, operators: Offload, viewers: Offload) -> None:
        self._operators, self._viewers = operators, viewers
        self.places = WorkPlaces("a text", "texts", PLACES, VIEWERS_PLACES, PLACES_EACH)
        self.previews = WorkPlaces("a preview", "previews", PREVIEWS, VIEWERS_PREVIEWS, PREVIEWS_EACH)
        self._turns = {operators: asyncio.Lock(), viewers: asyncio.Lock()}

    async def run(
        self, person: Person, has_left: HasLeft, work: Callable[P, T], *asked: P.args, **_none: P.kwargs
    ) -> T:
        """Return ``work(*asked)``, as long as the person who asked has not left.

        Raises what the work raises, WorkLimitError, and RefusalError where there is no place.
        """
        process = self._operators if is_operator(person) else self._viewers
        with self.places.held(person):
            return await unless_left(process.run(work, *asked, **_none), has_left)

    def previewing(self, person: Person, has_left: HasLeft) -> Compute:
        """Return what computes previews for a person.

        One whose asker has left before its turn is not computed; one that is under way ends, with its process kept.
        Raises what the work raises, WorkLimitError, and RefusalError where there is no place.
        """

        async def compute(work: Callable[..., T], *asked: Any) -> T:
            process = self._operators if is_operator(person) else self._viewers
            with self.previews.held(person):
                await _turn(self._turns[process], has_left)
                try:
                    return await process.run(work, *asked)
                finally:
                    self._turns[process].release()

        return compute

    async def order(self, work: Callable[P, T], *asked: P.args, **_none: P.kwargs) -> T:
        """Return ``work(*asked)`` for an order of an operator, which goes on whoever leaves. Raises as ``run`` does."""
        return await self._operators.run(work, *asked, **_none)


async def _turn(turn: asyncio.Lock, has_left: HasLeft) -> None:
    """Wait for a turn and take it. Raises RefusalError where whoever asked has left meanwhile."""
    waiting = asyncio.ensure_future(turn.acquire())
    try:
        while not (await asyncio.wait({waiting}, timeout=LOOK_S))[0]:
            if await has_left():
                raise RefusalError(Because.UNAVAILABLE, "whoever asked for this has left: it is not computed")
    except BaseException:
        if not waiting.cancel():  # it is there after all
            turn.release()
        raise
