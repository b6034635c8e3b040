"""Requests and offers of the control lease: permissions, answers and ends."""

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
    """Control lease and handover on a test clock; Ana holds the lease."""

    def __init__(self) -> None:
        self.now, self.log, self.stopped = 100.0, [], []  # type: float, list[str], list[str]
        self.control = ControlLease(EventBus(), self._lose, self._tell, lambda: self.now)
        self.people = ActiveUsers()
        self.hand_over = ControlHandover(self.control, self.people, self._tell, lambda: self.now)
        self.connections = {one.session: ExitStack() for one in (ANA, VERA, ODA, VIC)}
        for one in (ANA, VERA, ODA, VIC):
            self.connections[one.session].enter_context(self.people.connect(one, is_page=True))
        self.page, self.last_number = self.control.take(ANA, is_page=True).page_key, 0
        self.log.clear()

    def _tell(self, text: str, who: str) -> None:
        self.log.append(f"{who}: {text}")

    async def _lose(self, who: str) -> None:
        self.stopped.append(who)

    def stamp(self) -> CommandToken:
        self.last_number += 1
        return CommandToken(self.page, self.last_number)

    def ask(self, who: User, reason: str = "my turn") -> int:
        return self.hand_over.ask(who, reason).number

    def answer(self, who: User, number: int, answer: HandoverAnswer, reason: str = "", *, holds: bool = False) -> None:
        stamp = self.stamp() if holds else None
        asyncio.run(self.hand_over.answer(who, stamp, number, answer, reason))

    def offer(self, to: str, reason: str = "your turn") -> int:
        return asyncio.run(self.hand_over.offer(ANA, self.stamp(), to, reason)).number

    def take(self, who: User, number: int) -> LeaseHolder:
        holder = self.hand_over.take(who, number)
        self.page, self.last_number = holder.page_key, 0
        return holder

    def status_of(self, number: int) -> str | None:
        return next((str(one.standing) for one in self.hand_over.view() if one.number == number), None)

    def wait(self, seconds: float, *, is_alive: bool = True) -> None:
        async def poll() -> None:
            for _ in range(round(seconds / POLL_S)):
                self.now += POLL_S
                if is_alive and self.control.holder is not None:
                    self.control.record_ping(self.control.holder.user, self.page)
                await self.control.check()
                self.hand_over.update()

        asyncio.run(poll())

    @property
    def holder(self) -> str | None:
        return None if self.control.holder is None else self.control.holder.user.name


@pytest.fixture
def desk() -> Desk:
    return Desk()


def raises_rejection() -> pytest.RaisesExc[RequestRejectedError]:
    return pytest.raises(RequestRejectedError)


def test_an_accepted_request_transfers_the_control_lease_and_logs_each_step(desk: Desk) -> None:
    number = desk.ask(VERA, "  the λ sweep\nis mine ")
    (seen,) = desk.hand_over.view()
    assert (seen.name, seen.by, seen.reason, seen.standing) == ("Vera", "Ana", "the λ sweep is mine", "asked")
    with raises_rejection():
        desk.take(VERA, number)  # before the answer
    desk.answer(ANA, number, HandoverAnswer.HAND_OVER, "mind the wall", holds=True)
    assert desk.holder == "Ana"  # until Vera's page has taken it
    assert desk.hand_over.view()[0].answer == "mind the wall"
    with raises_rejection():
        desk.take(ODA, number)
    epoch = desk.take(VERA, number).epoch
    assert (desk.holder, desk.status_of(number), desk.stopped) == ("Vera", "taken", [])
    assert desk.hand_over.view()[0].epoch == epoch
    with raises_rejection():
        desk.take(VERA, number)  # a second page of hers
    assert desk.log == [
        "Vera: asked Ana for control: the λ sweep is mine",
        "Ana: handed control over to Vera: mind the wall",
        "Vera: control handed over by Ana: the λ sweep is mine",
    ]
    desk.wait(TOLD_S + 1.0)
    assert desk.hand_over.view() == []


@pytest.mark.parametrize("angles", AngleUnit)
def test_quantities_in_a_reason_are_not_converted(desk: Desk, angles: AngleUnit) -> None:
    reason, answer = "keep it below 1 rad and 3e-06 V, 2 rad/s", "30 deg is enough for me"
    number = desk.ask(VERA, reason)
    desk.answer(ANA, number, HandoverAnswer.HAND_OVER, answer, holds=True)
    desk.take(VERA, number)
    assert [format_text(text, angles) for text in desk.log] == [
        f"Vera: asked Ana for control: {reason}",
        f"Ana: handed control over to Vera: {answer}",
        f"Vera: control handed over by Ana: {reason}",
    ]


def test_declining_a_request_requires_a_reason_and_publishes_it(desk: Desk) -> None:
    number = desk.ask(VERA)
    with raises_rejection() as error:
        desk.answer(ANA, number, HandoverAnswer.DECLINE, " \u200b ", holds=True)
    assert (error.value.category, error.value.message.code) == (ErrorCode.BAD_VALUE, "reason_missing")
    desk.answer(ANA, number, HandoverAnswer.DECLINE, "ten minutes more", holds=True)
    (seen,) = desk.hand_over.view()
    assert (seen.standing, seen.answer, desk.holder) == ("declined", "ten minutes more", "Ana")
    assert desk.log[-1] == "Ana: declined the request of Vera for control: ten minutes more"
    with raises_rejection():
        desk.take(VERA, number)
    again = desk.ask(VERA)
    assert [one.number for one in desk.hand_over.view()] == [again]  # the new request replaces the answered one


def test_an_offer_transfers_the_control_lease_only_when_it_is_taken(desk: Desk) -> None:
    number = desk.offer("Vera", "lunch")
    assert (desk.holder, desk.status_of(number)) == ("Ana", "offered")
    desk.answer(VERA, number, HandoverAnswer.DECLINE, "mine too")
    assert (desk.holder, desk.status_of(number)) == ("Ana", "declined")
    number = desk.offer("Vera", "lunch")
    desk.take(VERA, number)
    assert desk.holder == "Vera"
    assert desk.log == [
        "Ana: offered control to Vera: lunch",
        "Vera: declined the control offered by Ana: mine too",
        "Ana: offered control to Vera: lunch",
        "Vera: control handed over by Ana: lunch",
    ]


@pytest.mark.parametrize("to", ["Ana", "Vic (viewer)", "Nobody"])
def test_control_can_be_offered_only_to_another_connected_operator(desk: Desk, to: str) -> None:
    with raises_rejection():
        desk.offer(to)
    assert (desk.log, desk.hand_over.view()) == ([], [])


def test_the_first_answer_counts_and_only_one_requester_gets_control(desk: Desk) -> None:
    vera, oda = desk.ask(VERA), desk.ask(ODA)
    desk.answer(ANA, vera, HandoverAnswer.HAND_OVER, holds=True)
    for number, answer in ((vera, HandoverAnswer.HAND_OVER), (oda, HandoverAnswer.HAND_OVER)):
        with raises_rejection():
            desk.answer(ANA, number, answer, "no", holds=True)
    desk.take(VERA, vera)
    desk.wait(1.0)
    (waiting,) = [one for one in desk.hand_over.view() if one.number == oda]
    assert (waiting.standing, waiting.by) == ("asked", "Vera")  # the request now addresses the new holder
    desk.answer(VERA, oda, HandoverAnswer.DECLINE, "just begun", holds=True)
    assert desk.holder == "Vera"


def test_the_second_of_two_concurrent_answers_is_rejected(desk: Desk) -> None:
    """Two buttons are pressed at the same time; the second command is too late."""
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
    assert (desk.status_of(number), desk.holder) == ("declined", "Ana")


def test_only_the_holder_of_the_control_lease_can_hand_it_over(desk: Desk) -> None:
    number = desk.ask(VERA)
    for who, stamp in (
        (ODA, None),
        (ODA, CommandToken("x" * 16, 1)),
        (ANA, None),
        (ANA, CommandToken("x" * 16, 1)),
        (SCRIPT, None),
    ):
        with raises_rejection():
            asyncio.run(desk.hand_over.answer(who, stamp, number, HandoverAnswer.HAND_OVER, ""))
    with raises_rejection():
        desk.answer(VERA, number, HandoverAnswer.HAND_OVER)
    assert (desk.status_of(number), desk.holder) == ("asked", "Ana")


def test_a_request_closes_when_its_requester_leaves_but_survives_a_page_reload(desk: Desk) -> None:
    number = desk.ask(VERA)
    desk.connections["v"].close()
    desk.wait(GONE_S - 1.0)
    with desk.people.connect(VERA, is_page=True):
        desk.wait(2.0)
        assert desk.status_of(number) == "asked"
    desk.wait(GONE_S + 1.0)
    assert desk.status_of(number) == "left"
    assert desk.log[-1] == ": Vera has left: the request for control is closed"


@pytest.mark.parametrize("how", ["given up", "lost", "script"])
def test_requests_and_accepted_handovers_close_when_the_control_lease_is_released(desk: Desk, how: str) -> None:
    waiting, handed = desk.ask(ODA), desk.ask(VERA)
    desk.answer(ANA, handed, HandoverAnswer.HAND_OVER, holds=True)
    if how == "lost":
        desk.wait(LOST_S + HOLD_S + 1.0, is_alive=False)
        assert desk.stopped == ["Ana"]  # her heartbeat was the one that was missing
    else:
        asyncio.run(desk.control.give_up(ANA, desk.stamp()))
    if how == "script":
        desk.control.take(SCRIPT, is_page=False)
    with raises_rejection():
        desk.take(VERA, handed)
    assert (desk.status_of(waiting), desk.status_of(handed)) == ("freed", "freed")


def test_an_accepted_handover_is_void_after_its_giver_loses_control(desk: Desk) -> None:
    number = desk.ask(VERA)
    desk.answer(ANA, number, HandoverAnswer.HAND_OVER, holds=True)
    desk.control.take(ODA, is_page=True, take_over=True)
    with raises_rejection():
        desk.take(VERA, number)
    assert (desk.holder, desk.status_of(number)) == ("Oda", "freed")
    assert desk.log[-1] == ": Ana no longer holds control"


def test_taking_control_over_withdraws_the_own_request(desk: Desk) -> None:
    number = desk.ask(VERA)
    desk.control.take(VERA, is_page=True, take_over=True)
    assert desk.status_of(number) == "withdrawn"


@pytest.mark.parametrize(("handed", "time_s"), [(False, ANSWER_S), (True, TAKE_S)])
def test_unanswered_requests_and_untaken_handovers_expire_with_a_log_entry(
    desk: Desk, handed: bool, time_s: float
) -> None:
    number = desk.ask(VERA)
    if handed:
        desk.answer(ANA, number, HandoverAnswer.HAND_OVER, holds=True)
    desk.wait(time_s - 1.0)
    assert desk.status_of(number) == ("handed" if handed else "asked")
    desk.wait(2.0)
    assert (desk.status_of(number), desk.holder) == ("lapsed", "Ana")
    assert f"in {time_s:.0f} s" in desk.log[-1]
    with raises_rejection():
        desk.take(VERA, number)


def test_requester_and_holder_can_withdraw(desk: Desk) -> None:
    desk.answer(VERA, waiting := desk.ask(VERA), HandoverAnswer.DECLINE)
    assert desk.status_of(waiting) == "withdrawn"
    handed = desk.ask(VERA)
    desk.answer(ANA, handed, HandoverAnswer.HAND_OVER, holds=True)
    desk.answer(ANA, handed, HandoverAnswer.DECLINE, holds=True)
    assert (desk.status_of(handed), desk.holder) == ("withdrawn", "Ana")
    with raises_rejection():
        desk.take(VERA, handed)


def test_rejected_requests_for_control_name_the_reason(desk: Desk) -> None:
    for who, code in ((ANA, "own_page_holds_control"), (SCRIPT, "session_without_page")):
        with refused(RequestRejectedError, code):
            desk.ask(who)
    desk.ask(VERA)
    with refused(RequestRejectedError, "handover_already_open", name="Vera"):
        desk.ask(VERA)
    desk.wait(LOST_S + 0.5, is_alive=False)
    with refused(RequestRejectedError, "control_is_free"):
        desk.ask(ODA)


def test_the_number_of_open_requests_is_limited(desk: Desk) -> None:
    with ExitStack() as connections:
        operators = [User(f"P{number}", Role.OPERATOR, f"p{number}") for number in range(WAITING + 1)]
        for one in operators:
            connections.enter_context(desk.people.connect(one, is_page=True))
        for one in operators[:-1]:
            desk.ask(one)
        with raises_rejection() as error:
            desk.ask(operators[-1])
    assert (error.value.category, error.value.message.code) == (ErrorCode.TOO_MANY, "too_many_requests")


def test_renaming_a_user_renames_their_request(desk: Desk) -> None:
    desk.ask(VERA)
    desk.people.rename(VERA, "Vera Lund")
    assert desk.hand_over.view()[0].name == "Vera Lund"
