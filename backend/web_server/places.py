"""Who is let in when there are more connections than places.

Each connection takes a place. Whoever has not shown yet who they are is a guest: guests have few places, and when those
are taken the oldest guest gives way to the newest. Whoever is signed in has a place of their own and is not sent away;
viewers together, and one person alone, get a part of these places only, so that some are always left for an operator.
"""

import ipaddress
import logging
import os
import resource
from collections.abc import Callable, Iterable
from dataclasses import dataclass

from backend.access.people import BEARER, OPEN, Person
from backend.messages.session import Role

WANTED_DESCRIPTORS = 8192
"""The limit of open descriptors is raised to this, or as far as the machine allows."""

LOW_DESCRIPTORS = 512
"""Below this limit there is room for few pages only; the log says so."""

RESERVE = 40
"""Descriptors kept for the database, the loop process, the pools, and connections on their way in or out."""

MOST_PLACES = 2048
GUESTS = 64
SOCKET_COSTS = 3
"""Places that a websocket takes: the 3D view needs three descriptors for each page."""

BROWSER_PLACES = 96
"""Most places of one browser session: a session is meant to be a person with a handful of tabs."""

_log = logging.getLogger(__name__)


class Place:
    """One connection. ``end`` closes it at once; ``is_answered`` tells whether it waits for its answer, not for words.

    Both change hands as the connection goes from the accepted socket to its protocol, which takes ``first_words`` over.
    """

    def __init__(self, address: str, end: Callable[[], None]) -> None:
        self.network = _network(address)
        self.end = end
        self.is_answered: Callable[[], bool] = lambda: False
        self.first_words = b""
        self.holder: Person | None = None
        self.costs = 0


@dataclass(frozen=True)
class Room:
    """How many places there are for guests and for those who are signed in."""

    guests: int
    known: int

    @classmethod
    def within(cls, limit: int, in_use: int) -> "Room":
        """Divide what a limit of descriptors leaves beside those in use and the reserve."""
        free = max(12, min(MOST_PLACES, limit - in_use - RESERVE))
        guests = min(GUESTS, free // 3)
        return cls(guests, free - guests)


class Places:
    """Keeps account of all places. Belongs to the event loop."""

    def __init__(self, room: Room) -> None:
        self.room = room
        self._guests: dict[str, dict[Place, None]] = {}
        self._known: set[Place] = set()

    @property
    def guests(self) -> int:
        """How many have not shown who they are."""
        return sum(len(crowd) for crowd in self._guests.values())

    @property
    def known(self) -> int:
        """How many places those who are signed in take."""
        return sum(place.costs for place in self._known)

    def enter(self, place: Place) -> None:
        """Let a guest in; another one gives way when all places for guests are taken."""
        if self.guests >= self.room.guests:
            self.make_room()
        self._guests.setdefault(place.network, {})[place] = None

    def make_room(self) -> bool:
        """Send one guest away, the oldest of a network, rather one that waits for no answer. False when there is none.

        A network with more than half of the places gives way first. Else somebody who has not asked for anything does,
        of the network with the most of these: many who ask from one address are not pushed out by an idle crowd.
        """
        going = self._who_gives_way()
        if going is None:
            return False
        self.leave(going)
        going.end()
        return True

    def _who_gives_way(self) -> Place | None:
        largest = max(self._guests.values(), key=len, default=None)
        if largest is None:
            return None
        crowds: Iterable[dict[Place, None]] = (
            [largest] if 2 * len(largest) > self.room.guests else self._guests.values()
        )
        silent = max(([place for place in crowd if not place.is_answered()] for crowd in crowds), key=len)
        return silent[0] if silent else next(iter(largest))

    def leave(self, place: Place) -> None:
        """Take back a place, whoever held it."""
        self._known.discard(place)
        crowd = self._guests.get(place.network, {})
        if place in crowd:
            del crowd[place]
            if not crowd:
                del self._guests[place.network]

    def recognise(self, place: Place, person: Person, *, is_socket: bool = False) -> bool:
        """Give a place of their own to someone who is signed in. False when the person's part is taken.

        They stay a guest then: their requests are answered all the same. A websocket, which stays, is to be refused.
        """
        costs = SOCKET_COSTS if is_socket else 1
        if place not in self._known and place not in self._guests.get(place.network, {}):
            return False  # gone meanwhile: whoever left does not come back to give a place back
        if place.costs >= costs:
            return True
        if self._taken() + costs > self.room.known or not self._has_part(person, costs):
            return False
        self.leave(place)
        place.holder, place.costs = person, costs
        self._known.add(place)
        return True

    def _has_part(self, person: Person, costs: int) -> bool:
        part = self.room.known // 2
        if person.role is Role.VIEWER and self._taken(role=Role.VIEWER) + costs > part:
            return False
        own = part if person.session in (BEARER, OPEN) else min(part, BROWSER_PLACES)
        return self._taken(session=person.session, role=person.role) + costs <= own

    def _taken(self, role: Role | None = None, session: str | None = None) -> int:
        return sum(
            place.costs
            for place in self._known
            if place.holder is not None
            and (role is None or place.holder.role is role)
            and (session is None or place.holder.session == session)
        )


def raise_limit() -> None:
    """Raise this process's limit of open descriptors as far as it may; say so where it stays low."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = WANTED_DESCRIPTORS if hard == resource.RLIM_INFINITY else min(hard, WANTED_DESCRIPTORS)
    if soft != resource.RLIM_INFINITY and soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
    if descriptor_limit() < LOW_DESCRIPTORS:
        _log.warning(
            "only %d open files are allowed (ulimit -n): there is room for few pages; allow at least %d",
            descriptor_limit(),
            LOW_DESCRIPTORS,
        )


def descriptor_limit() -> int:
    """Return how many descriptors this process may have open."""
    soft, _ = resource.getrlimit(resource.RLIMIT_NOFILE)
    return WANTED_DESCRIPTORS if soft == resource.RLIM_INFINITY else soft


def open_descriptors() -> int:
    """Return how many descriptors this process has open."""
    return len(os.listdir("/proc/self/fd"))


def _network(address: str) -> str:
    """Return what is counted as one address: of IPv6 the first 64 bits, which one machine has all to itself."""
    try:
        parsed = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return address
    if parsed.version == 4 or parsed.ipv4_mapped:
        return address
    return str(ipaddress.ip_network((int(parsed) >> 64 << 64, 64)))
