"""Who gives way at the door, and what of a flood of lines reaches the log."""

import logging

import pytest

from backend.auth.authentication import BEARER, User
from backend.logs import LINES_PER_WINDOW, WINDOW_S, RateLimit
from backend.schemas.session import Role
from backend.server.connections import BROWSER_SLOTS, SOCKET_COSTS, ConnectionBudget, ConnectionLimiter, ConnectionSlot

OPERATOR = User("operator", Role.OPERATOR, BEARER)
VIEWER = User("viewer", Role.VIEWER, BEARER)


class Crowd:
    """All slots, and the clients that were disconnected."""

    def __init__(self, room: ConnectionBudget) -> None:
        self.limiter = ConnectionLimiter(room)
        self.gone: list[str] = []

    def comes(self, name: str, address: str, is_answered: bool = False) -> ConnectionSlot:
        slot = ConnectionSlot(address, lambda: self.gone.append(name))
        slot.is_answered = lambda: is_answered
        self.limiter.enter(slot)
        return slot


@pytest.fixture
def crowd() -> Crowd:
    return Crowd(ConnectionBudget(anonymous=4, known=60))


def test_the_oldest_guest_gives_way(crowd: Crowd) -> None:
    for name in "abcdef":
        crowd.comes(name, "10.0.0.1")
    assert crowd.gone == ["a", "b"]
    assert crowd.limiter.anonymous == 4


def test_one_address_does_not_push_out_another(crowd: Crowd) -> None:
    crowd.comes("neighbour", "10.0.0.2")
    for name in "abcdefgh":
        crowd.comes(name, "10.0.0.1")
    assert crowd.gone == list("abcde")


def test_the_many_addresses_of_one_machine_count_as_one(crowd: Crowd) -> None:
    crowd.comes("neighbour", "2001:db8:0:2::1")
    for number in range(1, 9):
        crowd.comes(str(number), f"2001:db8:0:1::{number}")
    assert "neighbour" not in crowd.gone


def test_who_waits_for_an_answer_gives_way_last(crowd: Crowd) -> None:
    crowd.comes("answered", "10.0.0.1", is_answered=True)
    for name in "abcd":
        crowd.comes(name, "10.0.0.1")
    assert crowd.gone == ["a"]
    only_answered = Crowd(ConnectionBudget(anonymous=2, known=60))
    for name in "abc":
        only_answered.comes(name, "10.0.0.1", is_answered=True)
    assert only_answered.gone == ["a"]


def test_an_idle_crowd_of_many_addresses_does_not_push_out_who_asked(crowd: Crowd) -> None:
    for name in ("asked", "asked too"):
        crowd.comes(name, "10.0.0.1", is_answered=True)
    for number in range(2, 9):
        crowd.comes(str(number), f"10.0.0.{number}")
    assert crowd.gone == list("23456")


def test_who_is_recognised_stays(crowd: Crowd) -> None:
    assert crowd.limiter.authenticate(crowd.comes("operator", "10.0.0.1"), OPERATOR)
    for name in "abcdef":
        crowd.comes(name, "10.0.0.1")
    assert "operator" not in crowd.gone


def test_viewers_and_one_browser_have_a_part_only() -> None:
    crowd = Crowd(ConnectionBudget(anonymous=4, known=400))
    viewers = [User(f"viewer {number}", Role.VIEWER, str(number)) for number in range(10)]
    accepted = [
        viewer.session
        for viewer in viewers
        for number in range(50)
        if crowd.limiter.authenticate(crowd.comes(str(number), "10.0.0.1"), viewer, is_socket=True)
    ]
    assert accepted.count("0") == BROWSER_SLOTS // SOCKET_COSTS
    assert len(accepted) == 200 // SOCKET_COSTS
    assert crowd.limiter.authenticate(crowd.comes("operator", "10.0.0.1"), OPERATOR, is_socket=True)


def test_a_place_is_free_again_when_its_holder_leaves(crowd: Crowd) -> None:
    slot = crowd.comes("viewer", "10.0.0.1")
    assert crowd.limiter.authenticate(slot, VIEWER, is_socket=True)
    assert crowd.limiter.known == SOCKET_COSTS
    crowd.limiter.leave(slot)
    crowd.limiter.leave(slot)
    assert (crowd.limiter.known, crowd.limiter.anonymous) == (0, 0)
    assert not crowd.limiter.authenticate(slot, VIEWER)
    assert crowd.limiter.known == 0


@pytest.mark.parametrize(("limit", "in_use"), [(64, 60), (128, 40), (1024, 60), (8192, 60)])
def test_there_is_room_for_both_whatever_the_limit(limit: int, in_use: int) -> None:
    room = ConnectionBudget.within(limit, in_use)
    assert room.anonymous >= 4
    assert room.known >= 8


def line(limit: RateLimit, number: int, line_number: int = 1, error: BaseException | None = None) -> str | None:
    info = (type(error), error, None) if error else None
    record = logging.LogRecord("asyncio", logging.ERROR, "here.py", line_number, "socket %d", (number,), info)
    return record.getMessage() if limit.filter(record) else None


def test_of_one_kind_of_line_few_are_written() -> None:
    now = [0.0]
    limit = RateLimit(lambda: now[0])
    written = [text for number in range(1000) if (text := line(limit, number))]
    assert len(written) == LINES_PER_WINDOW
    assert "left out" in written[-1]
    assert line(limit, 1, line_number=2) == "socket 1"
    assert line(limit, 1, error=OSError()) == "socket 1"
    now[0] = WINDOW_S
    assert line(limit, 1000) == f"socket 1000 [{1000 - LINES_PER_WINDOW} more like this were left out]"
