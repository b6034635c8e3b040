"""Who holds control: one named person at one page, until it is taken over, given up, or lost.

A page takes control and gets an epoch. Its commands carry the stamp "epoch.sequence": one of an earlier epoch comes
from a page that has lost control, one with a sequence that was used already is an old command on its way for the second
time; both are refused. Scripts, which send the bearer token, need no stamp while nobody else holds control. STOP asks
for nothing of this.
"""

import asyncio
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import NamedTuple

from backend.api.auth import BEARER, OPEN, Person
from backend.api.errors import ApiError
from backend.api.schemas.control import HolderView
from backend.supervision import Part

HEADER = "Sinew-Control"

PART = Part(
    "The watch over lost pages", "What moved was stopped softly: reset, take control, and look into the service's log."
)

LOST_S = 2.0
"""A page that says nothing for so long [s] is lost; it pings every second."""

HOLD_S = 2.0
"""So long [s] the references are held for a lost page to come back, before the soft stop."""

SCRIPT_S = 10.0
"""A script that commands nothing for so long [s] holds control no longer; nothing is stopped then."""

LOOK_S = 0.1
_LATE_LOOK_S = 2.0 * LOOK_S


class Stamp(NamedTuple):
    """What a page's command carries."""

    epoch: int
    sequence: int


@dataclass
class Holder:
    """Who holds control, at a page or by a script; ``sequence`` is the last command's, ``silent_s`` its age."""

    person: Person
    epoch: int
    is_page: bool
    sequence: int = 0
    silent_s: float = 0.0

    @property
    def lost(self) -> bool:
        """Whether the page is not heard any more."""
        return self.is_page and self.silent_s > LOST_S


def read_stamp(text: str | None) -> Stamp | None:
    """Read the header, None where there is none. Raises ApiError 400."""
    if text is None:
        return None
    epoch, _, sequence = text.partition(".")
    if not (epoch.isascii() and epoch.isdigit() and sequence.isascii() and sequence.isdigit() and len(text) <= 40):
        raise ApiError(400, f"{HEADER} has to be epoch.sequence, two whole numbers", code="bad_stamp")
    return Stamp(int(epoch), int(sequence))


class Control:
    """The one lease. ``lost`` is called when the page that held it was not heard for LOST_S + HOLD_S.

    ``told`` hears what happens to control: a sentence, and who did it.
    """

    def __init__(
        self,
        lost: Callable[[str], Awaitable[None]],
        told: Callable[[str, str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.holder: Holder | None = None
        self._lost = lost
        self._told = told
        self._clock = clock
        self._looked = clock()
        # Epochs go on after a restart of the service, so that a page of before cannot act by chance.
        self._epoch = int(time.time())
        self._muted = False

    def take(self, person: Person, *, is_page: bool, take_over: bool = False) -> Holder:
        """Give control to a person. Raises ApiError 409 while another one holds it, unless ``take_over``."""
        holder = self.holder
        if holder is not None and not take_over and not holder.lost:
            raise ApiError(409, f"{_whose(holder, person)} holds control: take it over to command", code="control_held")
        self._epoch += 1
        self._muted = False
        self.holder = Holder(person, self._epoch, is_page)
        if is_page:
            self._told(
                "control taken" if holder is None else f"control taken over from {holder.person.name}", person.name
            )
        return self.holder

    def give_up(self, person: Person, stamp: Stamp | None) -> None:
        """Hold control no longer. Raises ApiError 409 for those who do not hold it."""
        self.require(person, stamp)
        self.holder = None
        self._told("control given up", person.name)

    def require(self, person: Person, stamp: Stamp | None) -> None:
        """Let a command of the holder pass. Raises ApiError 409 for all others."""
        holder = self.holder
        if stamp is None:
            self._require_script(person, holder)
            return
        if holder is None:
            raise ApiError(409, "nobody holds control: take it to command", code="control_lost")
        if holder.epoch != stamp.epoch or holder.person.session != person.session:
            who = _whose(holder, person)
            raise ApiError(
                409, f"this page does not hold control any more, {who} does: nothing done", code="control_lost"
            )
        if stamp.sequence <= holder.sequence:
            raise ApiError(
                409, "this command is older than one that was obeyed already: nothing done", code="stale_command"
            )
        holder.sequence = stamp.sequence
        holder.silent_s = 0.0

    def heard(self, person: Person, epoch: int | None) -> None:
        """Take note that a page is there; ``epoch`` is that of the control it believes to hold."""
        holder = self.holder
        if holder is not None and not self._muted and epoch == holder.epoch and holder.person.session == person.session:
            holder.silent_s = 0.0

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
        """Count the holder's silence; end control when it lasted too long."""
        now = self._clock()
        # What was said while this process stood still waits in its sockets: that is not silence.
        passed_s, self._looked = min(now - self._looked, _LATE_LOOK_S), now
        holder = self.holder
        if holder is None:
            return
        holder.silent_s += passed_s
        if holder.silent_s > (LOST_S + HOLD_S if holder.is_page else SCRIPT_S):
            self.holder = None
            if holder.is_page:
                await self._lost(holder.person.name)

    def _require_script(self, person: Person, holder: Holder | None) -> None:
        if person.session not in (BEARER, OPEN):
            raise ApiError(409, f"a page takes control first and stamps its commands ({HEADER})", code="control_needed")
        if holder is None:
            holder = self.take(person, is_page=False)
        if holder.is_page or holder.person != person:
            raise ApiError(409, f"{_whose(holder, person)} holds control: take it over to command", code="control_held")
        holder.silent_s = 0.0


def _whose(holder: Holder, asking: Person) -> str:
    if holder.person.session == asking.session:
        return "another page of yours" if holder.is_page else "a script of yours"
    return holder.person.name
