"""Connections of the server: slots, scheduling, limits and timeouts."""

import asyncio
import logging
import socket
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
    ConnectionAcceptor,
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

# Order of concurrent requests: STOP, then one of an operator and one of the others in each round.

REQUESTS = 20


def build_scope(path: str, role: Role | None = None) -> Scope:
    slot = ConnectionSlot("127.0.0.1", lambda: None)
    slot.holder = User(role, role, BEARER) if role else None
    return {"type": "http", "path": path, "state": {CONNECTION_SLOT: slot}}


class RoundRecorder:
    """Records in which round of the event loop each request starts."""

    def __init__(self) -> None:
        self.started: dict[str, int] = {}
        self.round = 0
        self.scheduling = RequestSchedulingMiddleware(self._answer)

    async def send_all(self, *scopes: Scope) -> None:
        """Send all requests in one round and wait until all are answered."""
        asking = [asyncio.create_task(self.send_request(scope)) for scope in scopes]
        while not all(task.done() for task in asking):
            self.round += 1
            await asyncio.sleep(0)

    async def send_request(self, scope: Scope) -> None:
        await self.scheduling(scope, self._receive_nothing, self._discard)

    async def _answer(self, scope: Scope, _receive: Receive, _send: Send) -> None:
        self.started[scope["path"]] = self.round

    async def _receive_nothing(self) -> dict[str, object]:
        return {}

    async def _discard(self, _message: object) -> None:
        return None


def test_the_prioritized_path_is_the_stop_route() -> None:
    assert "post" in build_openapi_schema()["paths"][STOP_PATH]


def test_stop_starts_before_waiting_requests() -> None:
    recorder = RoundRecorder()
    waiting = [build_scope(f"/{n}", Role.VIEWER) for n in range(REQUESTS)]
    asyncio.run(recorder.send_all(*waiting, build_scope(STOP_PATH, Role.VIEWER)))
    assert recorder.started[STOP_PATH] == recorder.started["/0"]
    rounds = [recorder.started[f"/{n}"] for n in range(REQUESTS)]
    assert rounds == sorted(set(rounds))  # one per round, in the order of arrival


def test_operator_requests_start_before_requests_of_viewers_and_anonymous_clients() -> None:
    recorder = RoundRecorder()
    waiting = [build_scope(f"/{n}", Role.VIEWER if n % 2 else None) for n in range(REQUESTS)]
    asyncio.run(recorder.send_all(*waiting, build_scope("/mode", Role.OPERATOR), build_scope("/reset", Role.OPERATOR)))
    assert recorder.started["/mode"] <= recorder.started["/1"]
    assert recorder.started["/mode"] < recorder.started["/reset"] <= recorder.started["/2"]


def test_a_cancelled_request_does_not_delay_others() -> None:
    async def cancel_one(recorder: RoundRecorder) -> None:
        asking = asyncio.create_task(recorder.send_all(*(build_scope(f"/{n}") for n in range(REQUESTS))))
        await asyncio.sleep(0)
        leaving = asyncio.create_task(recorder.send_request(build_scope("/gone")))
        await asyncio.sleep(0)
        leaving.cancel()
        last = asyncio.create_task(recorder.send_all(build_scope("/last")))
        await asyncio.gather(asking, last)

    recorder = RoundRecorder()
    asyncio.run(cancel_one(recorder))
    assert "/gone" not in recorder.started
    assert "/last" in recorder.started


def test_a_single_request_starts_immediately() -> None:
    recorder = RoundRecorder()
    asyncio.run(recorder.send_all(build_scope("/alone")))
    assert recorder.started == {"/alone": 1}


# Eviction of anonymous connections, and the rate limit of log messages.

OPERATOR = User("operator", Role.OPERATOR, BEARER)
VIEWER = User("viewer", Role.VIEWER, BEARER)


class Clients:
    """All slots, and the names of the clients that were evicted."""

    def __init__(self, room: ConnectionBudget) -> None:
        self.limiter = ConnectionLimiter(room)
        self.evicted: list[str] = []

    def connect(self, name: str, address: str, is_answered: bool = False) -> ConnectionSlot:
        slot = ConnectionSlot(address, lambda: self.evicted.append(name))
        slot.is_answered = lambda: is_answered
        self.limiter.enter(slot)
        return slot


@pytest.fixture
def clients() -> Clients:
    return Clients(ConnectionBudget(anonymous=4, known=60))


def test_the_oldest_anonymous_connection_is_evicted_first(clients: Clients) -> None:
    for name in "abcdef":
        clients.connect(name, "10.0.0.1")
    assert clients.evicted == ["a", "b"]
    assert clients.limiter.anonymous == 4


def test_many_connections_of_one_address_do_not_evict_other_addresses(clients: Clients) -> None:
    clients.connect("neighbour", "10.0.0.2")
    for name in "abcdefgh":
        clients.connect(name, "10.0.0.1")
    assert clients.evicted == list("abcde")


def test_ipv6_addresses_of_one_network_count_as_one_address(clients: Clients) -> None:
    clients.connect("neighbour", "2001:db8:0:2::1")
    for number in range(1, 9):
        clients.connect(str(number), f"2001:db8:0:1::{number}")
    assert "neighbour" not in clients.evicted


def test_connections_with_a_request_in_progress_are_evicted_last(clients: Clients) -> None:
    clients.connect("answered", "10.0.0.1", is_answered=True)
    for name in "abcd":
        clients.connect(name, "10.0.0.1")
    assert clients.evicted == ["a"]
    only_answered = Clients(ConnectionBudget(anonymous=2, known=60))
    for name in "abc":
        only_answered.connect(name, "10.0.0.1", is_answered=True)
    assert only_answered.evicted == ["a"]


def test_idle_connections_of_many_addresses_do_not_evict_active_ones(clients: Clients) -> None:
    for name in ("asked", "asked too"):
        clients.connect(name, "10.0.0.1", is_answered=True)
    for number in range(2, 9):
        clients.connect(str(number), f"10.0.0.{number}")
    assert clients.evicted == list("23456")


def test_authenticated_connections_are_never_evicted(clients: Clients) -> None:
    assert clients.limiter.authenticate(clients.connect("operator", "10.0.0.1"), OPERATOR)
    for name in "abcdef":
        clients.connect(name, "10.0.0.1")
    assert "operator" not in clients.evicted


def test_connections_of_viewers_and_of_one_browser_are_limited() -> None:
    clients = Clients(ConnectionBudget(anonymous=4, known=400))
    viewers = [User(f"viewer {number}", Role.VIEWER, str(number)) for number in range(10)]
    accepted = [
        viewer.session
        for viewer in viewers
        for number in range(50)
        if clients.limiter.authenticate(clients.connect(str(number), "10.0.0.1"), viewer, is_socket=True)
    ]
    assert accepted.count("0") == BROWSER_SLOTS // SOCKET_COSTS
    assert len(accepted) == 200 // SOCKET_COSTS
    assert clients.limiter.authenticate(clients.connect("operator", "10.0.0.1"), OPERATOR, is_socket=True)


def test_a_closed_connection_frees_its_slot_once(clients: Clients) -> None:
    slot = clients.connect("viewer", "10.0.0.1")
    assert clients.limiter.authenticate(slot, VIEWER, is_socket=True)
    assert clients.limiter.known == SOCKET_COSTS
    clients.limiter.leave(slot)
    clients.limiter.leave(slot)
    assert (clients.limiter.known, clients.limiter.anonymous) == (0, 0)
    assert not clients.limiter.authenticate(slot, VIEWER)
    assert clients.limiter.known == 0


@pytest.mark.parametrize(("limit", "in_use"), [(64, 60), (128, 40), (1024, 60), (8192, 60)])
def test_every_descriptor_limit_leaves_anonymous_and_known_slots(limit: int, in_use: int) -> None:
    room = ConnectionBudget.within(limit, in_use)
    assert room.anonymous >= 4
    assert room.known >= 8


def line(limit: RateLimit, number: int, line_number: int = 1, error: BaseException | None = None) -> str | None:
    info = (type(error), error, None) if error else None
    record = logging.LogRecord("asyncio", logging.ERROR, "here.py", line_number, "socket %d", (number,), info)
    return record.getMessage() if limit.filter(record) else None


def test_similar_log_messages_are_rate_limited() -> None:
    now = [0.0]
    limit = RateLimit(lambda: now[0])
    logged = [text for number in range(1000) if (text := line(limit, number))]
    assert len(logged) == LINES_PER_WINDOW
    assert "omitted" in logged[-1]
    assert line(limit, 1, line_number=2) == "socket 1"
    assert line(limit, 1, error=OSError()) == "socket 1"
    now[0] = WINDOW_S
    assert line(limit, 1000) == f"socket 1000 [{1000 - LINES_PER_WINDOW} similar messages were omitted]"


# Connections are parsed in turn; a WebSocket that sends more than a page is slowed and then closed.


class Sender:
    """A connection with ``pieces`` to parse, each of which takes ``busy_s``."""

    def __init__(self, name: str, pieces: int, parsed: list[str], clock: list[float], busy_s: float = 0.0) -> None:
        self.name, self.left, self.parsed, self.clock, self.busy_s = name, pieces, parsed, clock, busy_s
        self.ended = False

    def parse_piece(self) -> float | None:
        self.parsed.append(self.name)
        self.clock[0] += self.busy_s
        self.left -= 1
        return 0.0 if self.left else None

    def end(self) -> None:
        self.ended = True


def run_with_clock(work: Any) -> list[float]:
    """Run ``work(clock)`` on an event loop whose time includes ``clock[0]``."""
    clock = [0.0]

    async def run() -> None:
        loop = asyncio.get_running_loop()
        real_time = loop.time
        loop.time = lambda: real_time() + clock[0]  # type: ignore[method-assign]
        made: Coroutine[Any, Any, None] = work(clock)
        await made

    asyncio.run(run())
    return clock


def test_a_flood_does_not_delay_a_single_request() -> None:
    parsed: list[str] = []

    async def work(clock: list[float]) -> None:
        reading = ReadScheduler()
        flood, request = Sender("flood", 1000, parsed, clock, 0.001), Sender("stop", 1, parsed, clock)
        reading.add(flood)
        reading.add(request)
        for _ in range(2000):
            await asyncio.sleep(0)

    run_with_clock(work)
    assert parsed.count("flood") == 1000
    assert parsed.index("stop") <= 4  # after one round of the flood, not after all of it


def test_fifty_floods_leave_time_in_each_round_of_the_event_loop() -> None:
    parsed: list[str] = []
    rounds: list[int] = []

    async def work(clock: list[float]) -> None:
        reading = ReadScheduler()
        for number in range(50):
            reading.add(Sender(str(number), 20, parsed, clock, 0.001))
        while len(parsed) < 1000:
            before = len(parsed)
            await asyncio.sleep(0)
            rounds.append(len(parsed) - before)

    run_with_clock(work)
    assert max(rounds) <= 4  # 2 ms per round, 1 ms per piece
    # Every connection is parsed once before any is parsed twice, except the first, which starts alone.
    assert set(parsed[:53]) == {str(number) for number in range(50)}


def test_a_connection_with_unparsable_bytes_is_closed_and_others_continue() -> None:
    parsed: list[str] = []
    broken: list[Sender] = []

    async def work(clock: list[float]) -> None:
        reading = ReadScheduler()
        sender = Sender("broken", 5, parsed, clock)

        def fail() -> float | None:
            raise ValueError("no frame")

        sender.parse_piece = fail  # type: ignore[method-assign]
        broken.append(sender)
        reading.add(sender)
        reading.add(Sender("good", 3, parsed, clock))
        for _ in range(20):
            await asyncio.sleep(0)

    run_with_clock(work)
    assert broken[0].ended
    assert parsed == ["good"] * 3


@pytest.mark.parametrize("frames_per_s", [1.0, 20.0, 60.0])
def test_the_websocket_budget_never_slows_a_page(frames_per_s: float) -> None:
    """Ten minutes of pings, of references from a slider, and of the 3D view."""
    budget = Budget(0.0)
    count = round(600.0 * frames_per_s)
    assert all(budget.spend(slot / frames_per_s, 1, 120) == 0.0 for slot in range(count))
    assert not budget.is_overdrawn(600.0)


@pytest.mark.parametrize(("frames", "size"), [(256, 512), (1, 65536)])
def test_a_flood_of_frames_is_slowed_and_then_closed(frames: int, size: int) -> None:
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


def test_the_budget_recovers_after_a_burst() -> None:
    budget = Budget(0.0)
    assert budget.spend(0.0, int(FRAMES_AT_ONCE) + 100, 0) == pytest.approx(1.0)
    assert budget.spend(10.0, 1, 0) == 0.0
    assert not budget.is_overdrawn(100.0)


def test_the_rate_of_new_websockets_is_limited_per_session() -> None:
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


# Every wait has a timeout: for the first byte, the head, the body, and for the client to read the response.

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
    """Shorten the timeouts for tests that expect one."""
    monkeypatch.setattr(connections, "SILENCE_S", SHORT_S)
    for name in ("HEAD_S", "BODY_S", "REST_S"):
        monkeypatch.setattr(connections, name, SHORT_S)


@pytest.mark.usefixtures("short_waits")
@pytest.mark.parametrize(
    "sent_bytes",
    [
        b"",
        b"GET /thing HTTP/1.1\r\nHo",
        b"POST /thing HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: 10\r\n" + HOST + b"\r\n{",
    ],
    ids=["a word", "a head", "a body"],
)
def test_incomplete_requests_time_out(address: tuple[str, int], sent_bytes: bytes) -> None:
    with connected(address, sent_bytes) as slow:
        assert everything_from(slow) == b""


def test_the_body_timeout_of_a_report_is_proportional_to_its_size_limit(
    address: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert connections.body_s(SHEETS) / connections.body_s("/thing") == body_limit(SHEETS) / MAX_BODY_BYTES > 1.0
    # The limit is so large that the timeout does not expire in this test.
    monkeypatch.setattr(connections, "body_limit", lambda path: MAX_BODY_BYTES * (10_000 if path == SHEETS else 1))
    monkeypatch.setattr(connections, "BODY_S", SHORT_S)
    head = b" HTTP/1.1\r\nContent-Type: application/json\r\nContent-Length: 8\r\nConnection: close\r\n" + HOST + b"\r\n"
    with connected(address, b"POST " + SHEETS.encode() + head + b'{"a"') as sheet:
        with connected(address, b"POST /thing" + head + b'{"a"') as other:
            assert everything_from(other) == b""
        sheet.sendall(b": 1}")
        assert everything_from(sheet).endswith(b'"printed"')


@pytest.mark.usefixtures("short_waits")
def test_slowly_sent_headers_do_not_extend_the_timeout(address: tuple[str, int]) -> None:
    with connected(address, b"GET /thing HTTP/1.1\r\n" + HOST) as slow:
        assert seconds_until_refused(slow, b"X: y\r\n", SHORT_S / 10) < 60.0


@pytest.mark.usefixtures("short_waits")
def test_an_unread_body_times_out(address: tuple[str, int]) -> None:
    with connected(address, b"POST /thing HTTP/1.1\r\nContent-Length: 300000000\r\n" + HOST + b"\r\n") as pushing:
        assert seconds_until_refused(pushing, b"x" * 1000, SHORT_S / 10) < 60.0


def test_an_unread_response_is_aborted(address: tuple[str, int], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "STALL_S", SHORT_S)
    with connected(address, b"GET /large HTTP/1.1\r\n" + HOST + b"\r\n") as slow_reader:
        while count_connections(address) > 1:
            time.sleep(SHORT_S)
        assert len(everything_from(slow_reader)) < LARGE


def count_connections(address: tuple[str, int]) -> int:
    """Return the number of anonymous connections, including this one."""
    return int(httpx.get(f"http://localhost:{address[1]}/guests", timeout=PATIENCE_S).text)


def test_a_connection_stays_open_for_the_next_request(
    address: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(connections, "HEAD_S", SHORT_S)
    monkeypatch.setattr(connections, "ANONYMOUS_PAUSE_S", 60)
    with connected(address) as client:
        for _ in range(3):
            client.sendall(b"GET /thing HTTP/1.1\r\n" + HOST + b"\r\n")
            answer = b""
            while not answer.endswith(b'"here"'):
                piece = client.recv(4096)
                assert piece, "closed"
                answer += piece
            time.sleep(1.5 * SHORT_S)
        assert not is_closed(client)


@pytest.mark.parametrize("nonsense", [b"\x16\x03\x01\r\n\r\n", b"GET / HTTP/9\r\n\r\n", b"\x00" * 100 + b"\r\n\r\n"])
def test_responses_to_invalid_http_have_the_security_headers(address: tuple[str, int], nonsense: bytes) -> None:
    with connected(address, nonsense) as client:
        answer = everything_from(client)
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert b"content-security-policy: default-src" in answer.lower()
    assert b"x-content-type-options: nosniff" in answer.lower()


def test_invalid_bytes_after_a_request_end_the_connection(address: tuple[str, int]) -> None:
    with connected(address, b"GET /large HTTP/1.1\r\n" + HOST + b"\r\n\x00\x00\r\n\r\n") as client:
        assert everything_from(client).startswith(b"HTTP/1.1 200 ")


def test_a_request_head_that_is_too_long_is_rejected(address: tuple[str, int]) -> None:
    lines = b"X: y\r\n" * (2 * security.LONGEST_HEAD // 6)
    with connected(address, b"GET /thing HTTP/1.1\r\n" + HOST + lines + b"\r\n") as client:
        assert everything_from(client).startswith(b"HTTP/1.1 431 ")


def test_a_long_body_is_received_completely(address: tuple[str, int]) -> None:
    body = b'{"a": 1' + b" " * 5 * security.LONGEST_HEAD + b"}"
    answer = httpx.post(
        f"http://localhost:{address[1]}/thing", content=body, headers={"Content-Type": "application/json"}
    )
    assert answer.text == '"changed"'


def test_a_request_with_an_invalid_body_gets_one_response(
    address: tuple[str, int], caplog: pytest.LogCaptureFixture
) -> None:
    head = b"POST /thing HTTP/1.1\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n" + HOST + b"\r\n"
    with connected(address, head + b"3\r\nabc\r\n\r\n") as client:
        answer = everything_from(client)
    assert answer.count(b"HTTP/1.1 ") == 1
    assert answer.startswith(b"HTTP/1.1 400 ")
    assert count_connections(address) == 1  # the service answers this request after the invalid one
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


def test_closed_connections_take_no_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connections, "HANDOVERS_PER_ROUND", 1)
    passed: list[int] = []

    class Pending:
        def __init__(self, number: int, *, is_closed: bool) -> None:
            self.number, self.is_closed = number, is_closed

        def pass_on(self) -> None:
            passed.append(self.number)

    async def pass_on_all() -> list[list[int]]:
        with socket.create_server(("127.0.0.1", 0)) as listening:
            limiter = ConnectionLimiter(ConnectionBudget(anonymous=4, known=60))
            acceptor = ConnectionAcceptor(listening, limiter, lambda _slot: asyncio.Protocol(), 1000)
            for number in range(100):
                pending: Any = Pending(number, is_closed=number < 98)
                acceptor.pass_on(pending, is_stop=False)
            rounds = []
            for _ in range(3):
                await asyncio.sleep(0)
                rounds.append(list(passed))
            acceptor.close()
            return rounds

    assert asyncio.run(pass_on_all()) == [[98], [98, 99], [98, 99]]
