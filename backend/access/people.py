"""Who somebody is to the others: names, and who has a page open. Names tell apart whoever is there at one time."""

import asyncio
import unicodedata
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime

from backend.errors import Because, RefusalError
from backend.messages.session import PersonView, Role

BEARER, OPEN = "bearer", "open"
"""The ``session`` of all who send a token with each request, and of all where no token is needed."""

LONGEST_NAME = 40


@dataclass(frozen=True)
class Person:
    """Someone who is signed in: ``name`` as others see it, ``called`` as they gave it.

    ``session`` tells two browsers of one name apart.
    """

    name: str
    role: Role
    session: str
    called: str = ""

    @property
    def is_nameless(self) -> bool:
        """Whether this browser's person has given no name yet; scripts go by their role."""
        return self.session not in (BEARER, OPEN) and self.called in ("", self.role)


@dataclass
class _There:
    person: Person
    is_page: bool
    since: datetime = field(default_factory=lambda: datetime.now(UTC))


class People:
    """Those who have a websocket open: pages, and the 3D views in them."""

    def __init__(self) -> None:
        self._there: dict[asyncio.Event, _There] = {}

    @contextmanager
    def attending(self, person: Person, *, is_page: bool) -> Iterator[asyncio.Event]:
        """Count a websocket among the open ones; the event is set when its session ends."""
        over = asyncio.Event()
        self._there[over] = _There(person, is_page)
        try:
            yield over
        finally:
            del self._there[over]

    def connected(self) -> Iterator[tuple[asyncio.Event, Person]]:
        """Yield each open websocket's end and person."""
        yield from [(over, there.person) for over, there in self._there.items()]

    def view(self) -> list[PersonView]:
        """Return who has how many pages open, and since when the first of them is, by name."""
        pages: dict[tuple[str, Role], list[datetime]] = {}
        for there in self._there.values():
            if there.is_page:
                pages.setdefault((there.person.name, there.person.role), []).append(there.since)
        return [
            PersonView(name=name, role=role, pages=len(since), since=min(since))
            for (name, role), since in sorted(pages.items())
        ]

    def has_page(self, session: str) -> bool:
        """Return whether somebody's page is open."""
        return any(there.is_page and there.person.session == session for there in self._there.values())

    def named(self, name: str) -> Person | None:
        """Return whose page is open under this name."""
        there = (one.person for one in self._there.values() if one.is_page)
        return next((person for person in there if person.name == name), None)

    def as_shown(self, person: Person) -> Person:
        """Return somebody who comes back under the name by which the others know them.

        It may be another than before: while they were away, somebody else may have come under theirs.
        """
        if person.session in (BEARER, OPEN):
            return person
        here = [there.person for there in self._there.values()]
        known = next((other for other in here if other.session == person.session), None)
        if known is not None:
            return known
        if all(other.name.casefold() != person.name.casefold() for other in here):
            return person
        return replace(person, name=self.shown(person.called, person.role, person.session))

    def shown(self, called: str, role: Role, session: str) -> str:
        """Return how others see who calls themselves so: nobody gets the name of somebody else who is there."""
        name = called or str(role)
        if role is Role.VIEWER and called not in ("", role):
            name = f"{called} ({role})"
        others = (person for _, person in self.connected() if person.session != session)
        taken, number, shown = {person.name.casefold() for person in others}, 1, name
        while shown.casefold() in taken:
            number += 1
            shown = f"{name} ({number})"
        return shown

    def rename(self, person: Person, name: str) -> Person:
        """Return ``person`` under another name, at all their pages. Raises RefusalError for a script, 422 for a name.

        The session stays what it is, so that control is kept.
        """
        if person.session in (BEARER, OPEN):
            raise RefusalError(Because.NOT_NOW, "a script goes by its role: only a browser that signed in has a name")
        called = printable(name)
        if called == "" or called.casefold() in set(Role):
            raise RefusalError(
                Because.BAD_VALUE, "a name needs a letter, and is no role: type what the others here call you"
            )
        renamed = replace(person, name=self.shown(called, person.role, person.session), called=called)
        for there in self._there.values():
            if there.person.session == person.session:
                there.person = renamed
        return renamed


def printable(name: str) -> str:
    """Return a name on one line, without the marks that tell persons apart, in whatever script they are written."""
    plain = " ".join(unicodedata.normalize("NFKC", name).split())
    return "".join(sign for sign in plain if sign.isprintable() and sign not in "()").strip()[:LONGEST_NAME]
