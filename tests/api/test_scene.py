"""The 3D view through the proxy of the running service."""

import asyncio

import httpx
import pytest
import viser
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Subprotocol

from tests.e2e.service import Service

PROTOCOL = Subprotocol(f"viser-v{viser.__version__}")


def test_the_page_comes_with_its_own_policy(operator: httpx.Client) -> None:
    page = operator.get("/scene/")
    assert page.status_code == 200
    assert "wasm-unsafe-eval" in page.headers["content-security-policy"]
    assert "frame-ancestors 'self'" in page.headers["content-security-policy"]
    assert "/scene/?darkMode" in operator.get("/scene?darkMode").headers["location"]


@pytest.mark.parametrize("path", ["/scene", "/scene/", "/replay", "/replay/"])
def test_messages_of_the_scene_arrive_in_its_own_protocol(service: Service, operator: httpx.Client, path: str) -> None:
    async def session() -> None:
        headers = {"Authorization": operator.headers["Authorization"], "Origin": service.url}
        address = service.url.replace("http", "ws") + path
        async with connect(address, additional_headers=headers, subprotocols=[PROTOCOL], max_size=None) as socket:
            assert socket.subprotocol == PROTOCOL
            first = await asyncio.wait_for(socket.recv(), 20.0)
            assert isinstance(first, bytes)
            assert len(first) > 10_000

    asyncio.run(session())


def test_without_signing_in_there_is_no_scene(service: Service) -> None:
    async def session() -> int:
        with pytest.raises(InvalidStatus) as error:
            async with connect(service.url.replace("http", "ws") + "/scene", subprotocols=[PROTOCOL]):
                pass
        return int(error.value.response.status_code)

    assert httpx.get(service.url + "/scene/").status_code == 401
    assert asyncio.run(session()) in (401, 403)
