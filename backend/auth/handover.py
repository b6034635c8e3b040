"""Handover of control between operators: requests, offers and answers.

The holder keeps control until a page of the recipient takes it, so that control is never without a holder. A recipient
who asked takes it without a further question, and one to whom it is offered accepts first. No method yields to the
event loop while it changes a handover, so that the first of two answers counts.
"""

import asyncio
import itertools
import time
import unicodedata
from collections.abc import Callable
from dataclasses import dataclass

from backend.auth import messages
from backend.auth.authentication import ActiveUsers, User
from backend.auth.control_lease import CommandToken, ControlLease, LeaseHolder
from backend.errors import RequestRejectedError
from backend.schemas import OPEN_HANDOVERS, HandoverAnswer, HandoverStatus, HandoverView, Role
from backend.supervision import Part
from plant import (
    ErrorCode,
    escape_quantities,
)

HANDOVER_PART = Part("The monitor of requests for control", "Answer open requests, or send them again.")

ANSWER_S = 120.0
"""Time [s] that a request waits for the holder, and an offer for its recipient."""

TAKE_S = 20.0
"""Time [s] for the recipient to take control that was handed over; the page does it automatically."""

GONE_S = 5.0
"""Time [s] that the recipient may have no page open, to allow a reload."""

TOLD_S = 60.0
"""Time [s] that the result of a handover is shown."""

WAITING = 8
"""Handovers that may be open at one time."""

POLL_S = 0.25

_OPEN = frozenset(OPEN_HANDOVERS)


@dataclass
class _Handover:
    """One request or offer."""

    number: int
    recipient: User
    giver: User
    """The holder who answers the request, or has made the offer."""

    reason: str
    status: HandoverStatus
    expires: float
    answer: str = ""
    seen: float = 0.0
    """When the recipient had a page open for the last time."""

    is_offer: bool = False
    epoch: int | None = None
    """Number of the lease that the recipient has taken."""


class ControlHandover:
    """The handovers of one service."""

    def __init__(
        self,
        control: ControlLease,
        active_users: ActiveUsers,
        on_change: Callable[[str, str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Report changes to ``on_change``.

        It gets a text for the event log and the name of the user who has caused the change.
        """
        self._control = control
        self._active_users = active_users
        self._on_change = on_change
        self._clock = clock
        self._handovers: dict[int, _Handover] = {}
        # Numbers start with the time, so that a page from before a restart cannot answer another request.
        self._numbers = itertools.count(int(time.time()))

    def ask(self, user: User, reason: str) -> HandoverView:
        """Request control from its holder.

        Raises RequestRejectedError without a holder or after an open request.
        """
        self.update()
        holder = self._find_holder_to_ask(user)
        self._require_no_handover(user)
        return self._open(user, holder.user, HandoverStatus.ASKED, reason, f"asked {holder.user.name} for control")

    async def offer(self, user: User, command_token: CommandToken | None, to: str, reason: str) -> HandoverView:
        """Offer control to another operator with an open page.

        Raises RequestRejectedError for other users.
        """
        self._require_command_token(command_token)
        async with self._control.turn(user, command_token):
            self.update()
            other = self._active_users.find_by_name(to)
            if other is None or other.role is not Role.OPERATOR or other.session == user.session:
                raise RequestRejectedError(ErrorCode.BAD_VALUE, messages.recipient_not_connected(name=to))
            self._require_none_offered()
            self._require_no_handover(other)
            return self._open(other, user, HandoverStatus.OFFERED, reason, f"offered control to {other.name}")

    async def answer(
        self, user: User, command_token: CommandToken | None, number: int, answer: HandoverAnswer, reason: str
    ) -> None:
        """Answer or withdraw a request or an offer, as its recipient or as the holder.

        Raises RequestRejectedError.
        """
        self.update()
        handover = self._find_open(number)
        if handover.recipient.session == user.session:
            self._answer_as_recipient(handover, answer, reason)
            return
        self._require_command_token(command_token)
        async with self._control.turn(user, command_token):
            self.update()
            self._answer_as_holder(self._find_open(number), answer, reason)

    def take(self, user: User, number: int) -> LeaseHolder:
        """Take control that was handed over or offered.

        Raises RequestRejectedError if it is not, or no longer.
        """
        self.update()
        handover = self._find_open(number)
        if handover.recipient.session != user.session or handover.status is HandoverStatus.ASKED:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.control_not_handed_over())
        why = f": {escape_quantities(handover.reason)}" if handover.reason else ""
        holder = self._control.take(
            user, is_page=True, take_over=True, handed=f"control handed over by {self._get_name(handover.giver)}{why}"
        )
        handover.epoch = holder.epoch
        self._close(handover, HandoverStatus.TAKEN)
        return holder

    def view(self) -> list[HandoverView]:
        """Return open handovers, and recent ones with their result."""
        self.update()
        return [self._view(handover) for handover in self._handovers.values()]

    async def run(self) -> None:
        """Close handovers that have expired or whose recipient has left, until cancelled."""
        while True:
            await asyncio.sleep(POLL_S)
            self.update()

    def update(self) -> None:
        """Close handovers that cannot be answered any more.

        Drops results that were shown for TOLD_S.
        """
        now = self._clock()
        for handover in list(self._handovers.values()):
            if handover.status in _OPEN:
                self._update_open(handover, now)
            elif now > handover.expires:
                del self._handovers[handover.number]

    def _update_open(self, handover: _Handover, now: float) -> None:
        holder, name = self._control.holder, self._get_name(handover.recipient)
        if self._active_users.has_page(handover.recipient.session):
            handover.seen = now
        if holder is None or not holder.is_page:
            self._close(handover, HandoverStatus.FREED)
        elif holder.user.session == handover.recipient.session:
            self._close(handover, HandoverStatus.WITHDRAWN)  # taken over, which the lease has logged
        elif handover.status is HandoverStatus.ASKED and holder.user.session != handover.giver.session:
            handover.giver = holder.user  # the request now goes to the new holder
            self._on_change(f"{name}'s request for control is now addressed to {holder.user.name}", "")
        elif holder.user.session != handover.giver.session:
            text = f"{self._get_name(handover.giver)} no longer holds control"
            self._close(handover, HandoverStatus.FREED, text)
        elif now - handover.seen > GONE_S:
            self._close(handover, HandoverStatus.LEFT, f"{name} has left: the request for control is closed")
        elif now > handover.expires:
            text = {
                HandoverStatus.ASKED: f"{name}'s request for control was not answered within {ANSWER_S:.0f} s",
                HandoverStatus.OFFERED: f"{name} did not take the offered control within {ANSWER_S:.0f} s",
            }.get(handover.status, f"{name} did not take the control that was handed over within {TAKE_S:.0f} s")
            self._close(handover, HandoverStatus.LAPSED, text)

    def _answer_as_recipient(self, handover: _Handover, answer: HandoverAnswer, reason: str) -> None:
        name = self._get_name(handover.recipient)
        if answer is HandoverAnswer.HAND_OVER:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.only_holder_hands_over())
        if handover.status is not HandoverStatus.OFFERED:
            self._close(handover, HandoverStatus.WITHDRAWN, "withdrew the request for control", name)
            return
        text = _append_reason(f"declined the control offered by {self._get_name(handover.giver)}", reason)
        handover.answer = _to_one_line(reason)
        self._close(handover, HandoverStatus.DECLINED, text, name)

    def _answer_as_holder(self, handover: _Handover, answer: HandoverAnswer, reason: str) -> None:
        name, giver = self._get_name(handover.recipient), self._get_name(handover.giver)
        if handover.status is not HandoverStatus.ASKED:
            if answer is HandoverAnswer.HAND_OVER:
                raise RequestRejectedError(ErrorCode.NOT_NOW, messages.control_already_handed_over(recipient=name))
            text = f"withdrew the handover to {name}"
            self._close(handover, HandoverStatus.WITHDRAWN, text, giver)
        elif answer is HandoverAnswer.HAND_OVER:
            self._require_none_offered()
            handover.status, handover.expires = HandoverStatus.HANDED, self._clock() + TAKE_S
            handover.answer = _to_one_line(reason)
            self._on_change(_append_reason(f"handed control over to {name}", reason), giver)
        else:
            handover.answer = _require_reason(reason)
            text = _append_reason(f"declined the request of {name} for control", reason)
            self._close(handover, HandoverStatus.DECLINED, text, giver)

    def _open(self, recipient: User, giver: User, status: HandoverStatus, reason: str, text: str) -> HandoverView:
        if sum(handover.status in _OPEN for handover in self._handovers.values()) >= WAITING:
            raise RequestRejectedError(ErrorCode.TOO_MANY, messages.too_many_requests(maximum=WAITING))
        now = self._clock()
        handover = _Handover(
            number=next(self._numbers),
            recipient=recipient,
            giver=giver,
            reason=_require_reason(reason),
            status=status,
            expires=now + ANSWER_S,
            seen=now,
            is_offer=status is HandoverStatus.OFFERED,
        )
        # A new handover replaces the shown result of an earlier one.
        for number in [one.number for one in self._handovers.values() if one.recipient.session == recipient.session]:
            del self._handovers[number]
        self._handovers[handover.number] = handover
        self._on_change(_append_reason(text, reason), (giver if handover.is_offer else recipient).name)
        return self._view(handover)

    def _close(self, handover: _Handover, status: HandoverStatus, text: str = "", who: str = "") -> None:
        handover.status, handover.expires = status, self._clock() + TOLD_S
        if text:
            self._on_change(text, who)

    def _find_holder_to_ask(self, user: User) -> LeaseHolder:
        holder = self._control.holder
        if not self._active_users.has_page(user.session):
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.session_without_page())
        if holder is None or holder.is_lost:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.control_is_free())
        if not holder.is_page:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.script_holds_control())
        if holder.user.session == user.session:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.own_page_holds_control())
        return holder

    def _require_no_handover(self, user: User) -> None:
        """Raise RequestRejectedError if a handover to this user is open."""
        if any(one.status in _OPEN and one.recipient.session == user.session for one in self._handovers.values()):
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.handover_already_open(name=user.name))

    def _require_none_offered(self) -> None:
        for handover in self._handovers.values():
            if handover.status in (HandoverStatus.HANDED, HandoverStatus.OFFERED):
                name = self._get_name(handover.recipient)
                raise RequestRejectedError(ErrorCode.NOT_NOW, messages.handover_in_progress(recipient=name))

    def _require_command_token(self, command_token: CommandToken | None) -> None:
        if command_token is None:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.control_needed(), code="control_needed")

    def _find_open(self, number: int) -> _Handover:
        handover = self._handovers.get(number)
        if handover is None or handover.status not in _OPEN:
            raise RequestRejectedError(ErrorCode.NOT_NOW, messages.handover_closed(), code="wish_over")
        return handover

    def _get_name(self, user: User) -> str:
        return self._active_users.resolve_returning(user).name

    def _view(self, handover: _Handover) -> HandoverView:
        return HandoverView(
            number=handover.number,
            name=self._get_name(handover.recipient),
            by=self._get_name(handover.giver),
            reason=handover.reason,
            standing=handover.status,
            answer=handover.answer,
            offered=handover.is_offer,
            epoch=handover.epoch,
        )


def _to_one_line(text: str) -> str:
    normalized = " ".join(unicodedata.normalize("NFC", text).split())
    return "".join(char for char in normalized if char.isprintable())


def _require_reason(reason: str) -> str:
    """Return the reason on one line. Raises RequestRejectedError for an empty one."""
    line = _to_one_line(reason)
    if not line:
        raise RequestRejectedError(ErrorCode.BAD_VALUE, messages.reason_missing())
    return line


def _append_reason(text: str, reason: str) -> str:
    line = escape_quantities(_to_one_line(reason))
    return f"{text}: {line}" if line else text
