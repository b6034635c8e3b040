"""Checks of host, origin and body size, and the security headers of responses."""

import asyncio
from collections.abc import AsyncIterator
from typing import Any

import httpx
import pytest
from fastapi import FastAPI, WebSocket

from backend.server.security import MAX_BODY_BYTES, HostOriginMiddleware

app = FastAPI()
guarded = HostOriginMiddleware(app, ["rig.lab"])


@app.api_route("/api/thing", methods=["GET", "POST"])
async def thing() -> str:
    return "here"


@app.websocket("/api/live")
async def live(websocket: WebSocket) -> None:
    await websocket.accept()


def send_request(method: str, headers: dict[str, str] | None = None, content: Any = None) -> httpx.Response:
    async def exchange() -> httpx.Response:
        transport = httpx.ASGITransport(guarded)
        async with httpx.AsyncClient(transport=transport, base_url="http://localhost:8000") as client:
            return await client.request(method, "/api/thing", headers=headers, content=content)

    return asyncio.run(exchange())


async def stream_body() -> AsyncIterator[bytes]:
    yield b"x"


def open_websocket(headers: dict[str, str]) -> dict[str, Any]:
    """Return the first message of the service to a browser that opens a WebSocket."""
    sent: list[dict[str, Any]] = []
    scope = {
        "type": "websocket",
        "path": "/api/live",
        "headers": [(name.encode(), value.encode()) for name, value in headers.items()],
        "query_string": b"",
        "subprotocols": [],
        "extensions": {"websocket.http.response": {}},
    }

    async def receive() -> dict[str, Any]:
        return {"type": "websocket.connect"}

    async def send(message: Any) -> None:
        sent.append(message)

    asyncio.run(guarded(scope, receive, send))
    return sent[0]


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:8000", "[::1]:8000", "10.1.2.3", "rig.lab:80"])
def test_known_hosts_are_accepted(host: str) -> None:
    assert send_request("GET", headers={"host": host}).status_code == 200


@pytest.mark.parametrize("host", ["evil.example", "localhost.evil.example", "[", ""])
def test_unknown_host_names_are_rejected(host: str) -> None:
    answer = send_request("GET", headers={"host": host})
    assert answer.status_code == 400
    assert answer.json()["error"]["code"] == "unknown_host"


@pytest.mark.parametrize("origin", ["http://evil.example", "http://localhost:9000", "null"])
def test_writes_and_websockets_from_other_origins_are_rejected(origin: str) -> None:
    assert send_request("POST", headers={"origin": origin}).status_code == 403
    refused = open_websocket({"origin": origin, "host": "localhost:8000"})
    assert (refused["type"], refused["status"]) == ("websocket.http.response.start", 403)


def test_requests_without_origin_are_judged_by_their_fetch_site() -> None:
    assert send_request("POST", headers={"sec-fetch-site": "cross-site"}).status_code == 403
    assert send_request("POST", headers={"sec-fetch-site": "same-origin"}).status_code == 200


def test_the_own_origin_and_scripts_are_accepted() -> None:
    assert send_request("POST", headers={"origin": "http://localhost:8000"}).status_code == 200
    assert send_request("POST").status_code == 200
    assert open_websocket({"host": "localhost:8000"})["type"] == "websocket.accept"
    assert open_websocket({"host": "a:1", "origin": "http://a:1"})["type"] != "websocket.accept"


def test_large_bodies_and_bodies_of_unknown_length_are_rejected() -> None:
    assert send_request("POST", content=b"x" * (MAX_BODY_BYTES + 1)).status_code == 413
    assert send_request("POST", content=stream_body()).status_code == 411


def test_responses_have_the_content_policy_and_are_not_cached() -> None:
    headers = send_request("GET").headers
    policy = headers["content-security-policy"]
    assert "script-src" not in policy
    assert policy.startswith("default-src 'self';")
    assert "frame-ancestors 'none'" in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cache-control"] == "no-store"
