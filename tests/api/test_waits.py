"""Every wait of a connection ends: for a word, a head, a body, the rest of one, for its answer to be read."""

import time
from collections.abc import Iterator

import httpx
import pytest
from fastapi import FastAPI, Request
from starlette.responses import Response

from backend.server import connections, security
from backend.server.connections import ConnectionLimiter
from backend.server.security import MAX_BODY_BYTES, SHEETS, HostOriginMiddleware, body_limit
from tests.api.conftest import PATIENCE_S
from tests.api.serving import served
from tests.api.sockets import connected, everything_from, is_closed, many, seconds_until_refused

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


def test_who_has_just_spoken_is_not_sent_away_by_a_crowd(address: tuple[str, int]) -> None:
    for _ in range(20):
        said = b"GET /thing HTTP/1.1\r\nConnection: close\r\n" + HOST + b"\r\n"
        with connected(address, said) as guest, many(address, 150):
            assert everything_from(guest).endswith(b'"here"')
