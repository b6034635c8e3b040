"""Invalid data on the websockets: live stream and scenes ignore it or close, and serve all other connections."""

import asyncio
import random
from contextlib import suppress

import pytest
import viser
from websockets.asyncio.client import ClientConnection, connect
from websockets.exceptions import ConnectionClosed
from websockets.typing import Subprotocol

from tests.fuzz import junk
from tests.fuzz.conftest import EXAMPLES, SEED
from tests.fuzz.target import Role, Target
from tests.fuzz.test_raw_http import STATUS, exchange

MESSAGES = 50 * EXAMPLES
IN_A_ROW = 10
ANSWERED_WITHIN_S = 30.0
VISER = Subprotocol(f"viser-v{viser.__version__}")
SUBPROTOCOLS = {"/api/live": None, "/scene": [VISER], "/replay": [VISER]}


@pytest.mark.parametrize("role", ["operator", "viewer"])
@pytest.mark.parametrize("path", SUBPROTOCOLS)
def test_random_messages_cause_no_abnormal_closure(target: Target, path: str, role: Role) -> None:
    dice = random.Random(f"{SEED}{path}{role}")

    async def one_connection(messages: list[str | bytes]) -> None:
        async with connect(
            target.service.url.replace("http", "ws") + path,
            additional_headers=target.authorization(role) | {"Origin": target.service.url},
            subprotocols=SUBPROTOCOLS[path],
            max_size=None,
            open_timeout=60.0,
        ) as socket:
            receiving = asyncio.create_task(receive_all(socket))
            with suppress(ConnectionClosed):
                for message in messages:
                    await socket.send(message)
                    target.answers[f"message to {path}", 0] += 1
            await socket.close()
            await receiving
            assert socket.close_code not in (1006, 1011), (socket.close_code, messages)
            target.answers[f"connection to {path}", socket.close_code or 0] += 1

    async def all_of_them() -> None:
        for _ in range(MESSAGES // IN_A_ROW):
            await one_connection([junk.message(dice) for _ in range(IN_A_ROW)])

    asyncio.run(all_of_them())


async def receive_all(socket: ClientConnection) -> None:
    """Receive until the connection closes; without reading, the close would not be noticed."""
    with suppress(ConnectionClosed):
        async for _ in socket:
            pass


@pytest.mark.parametrize("path", SUBPROTOCOLS)
def test_random_handshakes_cause_no_server_error(target: Target, path: str) -> None:
    dice = random.Random(f"{SEED}{path}")
    host = target.service.url.removeprefix("http://")
    for _ in range(max(1, EXAMPLES // 2)):
        sent = [junk.handshake(dice, path, host, target.authorization("viewer")) for _ in range(IN_A_ROW)]
        for request, answer in zip(sent, exchange(target, sent), strict=True):
            found = STATUS.search(answer)
            status = int(found[1]) if found else 0
            target.answers[f"handshake to {path}", status] += 1
            assert status < 500, (request, answer[:2000])


@pytest.mark.parametrize("path", SUBPROTOCOLS)
def test_random_frames_cause_no_server_error(target: Target, path: str) -> None:
    dice = random.Random(f"{SEED}{path}")
    host = target.service.url.removeprefix("http://")
    offered = {"Sec-WebSocket-Protocol": VISER} if SUBPROTOCOLS[path] else {}
    opening = junk.upgrade(path, host, target.authorization("viewer") | offered)
    for _ in range(max(1, EXAMPLES // 2)):
        frames = [b"".join(junk.frame(dice) for _ in range(dice.randint(1, 5))) for _ in range(IN_A_ROW)]
        for sent, answer in zip(
            frames, exchange(target, [opening + frame for frame in frames], ANSWERED_WITHIN_S), strict=True
        ):
            assert answer.startswith(b"HTTP/1.1 101 "), (sent, answer[:2000])
            target.answers[f"frames to {path}", 101] += 1
