"""The service behind a reverse proxy: hosts, origins, prefix, client and cookie."""

import asyncio
import html
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, Request, Response, WebSocket
from starlette.datastructures import Headers
from starlette.requests import HTTPConnection

from backend.public_url import PublicUrl, parse_networks, parse_public_url
from backend.server import deployment, security
from backend.server.security import HostOriginMiddleware
from tests.api.serving import served
from tests.api.sockets import connected, everything_from

PROXY, STRANGER, BROWSER = "127.0.0.1", "10.0.0.7", "192.0.2.44"
SECURE = parse_public_url("https://rig.lab/sinew/")
PLAIN = parse_public_url("http://rig.lab:8080")

app = FastAPI()


@app.api_route("/api/thing", methods=["GET", "POST"])
async def thing(request: Request) -> dict[str, Any]:
    return {"path": request.url.path, "client": request.client and request.client.host}


@app.websocket("/api/live")
async def live(websocket: WebSocket) -> None:
    await websocket.accept()


def send_request(
    public: PublicUrl | None,
    method: str = "GET",
    path: str = "/api/thing",
    peer: str = PROXY,
    allowed: tuple[str, ...] = (),
    **headers: str,
) -> httpx.Response:
    """Return the response to a request; header names have _ instead of -."""

    async def exchange() -> httpx.Response:
        transport = httpx.ASGITransport(HostOriginMiddleware(app, allowed, public), client=(peer, 4711))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000") as client:
            named = {name.replace("_", "-"): value for name, value in headers.items()}
            return await client.request(method, path, headers=named)

    return asyncio.run(exchange())


def code(answer: httpx.Response) -> str:
    return "" if answer.status_code == 200 else str(answer.json()["error"]["code"])


@pytest.mark.parametrize(
    ("host", "refused"),
    [
        ("rig.lab", ""),
        ("rig.lab:443", ""),
        ("RIG.LAB", ""),
        ("127.0.0.1:8000", ""),
        ("[::1]:8000", ""),
        ("localhost", ""),
        ("evil.example", "unknown_host"),
        ("rig.lab.evil.example", "unknown_host"),
        ("10.1.2.3", "unknown_host"),
        ("", "unknown_host"),
    ],
)
def test_only_the_public_host_and_loopback_are_accepted(host: str, refused: str) -> None:
    assert code(send_request(SECURE, host=host)) == refused


def test_allowed_hosts_stay_accepted_with_a_public_url() -> None:
    assert code(send_request(SECURE, host="bench.lab", allowed=("bench.lab",))) == ""
    own = send_request(SECURE, "POST", host="bench.lab:8000", origin="http://bench.lab:8000", allowed=("bench.lab",))
    assert code(own) == ""


@pytest.mark.parametrize(
    ("host", "origin", "refused"),
    [
        ("rig.lab", "https://rig.lab", ""),
        ("127.0.0.1:8000", "https://rig.lab", ""),  # a proxy that rewrites Host
        ("127.0.0.1:8000", "http://127.0.0.1:8000", ""),  # without the proxy, at this machine
        ("rig.lab", "http://rig.lab", "foreign_origin"),
        ("rig.lab", "https://rig.lab:8443", "foreign_origin"),
        ("rig.lab", "https://other.lab", "foreign_origin"),
        ("127.0.0.1:8000", "https://other.lab", "foreign_origin"),
        ("127.0.0.1:8000", "http://localhost:8000", "foreign_origin"),
        ("rig.lab", "null", "foreign_origin"),
    ],
)
def test_only_the_public_origin_and_loopback_are_accepted(host: str, origin: str, refused: str) -> None:
    assert code(send_request(SECURE, "POST", host=host, origin=origin)) == refused


def test_a_cross_site_fetch_is_rejected_even_from_the_public_origin() -> None:
    answer = send_request(SECURE, "POST", host="rig.lab", origin="https://rig.lab", sec_fetch_site="cross-site")
    assert code(answer) == "foreign_origin"


def test_a_proxy_that_rewrites_the_host_gets_a_remedy_without_a_public_url(
    caplog: pytest.LogCaptureFixture,
) -> None:
    answer = send_request(None, "POST", host="127.0.0.1:8000", origin="http://rig.lab:8080")
    assert (answer.status_code, code(answer)) == (403, "foreign_origin")
    expected = deployment.foreign_origin("http://rig.lab:8080", "127.0.0.1:8000", None)
    assert (expected.code, expected.values["proxy"]) == ("page_of_unknown_proxy", "http://rig.lab:8080")
    error = answer.json()["error"]
    assert (error["message_code"], error["message"]) == (expected.code, expected)
    assert expected in caplog.text


@pytest.mark.parametrize("path", ["/api/thing", "/sinew/api/thing"])
def test_paths_are_accepted_with_and_without_the_prefix(path: str) -> None:
    assert send_request(SECURE, path=path, host="rig.lab").json()["path"] == "/api/thing"


@pytest.mark.parametrize("path", ["/sinewy/api/thing", "/other/api/thing", "/sinew/sinew/api/thing"])
def test_paths_with_another_prefix_are_not_found(path: str) -> None:
    assert send_request(SECURE, path=path, host="rig.lab").status_code == 404


@pytest.mark.parametrize(
    ("public", "peer", "forwarded", "client"),
    [
        (SECURE, PROXY, BROWSER, BROWSER),
        (SECURE, "::ffff:127.0.0.1", BROWSER, BROWSER),
        (SECURE, PROXY, f"10.9.9.9, {BROWSER}", BROWSER),  # addresses that the browser sent are ignored
        (SECURE, PROXY, f"{BROWSER}, 127.0.0.2", BROWSER),
        (SECURE, PROXY, "nonsense", PROXY),
        (SECURE, STRANGER, BROWSER, STRANGER),
        (None, PROXY, BROWSER, PROXY),
        (replace(SECURE, proxies=parse_networks(["10.0.0.0/24"])), STRANGER, BROWSER, BROWSER),
        (replace(SECURE, proxies=parse_networks(["10.0.0.0/24"])), PROXY, BROWSER, PROXY),
    ],
)
def test_the_client_address_is_taken_only_from_a_trusted_proxy(
    public: PublicUrl | None, peer: str, forwarded: str, client: str
) -> None:
    assert send_request(public, peer=peer, x_forwarded_for=forwarded).json()["client"] == client


def test_proxy_headers_do_not_make_a_host_or_origin_known() -> None:
    evil = "evil.example"
    host = send_request(
        SECURE, host=evil, x_forwarded_host="rig.lab", x_forwarded_proto="https", forwarded="host=rig.lab"
    )
    assert code(host) == "unknown_host"
    origin = send_request(
        SECURE, "POST", host="rig.lab", origin=f"https://{evil}", x_forwarded_host=evil, forwarded=f"host={evil}"
    )
    assert code(origin) == "foreign_origin"


class FakeAuthentication:
    """An authentication that always issues a cookie."""

    def make_cookie(self, _person: object) -> str:
        return "value"

    def sign_out(self, _shown: object) -> None:
        """Do nothing."""


def cookie_lines(public: PublicUrl | None, headers: dict[str, str], path: str = "/", peer: str = PROXY) -> list[str]:
    """Return the Set-Cookie lines of a sign-in and of a sign-out."""
    lines: list[str] = []

    async def route(scope: Any, receive: Any, send: Any) -> None:
        for granted in (True, False):
            response, connection = Response(), HTTPConnection(scope)
            given: Any = FakeAuthentication()
            if granted:
                security.set_session_cookie(given, connection, response, given)
            else:
                security.end_session(given, connection, response)
            lines.extend(response.headers.getlist("set-cookie"))
        await Response()(scope, receive, send)

    async def exchange() -> None:
        transport = httpx.ASGITransport(HostOriginMiddleware(route, (), public), client=(peer, 1))
        async with httpx.AsyncClient(transport=transport, base_url="http://127.0.0.1:8000") as client:
            (await client.get(path, headers=headers)).raise_for_status()

    asyncio.run(exchange())
    return lines


def attributes(line: str) -> set[str]:
    return {part.strip().lower() for part in line.split(";")[1:]} - {""}


@pytest.mark.parametrize(
    ("public", "headers", "path", "secure", "cookie_path"),
    [
        (None, {"host": "127.0.0.1:8000"}, "/", False, "/"),
        (None, {"host": "127.0.0.1:8000", "x-forwarded-proto": "https"}, "/", False, "/"),
        (PLAIN, {"host": "rig.lab:8080"}, "/", False, "/"),
        (SECURE, {"host": "rig.lab"}, "/", True, "/sinew/"),
        (SECURE, {"host": "127.0.0.1:8000"}, "/sinew/", True, "/sinew/"),
        (SECURE, {"host": "127.0.0.1:8000", "x-forwarded-for": BROWSER}, "/", True, "/sinew/"),
        (SECURE, {"host": "127.0.0.1:8000"}, "/", True, "/"),
    ],
)
def test_the_cookie_has_the_path_and_scheme_of_the_public_url(
    public: PublicUrl | None, headers: dict[str, str], path: str, secure: bool, cookie_path: str
) -> None:
    granted, *forgotten = cookie_lines(public, headers, path)
    assert attributes(granted) >= {"httponly", "samesite=strict", f"path={cookie_path}"}
    assert ("secure" in attributes(granted)) is secure
    paths = {part for line in forgotten for part in attributes(line) if part.startswith("path=")}
    assert paths == {"path=/", f"path={cookie_path}"}
    assert all("max-age=0" in attributes(line) for line in forgotten)


def test_a_websocket_without_upgrade_header_is_rejected_and_logged(caplog: pytest.LogCaptureFixture) -> None:
    answer = send_request(None, path="/api/live", host="localhost", sec_websocket_key="x", origin="http://localhost")
    assert (answer.status_code, code(answer)) == (426, "upgrade_required")
    expected = deployment.upgrade_lost("/api/live", "http://localhost")
    assert (expected.code, expected.values["origin"]) == ("upgrade_missing", "http://localhost")
    assert answer.json()["error"]["message_code"] == expected.code
    assert expected in caplog.text


def test_browsers_get_a_rejection_as_an_html_page() -> None:
    answer = send_request(None, host="evil.example", accept="text/html,application/xhtml+xml")
    assert answer.status_code == 400
    assert answer.headers["content-type"].startswith("text/html")
    expected = deployment.unknown_host("evil.example", None)
    assert expected.values["host"] == "evil.example"
    assert html.escape(expected) in answer.text
    nasty = send_request(None, host="a<script>", accept="text/html")
    assert "<script>" not in nasty.text


@pytest.mark.parametrize(
    ("page", "public", "peer", "headers", "found"),
    [
        ("http://127.0.0.1:8000/", None, PROXY, {}, []),
        ("http://rig.lab:8080/index.html", None, PROXY, {}, []),
        ("https://rig.lab/", None, PROXY, {}, ["no_public_url"]),
        ("http://rig.lab/sinew/", None, PROXY, {}, ["no_public_url"]),
        ("https://rig.lab/sinew/", SECURE, PROXY, {"X-Forwarded-For": BROWSER}, []),
        ("http://127.0.0.1:8000/", SECURE, PROXY, {}, []),
        ("https://rig.lab/", SECURE, PROXY, {}, ["other_prefix"]),
        ("https://rig.lab/sinew2/", SECURE, PROXY, {}, ["other_prefix"]),
        ("https://rig.lab/sinew/", SECURE, STRANGER, {"X-Forwarded-For": BROWSER}, ["untrusted_proxy"]),
        ("https://rig.lab/sinew/", SECURE, STRANGER, {}, []),
        ("nonsense", SECURE, PROXY, {}, []),
    ],
)
def test_deployment_problems_of_a_page_are_found(
    page: str, public: PublicUrl | None, peer: str, headers: dict[str, str], found: list[str]
) -> None:
    problems = deployment.find_deployment_problems(page, public, Headers(headers), peer)
    assert [problem.code for problem in problems] == found
    for problem in problems:
        assert ("--public-url" in problem.message) != ("--trusted-proxy" in problem.message)


COOKIES = "; ".join(f"other{number}={'x' * 3000}" for number in range(7))
"""Cookies of other applications on the same host."""


@pytest.fixture(scope="module")
def address() -> Iterator[tuple[str, int]]:
    with served(HostOriginMiddleware(app)) as answering:
        yield answering


def head(path: str, *lines: str, upgrade: bool) -> bytes:
    head_lines = [f"GET {path} HTTP/1.1", "Host: localhost", *lines]
    if upgrade:
        key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ=="
        head_lines += ["Connection: Upgrade", "Upgrade: websocket", key, "Sec-WebSocket-Version: 13"]
    else:
        head_lines += ["Connection: close"]
    return "\r\n".join([*head_lines, "", ""]).encode()


def status_of(address: tuple[str, int], words: bytes) -> int:
    with connected(address, words) as client:
        first = client.recv(65536) if b"Upgrade: websocket" in words else everything_from(client)
    assert first.startswith(b"HTTP/1.1 "), first
    return int(first.split()[1])


@pytest.mark.parametrize(
    ("lines", "plain", "upgraded"),
    [
        ([f"Cookie: {COOKIES}"], 200, 101),
        ([f"Cookie: a={'x' * 31_000}"], 200, 101),
        ([f"Cookie: a={'x' * 33_000}"], 431, 431),
        ([f"Cookie: a={'x' * 90_000}"], 431, 431),
        ([f"X-{number}: y" for number in range(90)], 200, 101),
        ([f"X-{number}: y" for number in range(101)], 431, 431),
        ([f"X-{number}: y" for number in range(200)], 431, 431),
    ],
    ids=["7 cookies of 3 kB", "31 kB", "33 kB", "90 kB", "90 lines", "101 lines", "200 lines"],
)
def test_requests_and_websockets_have_the_same_head_limits(
    address: tuple[str, int], lines: list[str], plain: int, upgraded: int
) -> None:
    assert status_of(address, head("/api/thing", *lines, upgrade=False)) == plain
    assert status_of(address, head("/api/live", *lines, upgrade=True)) == upgraded


def test_a_rejected_websocket_logs_only_its_origin(address: tuple[str, int], caplog: pytest.LogCaptureFixture) -> None:
    refused = head("/api/live", "Origin: https://rig.lab", upgrade=True)
    with connected(address, refused) as client:
        assert everything_from(client).startswith(b"HTTP/1.1 403 ")
    (record,) = [record for record in caplog.records if record.levelname in ("WARNING", "ERROR")]
    expected = deployment.foreign_origin("https://rig.lab", "localhost", None)
    assert (expected.code, expected.values["proxy"]) == ("page_of_unknown_proxy", "https://rig.lab")
    assert expected in record.getMessage()
