"""Places for work that people order: so many at a time, so many of each person, and some that viewers cannot take."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from backend.auth.authentication import Person
from backend.errors import Because, RefusalError
from backend.schemas.state import Role

RETRY_S = 1
"""How long to wait before asking again where there was no place [s]."""

_held: ContextVar["WorkPlaces | None"] = ContextVar("held", default=None)
"""Where the request under way has had its place from its head on."""


class WorkPlaces:
    """``places`` in all, ``viewers`` of them for viewers, ``each`` for one person. Belongs to one event loop.

    ``work`` names one such work, and ``works`` several, in refusals. A request whose body is large takes its place
    before the body is read, and its work then has it.
    """

    def __init__(self, work: str, works: str, places: int, viewers: int, each: int) -> None:
        self._work, self._works = work, works
        self._places, self._viewers, self._each = places, viewers, each
        self._people: list[Person] = []

    @contextmanager
    def held(self, person: Person) -> Iterator[None]:
        """Hold a place for a person, that of the request under way where it has one. Raises RefusalError for none."""
        if _held.get() is self:
            yield
            return
        self._require_place(person)
        self._people.append(person)
        before = _held.set(self)
        try:
            yield
        finally:
            _held.reset(before)
            self._people.remove(person)

    def _require_place(self, person: Person) -> None:
        own = sum(other.name == person.name and other.role == person.role for other in self._people)
        if own >= self._each:
            number = f"{self._work} of yours is" if self._each == 1 else f"{own} {self._works} of yours are"
            raise RefusalError(
                Because.TOO_MANY,
                f"{number} under way or waiting, at most {self._each}: wait for one, or leave it",
                code="busy",
                retry_after_s=RETRY_S,
            )
        viewers = sum(not is_operator(other) for other in self._people)
        if len(self._people) >= self._places or (not is_operator(person) and viewers >= self._viewers):
            raise RefusalError(
                Because.TOO_MANY,
                f"{len(self._people)} {self._works} are under way or wait: try again later",
                code="busy",
                retry_after_s=RETRY_S,
            )


def is_operator(person: Person) -> bool:
    """Whether a person may do what operators may."""
    return person.role is Role.OPERATOR
