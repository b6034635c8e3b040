"""Asking for control and handing it over: who wants it and why, and what whoever holds it says to that.

The holder keeps control, and is the one who is missed, until a page of the other has taken it: never does nobody hold
it. An operator who asked and is answered takes it without being asked again; one to whom it is offered says so first.
Everything here happens between two awaits of the event loop, so that of two answers the first counts.
"""

import asyncio
import itertools
import time
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass

from backend.auth.authentication import ActiveUsers, User
from backend.auth.control_lease import CommandToken, ControlLease, LeaseHolder
from backend.errors import RequestRejectedError
from backend.schemas import OPEN_WISHES, HandoverAnswer, HandoverStatus, Role, WishView
from backend.supervision import Part
from plant import ErrorCode

HANDOVER_PART = Part(
    "The watch over who asks for control", "Requests that were under way are answered or asked once more."
)

ANSWER_S = 120.0
"""So long [s] a request waits for the holder's answer, and an offer for whoever is to take it."""

TAKE_S = 20.0
"""So long [s] whoever asked has to take what was handed over: their page does it by itself."""

GONE_S = 5.0
"""So long [s] somebody may have no page open, who loads it again."""

TOLD_S = 60.0
"""So long [s] the end of a request is told."""

WAITING = 8
"""So many may wait at one time."""

LOOK_S = 0.25

_OPEN = frozenset(OPEN_WISHES)


@dataclass
class _Wish:
    """Control that is wanted by, or offered to, ``who``; ``by`` answers or has offered, ``until`` [s] it stands."""

    number: int
    who: User
    by: User
    reason: str
    standing: HandoverStatus
    until: float
    answer: str = ""
    here: float = 0.0
    offered: bool = False
    epoch: int | None = None


class ControlHandover:
    """What is asked and offered. ``told`` hears of it: a sentence, and who did it."""

    def __init__(
        self,
        control: ControlLease,
        people: ActiveUsers,
        told: Callable[[str, str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._control = control
        self._people = people
        self._told = told
        self._clock = clock
        self._wishes: dict[int, _Wish] = {}
        # Numbers go on after a restart of the service, so that a page of before speaks of none of these.
        self._numbers = itertools.count(int(time.time()))

    def ask(self, person: User, reason: str) -> WishView:
        """Ask whoever holds control for it.

        Raises RequestRejectedError where there is nobody to ask, or it was asked.
        """
        self.look()
        holder = self._holder_to_ask(person)
        self._require_free(person)
        return self._begin(
            person, holder.person, HandoverStatus.ASKED, reason, f"asked {holder.person.name} for control"
        )

    async def offer(self, person: User, stamp: CommandToken | None, to: str, reason: str) -> WishView:
        """Offer control to an operator who is there. Raises RequestRejectedError for who does not hold it."""
        self._require_stamp(stamp)
        async with self._control.turn(person, stamp):
            self.look()
            other = self._people.named(to)
            if other is None or other.role is not Role.OPERATOR or other.session == person.session:
                raise RequestRejectedError(
                    ErrorCode.BAD_VALUE, f"{to} is no other operator with a page open: choose one who is connected"
                )
            self._require_none_handed()
            self._require_free(other)
            return self._begin(other, person, HandoverStatus.OFFERED, reason, f"offered control to {other.name}")

    async def answer(
        self, person: User, stamp: CommandToken | None, number: int, answer: HandoverAnswer, reason: str
    ) -> None:
        """Say what becomes of a request or an offer, as one of its two persons. Raises RequestRejectedError."""
        self.look()
        wish = self._open(number)
        if wish.who.session == person.session:
            self._answer_of_other(wish, answer, reason)
            return
        self._require_stamp(stamp)
        async with self._control.turn(person, stamp):
            self.look()
            self._answer_of_holder(self._open(number), answer, reason)

    def take(self, person: User, number: int) -> LeaseHolder:
        """Take what was handed over or offered. Raises RequestRejectedError where it was not, or is not any more."""
        self.look()
        wish = self._open(number)
        if wish.who.session != person.session or wish.standing is HandoverStatus.ASKED:
            raise RequestRejectedError(ErrorCode.NOT_NOW, "control was not handed over to this page: nothing done")
        why = f": {wish.reason}" if wish.reason else ""
        holder = self._control.take(
            person, is_page=True, take_over=True, handed=f"control handed over by {self._name(wish.by)}{why}"
        )
        wish.epoch = holder.epoch
        self._end(wish, HandoverStatus.TAKEN)
        return holder

    def view(self) -> list[WishView]:
        """Return what is asked and offered, and for a while what became of it."""
        self.look()
        return [self._view(wish) for wish in self._wishes.values()]

    async def run(self) -> None:
        """Notice who has left and what nobody answers, until cancelled."""
        while True:
            await asyncio.sleep(LOOK_S)
            self.look()

    def look(self) -> None:
        """End what cannot be answered any more; forget what was told for long enough."""
        now = self._clock()
        for wish in list(self._wishes.values()):
            if wish.standing in _OPEN:
                self._look_at(wish, now)
            elif now > wish.until:
                del self._wishes[wish.number]

    def _look_at(self, wish: _Wish, now: float) -> None:
        holder, name = self._control.holder, self._name(wish.who)
        if self._people.has_page(wish.who.session):
            wish.here = now
        if holder is None or not holder.is_page:
            self._end(wish, HandoverStatus.FREED)
        elif holder.person.session == wish.who.session:
            self._end(wish, HandoverStatus.WITHDRAWN)  # taken over, which is told as such
        elif wish.standing is HandoverStatus.ASKED and holder.person.session != wish.by.session:
            wish.by = holder.person  # it is the new holder who is asked now
            self._told(f"{name}'s request for control is for {holder.person.name} now", "")
        elif holder.person.session != wish.by.session:
            self._end(wish, HandoverStatus.FREED, f"{self._name(wish.by)} does not hold control any more")
        elif now - wish.here > GONE_S:
            self._end(wish, HandoverStatus.LEFT, f"{name} has left: control is asked for no longer")
        elif now > wish.until:
            what = {
                HandoverStatus.ASKED: f"{name}'s request for control was not answered in {ANSWER_S:.0f} s",
                HandoverStatus.OFFERED: f"{name} did not take the control offered in {ANSWER_S:.0f} s",
            }.get(wish.standing, f"{name} did not take the control handed over in {TAKE_S:.0f} s")
            self._end(wish, HandoverStatus.LAPSED, what)

    def _answer_of_other(self, wish: _Wish, answer: HandoverAnswer, reason: str) -> None:
        if answer is HandoverAnswer.HAND_OVER:
            raise RequestRejectedError(ErrorCode.NOT_NOW, "whoever holds control hands it over: nothing done")
        if wish.standing is not HandoverStatus.OFFERED:
            self._end(wish, HandoverStatus.WITHDRAWN, "asks for control no longer", self._name(wish.who))
            return
        said = _sentence(f"did not take control from {self._name(wish.by)}", reason)
        wish.answer = _one_line(reason)
        self._end(wish, HandoverStatus.DECLINED, said, self._name(wish.who))

    def _answer_of_holder(self, wish: _Wish, answer: HandoverAnswer, reason: str) -> None:
        name, by = self._name(wish.who), self._name(wish.by)
        if wish.standing is not HandoverStatus.ASKED:
            if answer is HandoverAnswer.HAND_OVER:
                raise RequestRejectedError(
                    ErrorCode.NOT_NOW, f"control is being handed over to {name} already: nothing done"
                )
            self._end(wish, HandoverStatus.WITHDRAWN, f"does not hand control over to {name} after all", by)
        elif answer is HandoverAnswer.HAND_OVER:
            self._require_none_handed()
            wish.standing, wish.until = HandoverStatus.HANDED, self._clock() + TAKE_S
            wish.answer = _one_line(reason)
            self._told(_sentence(f"hands control over to {name}", reason), by)
        else:
            wish.answer = _required(reason)
            self._end(wish, HandoverStatus.DECLINED, _sentence(f"keeps control, asked by {name}", reason), by)

    def _begin(self, who: User, by: User, standing: HandoverStatus, reason: str, said: str) -> WishView:
        if sum(wish.standing in _OPEN for wish in self._wishes.values()) >= WAITING:
            raise RequestRejectedError(
                ErrorCode.TOO_MANY, f"{WAITING} requests for control wait already: try again later"
            )
        now = self._clock()
        wish = _Wish(
            number=next(self._numbers),
            who=who,
            by=by,
            reason=_required(reason),
            standing=standing,
            until=now + ANSWER_S,
            here=now,
        )
        wish.offered = standing is HandoverStatus.OFFERED
        for told in [one.number for one in self._wishes.values() if one.who.session == who.session]:
            del self._wishes[told]  # the end of an earlier one
        self._wishes[wish.number] = wish
        self._told(_sentence(said, reason), (who if standing is HandoverStatus.ASKED else by).name)
        return self._view(wish)

    def _end(self, wish: _Wish, standing: HandoverStatus, said: str = "", who: str = "") -> None:
        wish.standing, wish.until = standing, self._clock() + TOLD_S
        if said:
            self._told(said, who)

    def _holder_to_ask(self, person: User) -> LeaseHolder:
        holder = self._control.holder
        if not self._people.has_page(person.session):
            raise RequestRejectedError(ErrorCode.NOT_NOW, "control is asked for from a page that is open: nothing done")
        if holder is None or holder.lost:
            raise RequestRejectedError(ErrorCode.NOT_NOW, "nobody holds control who could be asked: take it")
        if not holder.is_page or holder.person.session == person.session:
            whose = "another page of yours" if holder.is_page else "a script"
            raise RequestRejectedError(ErrorCode.NOT_NOW, f"{whose} holds control: take it over")
        return holder

    def _require_free(self, person: User) -> None:
        """Raise RequestRejectedError where something is under way with this person."""
        if any(wish.standing in _OPEN and wish.who.session == person.session for wish in self._wishes.values()):
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, f"{person.name} has asked for control, or been offered it, already: answer that"
            )

    def _require_none_handed(self) -> None:
        for wish in self._wishes.values():
            if wish.standing in (HandoverStatus.HANDED, HandoverStatus.OFFERED):
                raise RequestRejectedError(
                    ErrorCode.NOT_NOW, f"control is being handed over to {self._name(wish.who)}: withdraw that first"
                )

    def _require_stamp(self, stamp: CommandToken | None) -> None:
        if stamp is None:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, "only the page that holds control can say that", code="control_needed"
            )

    def _open(self, number: int) -> _Wish:
        wish = self._wishes.get(number)
        if wish is None or wish.standing not in _OPEN:
            raise RequestRejectedError(
                ErrorCode.NOT_NOW, "this request for control is over: nothing done", code="wish_over"
            )
        return wish

    def _name(self, person: User) -> str:
        return self._people.as_shown(person).name

    def _view(self, wish: _Wish) -> WishView:
        return WishView(
            number=wish.number,
            name=self._name(wish.who),
            by=self._name(wish.by),
            reason=wish.reason,
            standing=wish.standing,
            answer=wish.answer,
            offered=wish.offered,
            epoch=wish.epoch,
        )


def _one_line(text: str) -> str:
    plain = " ".join(unicodedata.normalize("NFC", text).split())
    return "".join(sign for sign in plain if sign.isprintable())


def _required(reason: str) -> str:
    said = _one_line(reason)
    if not said:
        raise RequestRejectedError(ErrorCode.BAD_VALUE, "a reason is needed: say in a few words why")
    return said


def _sentence(what: str, reason: str) -> str:
    said = _one_line(reason)
    return f"{what}: {said}" if said else what
