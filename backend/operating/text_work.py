"""What is computed from texts that people write or bring in: in processes of their own, within limits.

A text may be made to be slow, and what holds Python's lock holds STOP up. Texts of viewers have another process than
those of operators, so that nobody without the right to operate makes an operator wait.
"""

from collections.abc import Callable
from typing import ParamSpec, TypeVar

from backend.access.people import Person
from backend.departure import HasLeft, unless_left
from backend.offload import Offload
from backend.operating.work_places import WorkPlaces, is_operator

P = ParamSpec("P")
T = TypeVar("T")

PLACES = 32
VIEWERS_PLACES = 24
PLACES_EACH = 8
"""Texts of one person under way or waiting: a browser sends six requests at a time."""


class TextWork:
    """Belongs to the service's event loop."""

    def __init__(self, operators: Offload, viewers: Offload) -> None:
        self._operators, self._viewers = operators, viewers
        self._places = WorkPlaces("a text", "texts", PLACES, VIEWERS_PLACES, PLACES_EACH)

    async def run(
        self, person: Person, has_left: HasLeft, work: Callable[P, T], *asked: P.args, **_none: P.kwargs
    ) -> T:
        """Return ``work(*asked)``, as long as the person who asked has not left.

        Raises what the work raises, WorkLimitError, and RefusalError where there is no place.
        """
        process = self._operators if is_operator(person) else self._viewers
        with self._places.held(person):
            return await unless_left(process.run(work, *asked, **_none), has_left)

    async def order(self, work: Callable[P, T], *asked: P.args, **_none: P.kwargs) -> T:
        """Return ``work(*asked)`` for an order of an operator, which goes on whoever leaves. Raises as ``run`` does."""
        return await self._operators.run(work, *asked, **_none)
