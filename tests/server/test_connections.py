"""Connections of the server: their places, turns, limits and waits."""

import asyncio
import logging
import time
from collections.abc import Coroutine, Iterator
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from backend.api.export import build_openapi_schema
from backend.auth.authentication import BEARER, User
from backend.logs import LINES_PER_WINDOW, WINDOW_S, RateLimit
from backend.schemas.session import Role
from backend.server import connections, security
from backend.server.connections import (
    BROWSER_SLOTS,
    BYTES_AT_ONCE,
    BYTES_PER_S,
    CONNECTION_SLOT,
    FRAMES_AT_ONCE,
    FRAMES_PER_S,
    LONGEST_WAIT_S,
    READ_TIMEOUT_S,
    SOCKET_COSTS,
    SOCKETS_AT_ONCE,
    SOCKETS_PER_S,
    STOP_PATH,
    Budget,
    ConnectionBudget,
    ConnectionLimiter,
    ConnectionSlot,
    ReadScheduler,
    RequestSchedulingMiddleware,
    WebsocketThrottle,
)
from backend.server.security import MAX_BODY_BYTES, SHEETS, HostOriginMiddleware, body_limit
from tests.api.conftest import PATIENCE_S
from tests.api.serving import served
from tests.api.sockets import connected, everything_from, is_closed, many, seconds_until_refused

# Who begins when many ask at once: STOP, then one of operators and one of the others in each round.

CROWD = 20


def asked(path: str, role: Role | None = None) -> Scope:
    slot = ConnectionSlot("127.0.0.1", lambda: None)
    slot.holder = User(role, role, BEARER) if role else None
    return {"type": "http", "path": path, "state": {CONNECTION_SLOT: slot}}


class Answers:
    """Notes which request began in which round of the event loop."""

    def __init__(self) -> None:
        self.begun: dict[str, int] = {}
        self.round = 0
        self.pace = RequestSchedulingMiddleware(self._answer)

    async def to_all(self, *scopes: Scope) -> None:
        """Be asked by all in one round; return when all are over."""
        asking = [asyncio.create_task(self.ask(scope)) for scope in scopes]
        while not all(task.done() for task in asking):
            self.round += 1
            await asyncio.sleep(0)

    async def ask(self, scope: Scope) -> None:
        await self.pace(scope, self._nothing, self._nowhere)

    async def _answer(self, scope: Scope, _receive: Receive, _send: Send) -> None:
        self.begun[scope["path"]] = self.round

    async def _nothing(self) -> dict[str, object]:
        return {}

    async def _nowhere(self, _message: object) -> None:
        return None


def test_what_passes_by_is_the_service_s_stop() -> None:
    assert "post" in build_openapi_schema()["paths"][STOP_PATH]


def test_stop_begins_at_once_whoever_waits() -> None:
    answers = Answers()
    crowd = [asked(f"/{n}", Role.VIEWER) for n in range(CROWD)]
    asyncio.run(answers.to_all(*crowd, asked(STOP_PATH, Role.VIEWER)))
    assert answers.begun[STOP_PATH] == answers.begun["/0"]
    rounds = [answers.begun[f"/{n}"] for n in range(CROWD)]
    assert rounds == sorted(set(rounds))  # one a round, in the order of their coming


def test_an_operator_does_not_wait_for_viewers_nor_for_strangers() -> None:
    answers = Answers()
    crowd = [asked(f"/{n}", Role.VIEWER if n % 2 else None) for n in range(CROWD)]
    asyncio.run(answers.to_all(*crowd, asked("/mode", Role.OPERATOR), asked("/reset", Role.OPERATOR)))
    assert answers.begun["/mode"] <= answers.begun["/1"]
    assert answers.begun["/mode"] < answers.begun["/reset"] <= answers.begun["/2"]


def test_one_who_leaves_while_waiting_holds_up_nobody() -> None:
    async def leaves(answers: Answers) -> None:
        asking = asyncio.create_task(answers.to_all(*(asked(f"/{n}") for n in range(CROWD))))
        await asyncio.sleep(0)
        leaving = asyncio.create_task(answers.ask(asked("/gone")))
        await asyncio.sleep(0)
        leaving.cancel()
        last = asyncio.create_task(answers.to_all(asked("/last")))
        await asyncio.gather(asking, last)

    answers = Answers()
    asyncio.run(leaves(answers))
    assert "/gone" not in answers.begun
    assert "/last" in answers.begun


def test_who_comes_alone_does_not_wait() -> None:
    answers = Answers()
    asyncio.run(answers.to_all(asked("/alone")))
    assert answers.begun == {"/alone": 1}


# Who gives way at the door, and what of a flood of lines reaches the log.

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


def test_who_is_recognized_stays(crowd: Crowd) -> None:
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
    assert "omitted" in written[-1]
    assert line(limit, 1, line_number=2) == "socket 1"
    assert line(limit, 1, error=OSError()) == "socket 1"
    now[0] = WINDOW_S
    assert line(limit, 1000) == f"socket 1000 [{1000 - LINES_PER_WINDOW} similar messages were omitted]"


# What connections send is parsed in turn, and a websocket that sends more than a page does is slowed and closed.


class Sender:
    """A connection with so many pieces; ``busy_s`` is what one takes of the loop's clock."""

    def __init__(self, name: str, pieces: int, told: list[str], clock: list[float], busy_s: float = 0.0) -> None:
        self.name, self.left, self.told, self.clock, self.busy_s = name, pieces, told, clock, busy_s
        self.ended = False

    def parse_piece(self) -> float | None:
        self.told.append(self.name)
        self.clock[0] += self.busy_s
        self.left -= 1
        return 0.0 if self.left else None

    def end(self) -> None:
        self.ended = True


def on_a_clock(work: Any) -> list[float]:
    """Run ``work(clock)`` on an event loop whose time also advances by the first entry of ``clock``."""
    clock = [0.0]

    async def run() -> None:
        loop = asyncio.get_running_loop()
        really = loop.time
        loop.time = lambda: really() + clock[0]  # type: ignore[method-assign]
        made: Coroutine[Any, Any, None] = work(clock)
        await made

    asyncio.run(run())
    return clock


def test_a_flood_and_one_request_take_turns() -> None:
    told: list[str] = []

    async def work(clock: list[float]) -> None:
        reading = ReadScheduler()
        flood, request = Sender("flood", 1000, told, clock, 0.001), Sender("stop", 1, told, clock)
        reading.add(flood)
        reading.add(request)
        for _ in range(2000):
            await asyncio.sleep(0)

    on_a_clock(work)
    assert told.count("flood") == 1000
    assert told.index("stop") <= 4  # behind one round of the flood, not behind all of it


def test_fifty_floods_leave_room_in_each_round_of_the_event_loop() -> None:
    told: list[str] = []
    rounds: list[int] = []

    async def work(clock: list[float]) -> None:
        reading = ReadScheduler()
        for number in range(50):
            reading.add(Sender(str(number), 20, told, clock, 0.001))
        while len(told) < 1000:
            before = len(told)
            await asyncio.sleep(0)
            rounds.append(len(told) - before)

    on_a_clock(work)
    assert max(rounds) <= 4  # 2 ms of pieces that take 1 ms
    # Each once before any twice, but for the first, which was alone in its first round.
    assert set(told[:53]) == {str(number) for number in range(50)}


def test_one_whose_bytes_cannot_be_parsed_is_closed_and_the_others_go_on() -> None:
    told: list[str] = []
    broken: list[Sender] = []

    async def work(clock: list[float]) -> None:
        reading = ReadScheduler()
        sender = Sender("broken", 5, told, clock)

        def fail() -> float | None:
            raise ValueError("no frame")

        sender.parse_piece = fail  # type: ignore[method-assign]
        broken.append(sender)
        reading.add(sender)
        reading.add(Sender("good", 3, told, clock))
        for _ in range(20):
            await asyncio.sleep(0)

    on_a_clock(work)
    assert broken[0].ended
    assert told == ["good"] * 3


@pytest.mark.parametrize("frames_per_s", [1.0, 20.0, 60.0])
def test_a_page_is_never_slowed(frames_per_s: float) -> None:
    """Pings once a second, references of a slider, the 3D view in a drag: for ten minutes."""
    budget = Budget(0.0)
    count = round(600.0 * frames_per_s)
    assert all(budget.spend(slot / frames_per_s, 1, 120) == 0.0 for slot in range(count))
    assert not budget.is_overdrawn(600.0)


@pytest.mark.parametrize(("frames", "size"), [(256, 512), (1, 65536)])
def test_a_flood_is_slowed_to_its_rate_and_then_closed(frames: int, size: int) -> None:
    budget, now, sent = Budget(0.0), 0.0, 0
    while not budget.is_overdrawn(now):
        now += budget.spend(now, frames, size) + 1e-6
        sent += 1
        assert sent < 10_000
    most_frames = FRAMES_AT_ONCE + FRAMES_PER_S * now + 2 * frames
    most_bytes = BYTES_AT_ONCE + BYTES_PER_S * now + 2 * size
    assert sent * frames <= most_frames
    assert sent * size <= most_bytes
    assert READ_TIMEOUT_S < now < 60.0


def test_a_burst_that_ends_is_forgiven() -> None:
    budget = Budget(0.0)
    assert budget.spend(0.0, int(FRAMES_AT_ONCE) + 100, 0) == pytest.approx(1.0)
    assert budget.spend(10.0, 1, 0) == 0.0
    assert not budget.is_overdrawn(100.0)


def test_a_session_opens_websockets_at_a_rate_and_slows_no_other() -> None:
    arrivals, now = WebsocketThrottle(), 100.0
    assert [arrivals.wait_s("vic", now) for _ in range(SOCKETS_AT_ONCE)] == [0.0] * SOCKETS_AT_ONCE
    assert arrivals.wait_s("vic", now) == pytest.approx(1.0 / SOCKETS_PER_S)
    assert arrivals.wait_s("ana", now) == 0.0
    waits = []
    while (wait := arrivals.wait_s("vic", now)) is not None:
        waits.append(wait)
    assert max(waits) <= LONGEST_WAIT_S
    assert len(waits) == LONGEST_WAIT_S * SOCKETS_PER_S - 1
    assert arrivals.wait_s("vic", now + 1.0) is not None
    assert arrivals.wait_s("vic", now + 1000.0) == 0.0


# Every wait of a connection ends: for a word, a head, a body, the rest of one, for its answer to be read.

SHORT_S = 0.2
HOST = b"Host: localhost\r\n"
LARGE = 64 * 1024 * 1024

app = FastAPI()


@app.get("/thing")
async def thing() -> str:
    return "here"


@app.get("/large")
async def large() -> Response:
    return Response(b"x" * LARGE)


@app.get("/guests")
async def count(request: Request) -> int:
    limiter: ConnectionLimiter = getattr(request.state, connections.CONNECTION_LIMITER)
    return limiter.anonymous


@app.post("/thing")
async def change(body: dict[str, int]) -> str:
    return "changed"


@app.post(STOP_PATH)
async def stop() -> str:
    return "stopped"


@app.post(SHEETS)
async def print_sheet(body: dict[str, int]) -> str:
    return "printed"


@pytest.fixture(scope="module")
def address() -> Iterator[tuple[str, int]]:
    with served(HostOriginMiddleware(app)) as address:
        yield address


@pytest.fixture
def short_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    """For those who are to be sent away; whoever is to stay has the whole time, as the machine may be busy."""
    monkeypatch.setattr(connections, "SILENCE_S", SHORT_S)
    for name in ("HEAD_S", "BODY_S", "REST_S"):
        monkeypatch.setattr(connections, name, SHORT_S)


@pytest.mark.usefixtures("short_waits")
@pytest.mark.parametrize(
    "said",
    [
        b"",
        b"GET /thing HTTP/1.1\r\nHo",
        b"POST /thing HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: 10\r\n" + HOST + b"\r\n{",
    ],
    ids=["a word", "a head", "a body"],
)
def test_who_does_not_go_on_is_sent_away(address: tuple[str, int], said: bytes) -> None:
    with connected(address, said) as slow:
        assert everything_from(slow) == b""


def test_a_sheet_has_as_much_longer_as_it_may_be_larger(
    address: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would not come over a slow link in the time of other bodies."""
    assert connections.body_s(SHEETS) / connections.body_s("/thing") == body_limit(SHEETS) / MAX_BODY_BYTES > 1.0
    # as much larger that its time does not end here
    monkeypatch.setattr(connections, "body_limit", lambda path: MAX_BODY_BYTES * (10_000 if path == SHEETS else 1))
    monkeypatch.setattr(connections, "BODY_S", SHORT_S)
    head = b" HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: 8\r\nConnection: close\r\n" + HOST + b"\r\n"
    with connected(address, b"POST " + SHEETS.encode() + head + b'{"a"') as sheet:
        with connected(address, b"POST /thing" + head + b'{"a"') as other:
            assert everything_from(other) == b""
        sheet.sendall(b": 1}")
        assert everything_from(sheet).endswith(b'"printed"')


@pytest.mark.usefixtures("short_waits")
def test_bytes_that_trickle_in_win_no_time(address: tuple[str, int]) -> None:
    with connected(address, b"GET /thing HTTP/1.1\r\n" + HOST) as slow:
        assert seconds_until_refused(slow, b"X: y\r\n", SHORT_S / 10) < 60.0


@pytest.mark.usefixtures("short_waits")
def test_a_body_that_nobody_waits_for_is_not_taken_for_ever(address: tuple[str, int]) -> None:
    with connected(address, b"POST /thing HTTP/1.1\r\nContent-Length: 300000000\r\n" + HOST + b"\r\n") as pushing:
        assert seconds_until_refused(pushing, b"x" * 1000, SHORT_S / 10) < 60.0


def test_an_answer_that_is_not_read_is_given_up(address: tuple[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "STALL_S", SHORT_S)
    with connected(address, b"GET /large HTTP/1.1\r\n" + HOST + b"\r\n") as deaf:
        while guests(address) > 1:
            time.sleep(SHORT_S)
        assert len(everything_from(deaf)) < LARGE


def guests(address: tuple[str, int]) -> int:
    """Return how many connections there are, this one included."""
    return int(httpx.get(f"http://localhost:{address[1]}/guests", timeout=PATIENCE_S).text)


def test_a_connection_is_kept_for_the_next_request(address: tuple[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "HEAD_S", SHORT_S)
    monkeypatch.setattr(connections, "ANONYMOUS_PAUSE_S", 60)
    with connected(address) as kept:
        for _ in range(3):
            kept.sendall(b"GET /thing HTTP/1.1\r\n" + HOST + b"\r\n")
            answer = b""
            while not answer.endswith(b'"here"'):
                piece = kept.recv(4096)
                assert piece, "closed"
                answer += piece
            time.sleep(1.5 * SHORT_S)
        assert not is_closed(kept)


@pytest.mark.parametrize("nonsense", [b"\x16\x03\x01\r\n\r\n", b"GET / HTTP/9\r\n\r\n", b"\x00" * 100 + b"\r\n\r\n"])
def test_what_is_no_http_is_answered_with_every_header(address: tuple[str, int], nonsense: bytes) -> None:
    with connected(address, nonsense) as stranger:
        answer = everything_from(stranger)
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert b"content-security-policy: default-src" in answer.lower()
    assert b"x-content-type-options: nosniff" in answer.lower()


def test_nonsense_behind_a_request_ends_the_connection(address: tuple[str, int]) -> None:
    with connected(address, b"GET /large HTTP/1.1\r\n" + HOST + b"\r\n\x00\x00\r\n\r\n") as stranger:
        assert everything_from(stranger).startswith(b"HTTP/1.1 200 ")


def test_a_head_that_is_too_long_is_refused_by_its_length(address: tuple[str, int]) -> None:
    lines = b"X: y\r\n" * (2 * security.LONGEST_HEAD // 6)
    with connected(address, b"GET /thing HTTP/1.1\r\n" + HOST + lines + b"\r\n") as stranger:
        assert everything_from(stranger).startswith(b"HTTP/1.1 431 ")


def test_a_long_body_comes_whole(address: tuple[str, int]) -> None:
    body = b'{"a": 1' + b" " * 5 * security.LONGEST_HEAD + b"}"
    answer = httpx.post(
        f"http://localhost:{address[1]}/thing", content=body, headers={"Content-Type": "application/json"}
    )
    assert answer.text == '"changed"'


def test_a_body_that_breaks_while_its_request_waits_is_answered_once(
    address: tuple[str, int], caplog: pytest.LogCaptureFixture
) -> None:
    head = b"POST /thing HTTP/1.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n" + HOST + b"\r\n"
    with connected(address, head + b"3\r\nabc\r\n\r\n") as stranger:
        answer = everything_from(stranger)
    assert answer.count(b"HTTP/1.1 ") == 1
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert guests(address) == 1  # answered after the other
    assert not [record for record in caplog.records if record.exc_info]


def test_an_eviction_spares_connections_whose_request_has_arrived(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "MAX_ANONYMOUS", 64)  # a pool that 150 connections replace twice
    with served(HostOriginMiddleware(app)) as address:
        for _ in range(20):
            request = b"GET /thing HTTP/1.1\r\nConnection: close\r\n" + HOST + b"\r\n"
            with connected(address, request) as client, many(address, 150):
                assert everything_from(client).endswith(b'"here"')


def test_an_eviction_spares_connections_whose_request_is_not_parsed_yet(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "MAX_ANONYMOUS", 64)
    monkeypatch.setattr(ReadScheduler, "add", lambda self, connection: None)
    with served(HostOriginMiddleware(app)) as address, connected(address, b"GET /thing HTTP/1.1\r\n") as client:
        time.sleep(SHORT_S)
        with many(address, 150) as others:
            assert everything_from(others[0]) == b""
            assert not is_closed(client)


@pytest.mark.parametrize("prefix", [b"", b"/rig"])
def test_stop_precedes_connections_that_wait_for_their_turn(
    prefix: bytes, address: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "HANDOVERS_PER_ROUND", 0)
    end = b" HTTP/1.1\r\nConnection: close\r\nContent-Length: 0\r\n" + HOST + b"\r\n"
    with connected(address, b"GET /thing" + end) as other:
        with connected(address, b"POST " + prefix + STOP_PATH.encode() + end) as client:
            answer = everything_from(client)
        assert answer.endswith(b'"stopped"') if not prefix else answer.startswith(b"HTTP/1.1 404 ")
        other.settimeout(SHORT_S)
        with pytest.raises(TimeoutError):
            other.recv(1)
        monkeypatch.undo()
        other.settimeout(PATIENCE_S)
        assert everything_from(other).endswith(b'"here"')


def test_a_client_has_time_to_send_while_200_others_connect(address: tuple[str, int]) -> None:
    with connected(address) as client, many(address, 200):
        client.sendall(b"GET /thing HTTP/1.1\r\nConnection: close\r\n" + HOST + b"\r\n")
        assert everything_from(client).endswith(b'"here"')
