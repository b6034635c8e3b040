"""The live stream of the running service, decoded as by a client."""

import asyncio
import json
from itertools import pairwise
from typing import Any

import httpx
import numpy as np
import pytest
from websockets.asyncio.client import ClientConnection
from websockets.exceptions import InvalidStatus

from backend import wire
from backend.sample import STORED_NAMES
from tests.api.conftest import PATIENCE_S
from tests.api.patient import connect
from tests.e2e.service import Service

MESSAGES = 400


def address(service: Service) -> str:
    return service.url.replace("http", "ws") + "/api/live"


def bearer(operator: httpx.Client) -> dict[str, str]:
    return {"Authorization": operator.headers["Authorization"]}


async def receive(socket: ClientConnection) -> dict[str, Any] | wire.Frame:
    message = await asyncio.wait_for(socket.recv(), PATIENCE_S)
    return wire.unpack_frame(message) if isinstance(message, bytes) else json.loads(message)


def test_the_stream_sends_layout_state_and_samples_without_gaps(service: Service, running: httpx.Client) -> None:
    async def session() -> None:
        async with connect(address(service), additional_headers=bearer(running)) as socket:
            layout = await receive(socket)
            assert isinstance(layout, dict)
            assert layout["type"] == "layout"
            assert tuple(field["name"] for field in layout["fields"]) == STORED_NAMES
            state = await receive(socket)
            assert isinstance(state, dict)
            assert state["type"] == "state"
            frames: list[wire.Frame] = []
            texts = [state]
            while len(frames) < 60:
                message = await receive(socket)
                if isinstance(message, dict):
                    texts.append(message)
                else:
                    frames.append(message)
            for before, after in pairwise(frames):
                assert after.first_tick == before.first_tick + before.columns.shape[1] + after.missed
            mode = frames[-1].columns[STORED_NAMES.index("mode")]
            assert layout["modes"][int(mode[-1])] == "run", running.get("/api/state").json()["fault"]
            assert np.isfinite(frames[-1].columns[STORED_NAMES.index("q")]).all()
            assert sum(text["type"] == "state" for text in texts) >= 2
            assert any(text["type"] == "event" and text["kind"] == "mode" for text in texts)
            assert sum(frame.columns.shape[1] for frame in frames) > 1000

    asyncio.run(session())


def test_the_stream_sends_marks_of_commands_and_answers_pings(service: Service, running: httpx.Client) -> None:
    async def session() -> None:
        async with connect(address(service), additional_headers=bearer(running)) as socket:
            await socket.send('{"type":"ping","id":42}')
            body = {"q_ref": 0.123, "S_ref": 10.0}
            await asyncio.to_thread(running.put, "/api/references", json=body)
            wanted = {"pong": False, "mark": False, "state": False}
            for _ in range(MESSAGES):
                message = await receive(socket)
                if isinstance(message, dict):
                    wanted["pong"] |= message == {"type": "pong", "id": 42}
                    wanted["mark"] |= message.get("kind") == "references" and "0.123" in message["text"]
                    wanted["state"] |= message.get("references") == {**body, "in_force": True}
                if all(wanted.values()):
                    return
            raise AssertionError(f"not seen: {[name for name, seen in wanted.items() if not seen]}")

    asyncio.run(session())


@pytest.mark.parametrize("path", ["/api/live", "/scene", "/scene/"])
def test_anonymous_clients_and_foreign_origins_get_no_stream(
    service: Service, operator: httpx.Client, path: str
) -> None:
    async def refused(headers: dict[str, str]) -> int:
        with pytest.raises(InvalidStatus) as error:
            async with connect(service.url.replace("http", "ws") + path, additional_headers=headers):
                pass
        return int(error.value.response.status_code)

    assert asyncio.run(refused({})) in (401, 403)
    assert asyncio.run(refused({"Origin": "http://evil.example", **bearer(operator)})) == 403


def test_a_message_other_than_a_ping_closes_the_websocket(service: Service, operator: httpx.Client) -> None:
    async def session() -> None:
        async with connect(address(service), additional_headers=bearer(operator)) as socket:
            await socket.send('{"type":"command","id":1}')
            for _ in range(MESSAGES):
                if socket.close_code is not None:
                    break
                try:
                    await asyncio.wait_for(socket.recv(), PATIENCE_S)
                except Exception:
                    break
            assert socket.close_code == 1008

    asyncio.run(session())
