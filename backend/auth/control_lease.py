"""The control lease: one person at one page holds control; commands of a page act once each, in order."""

import asyncio
import re
import secrets
import time
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field
from typing import NamedTuple

from backend.auth.authentication import BEARER, OPEN, User
from backend.errors import RequestRejectedError
from backend.event_bus import EventBus
from backend.schemas import HolderView, Lease
from backend.supervision import Part
from plant import ErrorCode, InvariantError

# Command turns -------------------------------------------------------------------------------------
#
# Commands of one page, obeyed once each and in the order in which they were given.
#
# A browser sends over several connections, so that a command may arrive before the one that was
# given before it. It waits for that one: as long as a packet may be late, and until it has been
# answered. One that comes after its turn was given away is refused, since what it asks for is older
# than what is in force.


GAP_S = 0.3
"""So long [s] a command waits for one before it that has not arrived."""

BUSY_S = 1.0
"""So long [s] a command waits for the answer to the one before it."""

WAITING = 32
"""So many commands of a page may wait."""

_LOOK_S = 0.05


class CommandSequencer:
    """The order of one page's commands, which it numbers 1, 2, 3 ..."""

    def __init__(self) -> None:
        self._obeyed = 0
        self._busy_since: float | None = None
        self._waiting: set[int] = set()
        self._changed = asyncio.Condition()

    @asynccontextmanager
    async def turn(self, number: int) -> AsyncIterator[None]:
        """Hold the turn of a command for the block. Raises RequestRejectedError for an old one, 429 for too many."""
        if number <= self._obeyed or number in self._waiting:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                "this command is older than one that was obeyed already: nothing done",
                code="stale_command",
            )
        if len(self._waiting) >= WAITING:
            raise RequestRejectedError(
                ErrorCode.TOO_MANY,
                f"{WAITING} commands of this page wait already: nothing done",
                code="too_many_commands",
            )
        self._waiting.add(number)
        try:
            await self._wait(number)
        finally:
            self._waiting.discard(number)
        if number <= self._obeyed:
            raise InvariantError(f"command {number} got its turn after command {self._obeyed}")
        self._obeyed = number
        self._busy_since = begun = _now_s()
        try:
            yield
        finally:
            if self._busy_since == begun:
                self._busy_since = None
            async with self._changed:
                self._changed.notify_all()

    async def _wait(self, number: int) -> None:
        arrived_s = _now_s()
        async with self._changed:
            while not self._is_next(number, arrived_s):
                with suppress(TimeoutError):
                    async with asyncio.timeout(_LOOK_S):
                        await self._changed.wait()

    def _is_next(self, number: int, arrived_s: float) -> bool:
        now_s = _now_s()
        if number != min(self._waiting):
            return False
        if self._busy_since is not None and now_s - self._busy_since < BUSY_S:
            return False
        return number == self._obeyed + 1 or now_s - arrived_s >= GAP_S


def _now_s() -> float:
    return asyncio.get_running_loop().time()


# Control -------------------------------------------------------------------------------------------
#
# Who holds control: one named person at one page, until it is taken over, given up, or lost.
#
# A page takes control and gets a key that it keeps in its own memory, so that a copy of the page
# has none. Its commands carry the stamp "key.sequence": one with another key comes from a page that
# has lost control, one with a sequence that was used already is an old command on its way for the
# second time; both are refused. What is in order is obeyed in order, however it arrived
# (``turns``). A page that is loaded again shows the key it had and gets another one. Scripts, which
# send the bearer token, need no stamp while nobody else holds control. STOP asks for nothing of
# this.


HEADER = "Sinew-Control"

CONTROL_LEASE_PART = Part(
    "The watch over lost pages", "What moved was stopped softly: look into the service's log, take control, then reset."
)

LOST_S = 2.0
"""A page that says nothing for so long [s] is lost; it pings every second."""

HOLD_S = 2.0
"""So long [s] the references are held for a lost page to come back, before the soft stop."""

SCRIPT_S = 10.0
"""A script that commands nothing for so long [s] holds control no longer; nothing is stopped then."""

LOOK_S = 0.1
_LATE_LOOK_S = 2.0 * LOOK_S
_STAMP = re.compile(r"([A-Za-z0-9_-]{16})\.([0-9]{1,15})")


class CommandToken(NamedTuple):
    """What a page's command carries."""

    page: str
    sequence: int


@dataclass
class LeaseHolder:
    """Who holds control, at a page or by a script; ``page`` is the page's key, ``epoch`` what others know it by."""

    person: User
    epoch: int
    is_page: bool
    page: str = field(default_factory=lambda: secrets.token_urlsafe(12))
    turns: CommandSequencer = field(default_factory=CommandSequencer)
    silent_s: float = 0.0

    @property
    def lost(self) -> bool:
        """Whether the page is not heard any more."""
        return self.is_page and not self.silent_s <= LOST_S

    def is_at(self, person: User, page: str | None) -> bool:
        """Return whether this is the page that holds control."""
        if page is None or not self.is_page or person.session != self.person.session:
            return False
        return secrets.compare_digest(page.encode(), self.page.encode())

    def lease(self) -> Lease:
        """Return what the page is told."""
        return Lease(epoch=self.epoch, page=self.page, name=self.person.name)


def read_stamp(text: str | None) -> CommandToken | None:
    """Read the header, None where there is none. Raises RequestRejectedError."""
    if text is None:
        return None
    found = _STAMP.fullmatch(text)
    if found is None:
        raise RequestRejectedError(
            ErrorCode.MALFORMED, f"{HEADER} has to be the key of the page, a dot and a whole number", code="bad_stamp"
        )
    return CommandToken(found[1], int(found[2]))


@dataclass(frozen=True)
class ControlReleased:
    """Whoever held control does not hold it any more, or is not heard: what is held by hand ends."""


@dataclass(frozen=True)
class HolderChanged:
    """A page has given control up or is lost, or another person has taken it; not a page that is loaded again."""


class ControlLease:
    """The one lease. ``lost`` is called when the page that held it was not heard for LOST_S + HOLD_S.

    ``told`` hears what happens to control: a sentence, and who did it. Publishes ControlReleased and HolderChanged.
    """

    def __init__(
        self,
        events: EventBus,
        lost: Callable[[str], Awaitable[None]],
        told: Callable[[str, str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.holder: LeaseHolder | None = None
        self._last_session = ""
        self._events = events
        self._lost = lost
        self._told = told
        self._clock = clock
        self._looked = clock()
        # Epochs go on after a restart of the service, so that a page of before cannot act by chance.
        self._epoch = int(time.time())
        self._muted = False

    def take(self, person: User, *, is_page: bool, take_over: bool = False, handed: str = "") -> LeaseHolder:
        """Give control to a person. Raises RequestRejectedError while another one holds it, unless ``take_over``.

        ``handed`` is what is told where it was handed over.
        """
        holder = self.holder
        if holder is not None and not take_over and not holder.lost:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                f"{_whose(holder, person)} holds control: take it over to command",
                code="control_held",
            )
        self._epoch += 1
        self._muted = False
        self._events.publish(ControlReleased())
        if person.session != self._last_session:
            self._events.publish(HolderChanged())
        self._last_session = person.session
        self.holder = LeaseHolder(person, self._epoch, is_page)
        if is_page:
            taken = "control taken" if holder is None else f"control taken over from {holder.person.name}"
            self._told(handed or taken, person.name)
        return self.holder

    def resume(self, person: User, page: str) -> LeaseHolder:
        """Go on after a page was loaded again: its key is replaced.

        Raises RequestRejectedError where it has lost control.
        """
        self._holder_at(person, page)
        self._epoch += 1
        self._events.publish(ControlReleased())
        # What the page sent before it was loaded again and still waits carries a key that is gone.
        self.holder = LeaseHolder(person, self._epoch, is_page=True)
        return self.holder

    async def give_up(self, person: User, stamp: CommandToken | None) -> None:
        """Hold control no longer. Raises RequestRejectedError for those who do not hold it."""
        async with self.turn(person, stamp):
            self.holder = None
            self._events.publish(ControlReleased())
            self._events.publish(HolderChanged())
            self._told("control given up", person.name)

    @asynccontextmanager
    async def turn(self, person: User, stamp: CommandToken | None) -> AsyncIterator[None]:
        """Let a command of the holder pass when it is its turn. Raises RequestRejectedError for all others."""
        if stamp is None:
            self._require_script(person)
            yield
            return
        turns = self._holder_at(person, stamp.page).turns
        async with turns.turn(stamp.sequence):
            # Somebody may have taken over while this command waited.
            self._holder_at(person, stamp.page).silent_s = 0.0
            yield

    def heard(self, person: User, page: str | None) -> None:
        """Take note that a page is there; ``page`` is the key of the control it believes to hold."""
        holder = self.holder
        if holder is not None and not self._muted and holder.is_at(person, page):
            holder.silent_s = 0.0

    def rename(self, person: User) -> None:
        """Show the holder under the name that they have now."""
        if self.holder is not None and self.holder.person.session == person.session:
            self.holder.person = person

    def view(self) -> HolderView | None:
        """Return the holder as the page shows it."""
        holder = self.holder
        if holder is None:
            return None
        silent_s = holder.silent_s
        return HolderView(
            name=holder.person.name, epoch=holder.epoch, page=holder.is_page, silent_s=silent_s, lost=holder.lost
        )

    def mute(self) -> None:
        """Hear nothing more from the page that holds control: what its loss would be like."""
        self._muted = True

    async def run(self) -> None:
        """Watch over the holder until cancelled."""
        while True:
            await asyncio.sleep(LOOK_S)
            await self.look()

    async def look(self) -> None:
        """Count the holder's silence; end control when it lasted too long.

        Ends control and raises InvariantError where the lease is not consistent: the supervision of this watch then
        stops softly whatever moves, and starts the watch anew.
        """
        now = self._clock()
        try:
            if not now >= self._looked:
                raise InvariantError(f"the clock of the lease went from {self._looked} s to {now} s")
            self.require_consistent()
        except InvariantError:
            self._looked, self.holder = self._clock(), None
            self._events.publish(ControlReleased())
            self._events.publish(HolderChanged())
            raise
        # What was said while this process stood still waits in its sockets: that is not silence.
        passed_s, self._looked = min(now - self._looked, _LATE_LOOK_S), now
        holder = self.holder
        if holder is None:
            return
        was_lost = holder.lost
        holder.silent_s += passed_s
        if holder.lost and not was_lost:
            self._events.publish(ControlReleased())
            self._events.publish(HolderChanged())
        if holder.silent_s > (LOST_S + HOLD_S if holder.is_page else SCRIPT_S):
            self.holder = None
            self._events.publish(ControlReleased())
            if holder.is_page:
                await self._lost(holder.person.name)

    def require_consistent(self) -> None:
        """Raise InvariantError where holder and lease do not belong together, a silence of nan s among it."""
        holder = self.holder
        if holder is None:
            return
        if holder.epoch != self._epoch:
            raise InvariantError(f"a holder of epoch {holder.epoch} in a lease of epoch {self._epoch}")
        if not 0.0 <= holder.silent_s <= LOST_S + HOLD_S + SCRIPT_S:
            raise InvariantError(f"the holder of control is silent for {holder.silent_s} s")
        if holder.person.session != self._last_session:
            raise InvariantError("the holder of control has a session that did not take it")

    def _holder_at(self, person: User, page: str) -> LeaseHolder:
        self.require_consistent()
        holder = self.holder
        if holder is None:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, "nobody holds control: take it to command", code="control_lost"
            )
        if not holder.is_at(person, page):
            who = _whose(holder, person)
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                f"this page does not hold control any more, {who} does: nothing done",
                code="control_lost",
            )
        return holder

    def _require_script(self, person: User) -> None:
        holder = self.holder
        if person.session not in (BEARER, OPEN):
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                f"a page takes control first and stamps its commands ({HEADER})",
                code="control_needed",
            )
        self.require_consistent()
        if holder is None:
            holder = self.take(person, is_page=False)
        if holder.is_page or holder.person != person:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW,
                f"{_whose(holder, person)} holds control: take it over to command",
                code="control_held",
            )
        holder.silent_s = 0.0


def _whose(holder: LeaseHolder, asking: User) -> str:
    if holder.person.session == asking.session:
        return "another page of yours" if holder.is_page else "a script of yours"
    return holder.person.name
