"""Places for work that people order: so many at a time, so many of each person, and some that viewers cannot take."""

from collections.abc import Iterator
from contextlib import contextmanager

from backend.access.people import Person
from backend.messages.session import Role
from backend.refusal import Because, RefusalError


class WorkPlaces:
    """``places`` in all, ``viewers`` of them for viewers, ``each`` for one person. Belongs to one event loop.

    ``work`` names one such work, and ``works`` several, in refusals.
    """

    def __init__(self, work: str, works: str, places: int, viewers: int, each: int) -> None:
        self._work, self._works = work, works
        self._places, self._viewers, self._each = places, viewers, each
        self._people: list[Person] = []

    @contextmanager
    def held(self, person: Person) -> Iterator[None]:
        """Hold a place for a person. Raises RefusalError where there is none."""
        self._require_place(person)
        self._people.append(person)
        try:
            yield
        finally:
            self._people.remove(person)

    def _require_place(self, person: Person) -> None:
        own = sum(other.name == person.name and other.role == person.role for other in self._people)
        if own >= self._each:
            number = f"{self._work} of yours is" if self._each == 1 else f"{own} {self._works} of yours are"
            raise RefusalError(
                Because.TOO_MANY,
                f"{number} under way or waiting, at most {self._each}: wait for one, or leave it",
                code="busy",
            )
        viewers = sum(not is_operator(other) for other in self._people)
        if len(self._people) >= self._places or (not is_operator(person) and viewers >= self._viewers):
            raise RefusalError(
                Because.TOO_MANY,
                f"{len(self._people)} {self._works} are under way or wait: try again later",
                code="busy",
            )


def is_operator(person: Person) -> bool:
    """Whether a person may do what operators may."""
    return person.role is Role.OPERATOR
