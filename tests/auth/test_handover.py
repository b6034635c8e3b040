"""Asking for control and handing it over: who may say what, how each request ends; somebody always holds control."""

import asyncio
from contextlib import ExitStack

import pytest

from backend.auth.authentication import BEARER, ActiveUsers, User
from backend.auth.control_lease import HOLD_S, LOST_S, POLL_S, CommandToken, ControlLease, LeaseHolder
from backend.auth.handover import ANSWER_S, GONE_S, TAKE_S, TOLD_S, WAITING, ControlHandover
from backend.errors import RequestRejectedError
from backend.event_bus import EventBus
from backend.schemas.session import Role
from backend.schemas.state import HandoverAnswer
from backend.units import AngleUnit, format_text
from plant.errors import ErrorCode
from tests.refusals import refused

ANA, VERA, ODA = (User(name, Role.OPERATOR, name[0].lower(), name) for name in ("Ana", "Vera", "Oda"))
VIC = User("Vic (viewer)", Role.VIEWER, "vic", "Vic")
SCRIPT = User("operator", Role.OPERATOR, BEARER)


class Desk:
    """Control and what is asked of it, on a clock of the test; Ana holds it, and all have a page open."""

    def __init__(self) -> None:
        self.now, self.told, self.stopped = 100.0, [], []  # type: float, list[str], list[str]
        self.control = ControlLease(EventBus(), self._lose, self._tell, lambda: self.now)
        self.people = ActiveUsers()
        self.hand_over = ControlHandover(self.control, self.people, self._tell, lambda: self.now)
        self.there = {one.session: ExitStack() for one in (ANA, VERA, ODA, VIC)}
        for one in (ANA, VERA, ODA, VIC):
            self.there[one.session].enter_context(self.people.connect(one, is_page=True))
        self.page, self.said = self.control.take(ANA, is_page=True).page_key, 0
        self.told.clear()

    def _tell(self, text: str, who: str) -> None:
        self.told.append(f"{who}: {text}")

    async def _lose(self, who: str) -> None:
        self.stopped.append(who)

    def stamp(self) -> CommandToken:
        self.said += 1
        return CommandToken(self.page, self.said)

    def ask(self, who: User, reason: str = "my turn") -> int:
        return self.hand_over.ask(who, reason).number

    def answer(self, who: User, number: int, answer: HandoverAnswer, reason: str = "", *, holds: bool = False) -> None:
        stamp = self.stamp() if holds else None
        asyncio.run(self.hand_over.answer(who, stamp, number, answer, reason))

    def offer(self, to: str, reason: str = "your turn") -> int:
        return asyncio.run(self.hand_over.offer(ANA, self.stamp(), to, reason)).number

    def take(self, who: User, number: int) -> LeaseHolder:
        holder = self.hand_over.take(who, number)
        self.page, self.said = holder.page_key, 0
        return holder

    def standing(self, number: int) -> str | None:
        return next((str(one.standing) for one in self.hand_over.view() if one.number == number), None)

    def wait(self, seconds: float, *, heard: bool = True) -> None:
        async def look() -> None:
            for _ in range(round(seconds / POLL_S)):
                self.now += POLL_S
                if heard and self.control.holder is not None:
                    self.control.record_ping(self.control.holder.user, self.page)
                await self.control.check()
                self.hand_over.update()

        asyncio.run(look())

    @property
    def holder(self) -> str | None:
        return None if self.control.holder is None else self.control.holder.user.name


@pytest.fixture
def desk() -> Desk:
    return Desk()


def refusal() -> pytest.RaisesExc[RequestRejectedError]:
    return pytest.raises(RequestRejectedError)


def test_who_asks_gets_control_when_it_is_handed_over_and_all_of_it_is_told(desk: Desk) -> None:
    number = desk.ask(VERA, "  the λ sweep\nis mine ")
    (seen,) = desk.hand_over.view()
    assert (seen.name, seen.by, seen.reason, seen.standing) == ("Vera", "Ana", "the λ sweep is mine", "asked")
    with refusal():
        desk.take(VERA, number)  # before the answer
    desk.answer(ANA, number, HandoverAnswer.HAND_OVER, "mind the wall", holds=True)
    assert desk.holder == "Ana"  # until Vera's page has taken it
    assert desk.hand_over.view()[0].answer == "mind the wall"
    with refusal():
        desk.take(ODA, number)
    epoch = desk.take(VERA, number).epoch
    assert (desk.holder, desk.standing(number), desk.stopped) == ("Vera", "taken", [])
    assert desk.hand_over.view()[0].epoch == epoch
    with refusal():
        desk.take(VERA, number)  # a second page of hers
    assert desk.told == [
        "Vera: asked Ana for control: the λ sweep is mine",
        "Ana: handed control over to Vera: mind the wall",
        "Vera: control handed over by Ana: the λ sweep is mine",
    ]
    desk.wait(TOLD_S + 1.0)
    assert desk.hand_over.view() == []


@pytest.mark.parametrize("angles", AngleUnit)
def test_a_reason_with_numbers_and_units_is_displayed_as_it_was_written(desk: Desk, angles: AngleUnit) -> None:
    """In the log, for both units of angles: no number that a person has written is converted."""
    reason, answer = "keep it below 1 rad and 3e-06 V, 2 rad/s", "30 deg is enough for me"
    number = desk.ask(VERA, reason)
    desk.answer(ANA, number, HandoverAnswer.HAND_OVER, answer, holds=True)
    desk.take(VERA, number)
    assert [format_text(text, angles) for text in desk.told] == [
        f"Vera: asked Ana for control: {reason}",
        f"Ana: handed control over to Vera: {answer}",
        f"Vera: control handed over by Ana: {reason}",
    ]


def test_who_keeps_control_says_why_and_it_is_heard(desk: Desk) -> None:
    number = desk.ask(VERA)
    with refusal() as error:
        desk.answer(ANA, number, HandoverAnswer.DECLINE, " \u200b ", holds=True)
    assert (error.value.category, error.value.message.code) == (ErrorCode.BAD_VALUE, "reason_missing")
    desk.answer(ANA, number, HandoverAnswer.DECLINE, "ten minutes more", holds=True)
    (seen,) = desk.hand_over.view()
    assert (seen.standing, seen.answer, desk.holder) == ("declined", "ten minutes more", "Ana")
    assert desk.told[-1] == "Ana: declined the request of Vera for control: ten minutes more"
    with refusal():
        desk.take(VERA, number)
    again = desk.ask(VERA)
    assert [one.number for one in desk.hand_over.view()] == [again]  # the answer to the first is over with that


def test_an_offer_moves_control_only_when_the_other_takes_it(desk: Desk) -> None:
    number = desk.offer("Vera", "lunch")
    assert (desk.holder, desk.standing(number)) == ("Ana", "offered")
    desk.answer(VERA, number, HandoverAnswer.DECLINE, "mine too")
    assert (desk.holder, desk.standing(number)) == ("Ana", "declined")
    number = desk.offer("Vera", "lunch")
    desk.take(VERA, number)
    assert desk.holder == "Vera"
    assert desk.told == [
        "Ana: offered control to Vera: lunch",
        "Vera: declined the control offered by Ana: mine too",
        "Ana: offered control to Vera: lunch",
        "Vera: control handed over by Ana: lunch",
    ]


@pytest.mark.parametrize("to", ["Ana", "Vic (viewer)", "Nobody"])
def test_control_is_offered_only_to_another_operator_who_is_there(desk: Desk, to: str) -> None:
    with refusal():
        desk.offer(to)
    assert (desk.told, desk.hand_over.view()) == ([], [])


def test_of_two_answers_the_first_counts_and_of_two_askers_one_gets_it(desk: Desk) -> None:
    vera, oda = desk.ask(VERA), desk.ask(ODA)
    desk.answer(ANA, vera, HandoverAnswer.HAND_OVER, holds=True)
    for number, answer in ((vera, HandoverAnswer.HAND_OVER), (oda, HandoverAnswer.HAND_OVER)):
        with refusal():
            desk.answer(ANA, number, answer, "no", holds=True)
    desk.take(VERA, vera)
    desk.wait(1.0)
    (asked,) = [one for one in desk.hand_over.view() if one.number == oda]
    assert (asked.standing, asked.by) == ("asked", "Vera")  # it is she who is asked now
    desk.answer(VERA, oda, HandoverAnswer.DECLINE, "just begun", holds=True)
    assert desk.holder == "Vera"


def test_two_answers_at_one_time_are_one_answer(desk: Desk) -> None:
    """As two buttons pressed at once send them: both wait for their turn, the second finds the request answered."""
    number = desk.ask(VERA)

    async def both() -> tuple[BaseException | None, BaseException | None]:
        first, second = desk.stamp(), desk.stamp()
        return await asyncio.gather(
            desk.hand_over.answer(ANA, second, number, HandoverAnswer.HAND_OVER, ""),
            desk.hand_over.answer(ANA, first, number, HandoverAnswer.DECLINE, "no"),
            return_exceptions=True,
        )

    late, in_time = asyncio.run(both())
    assert in_time is None
    assert isinstance(late, RequestRejectedError)
    assert late.code == "wish_over"
    assert (desk.standing(number), desk.holder) == ("declined", "Ana")


def test_nothing_is_handed_over_by_who_does_not_hold_control(desk: Desk) -> None:
    number = desk.ask(VERA)
    for who, stamp in (
        (ODA, None),
        (ODA, CommandToken("x" * 16, 1)),
        (ANA, None),
        (ANA, CommandToken("x" * 16, 1)),
        (SCRIPT, None),
    ):
        with refusal():
            asyncio.run(desk.hand_over.answer(who, stamp, number, HandoverAnswer.HAND_OVER, ""))
    with refusal():
        desk.answer(VERA, number, HandoverAnswer.HAND_OVER)
    assert (desk.standing(number), desk.holder) == ("asked", "Ana")


def test_a_request_ends_with_whoever_asked_but_not_with_a_reload_of_their_page(desk: Desk) -> None:
    number = desk.ask(VERA)
    desk.there["v"].close()
    desk.wait(GONE_S - 1.0)
    with desk.people.connect(VERA, is_page=True):
        desk.wait(2.0)
        assert desk.standing(number) == "asked"
    desk.wait(GONE_S + 1.0)
    assert desk.standing(number) == "left"
    assert desk.told[-1] == ": Vera has left: the request for control is closed"


@pytest.mark.parametrize("how", ["given up", "lost", "script"])
def test_requests_end_when_control_is_free_and_what_was_handed_over_with_them(desk: Desk, how: str) -> None:
    asked, handed = desk.ask(ODA), desk.ask(VERA)
    desk.answer(ANA, handed, HandoverAnswer.HAND_OVER, holds=True)
    if how == "lost":
        desk.wait(LOST_S + HOLD_S + 1.0, heard=False)
        assert desk.stopped == ["Ana"]  # the one who was to be heard, up to the end
    else:
        asyncio.run(desk.control.give_up(ANA, desk.stamp()))
    if how == "script":
        desk.control.take(SCRIPT, is_page=False)
    with refusal():
        desk.take(VERA, handed)
    assert (desk.standing(asked), desk.standing(handed)) == ("freed", "freed")


def test_what_was_handed_over_by_who_has_lost_control_is_not_taken(desk: Desk) -> None:
    number = desk.ask(VERA)
    desk.answer(ANA, number, HandoverAnswer.HAND_OVER, holds=True)
    desk.control.take(ODA, is_page=True, take_over=True)
    with refusal():
        desk.take(VERA, number)
    assert (desk.holder, desk.standing(number)) == ("Oda", "freed")
    assert desk.told[-1] == ": Ana no longer holds control"


def test_who_takes_control_over_while_asking_asks_no_longer(desk: Desk) -> None:
    number = desk.ask(VERA)
    desk.control.take(VERA, is_page=True, take_over=True)
    assert desk.standing(number) == "withdrawn"


@pytest.mark.parametrize(("handed", "time_s"), [(False, ANSWER_S), (True, TAKE_S)])
def test_what_nobody_answers_ends_and_says_so(desk: Desk, handed: bool, time_s: float) -> None:
    number = desk.ask(VERA)
    if handed:
        desk.answer(ANA, number, HandoverAnswer.HAND_OVER, holds=True)
    desk.wait(time_s - 1.0)
    assert desk.standing(number) == ("handed" if handed else "asked")
    desk.wait(2.0)
    assert (desk.standing(number), desk.holder) == ("lapsed", "Ana")
    assert f"in {time_s:.0f} s" in desk.told[-1]
    with refusal():
        desk.take(VERA, number)


def test_both_may_take_back_what_they_have_said(desk: Desk) -> None:
    desk.answer(VERA, asked := desk.ask(VERA), HandoverAnswer.DECLINE)
    assert desk.standing(asked) == "withdrawn"
    handed = desk.ask(VERA)
    desk.answer(ANA, handed, HandoverAnswer.HAND_OVER, holds=True)
    desk.answer(ANA, handed, HandoverAnswer.DECLINE, holds=True)
    assert (desk.standing(handed), desk.holder) == ("withdrawn", "Ana")
    with refusal():
        desk.take(VERA, handed)


def test_who_cannot_ask_is_told_what_to_do(desk: Desk) -> None:
    for who, code in ((ANA, "own_page_holds_control"), (SCRIPT, "session_without_page")):
        with refused(RequestRejectedError, code):
            desk.ask(who)
    desk.ask(VERA)
    with refused(RequestRejectedError, "handover_already_open", name="Vera"):
        desk.ask(VERA)
    desk.wait(LOST_S + 0.5, heard=False)
    with refused(RequestRejectedError, "control_is_free"):
        desk.ask(ODA)


def test_only_so_many_may_wait(desk: Desk) -> None:
    with ExitStack() as there:
        crowd = [User(f"P{number}", Role.OPERATOR, f"p{number}") for number in range(WAITING + 1)]
        for one in crowd:
            there.enter_context(desk.people.connect(one, is_page=True))
        for one in crowd[:-1]:
            desk.ask(one)
        with refusal() as error:
            desk.ask(crowd[-1])
    assert (error.value.category, error.value.message.code) == (ErrorCode.TOO_MANY, "too_many_requests")


def test_a_new_name_stands_in_what_is_asked(desk: Desk) -> None:
    desk.ask(VERA)
    desk.people.rename(VERA, "Vera Lund")
    assert desk.hand_over.view()[0].name == "Vera Lund"
