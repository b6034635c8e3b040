"""A result that came while the event loop stood still counts, on every version of Python."""

import asyncio
import socket
import time

import pytest

from backend.realtime.supervisor import wait_for_result


def test_an_answer_that_lies_in_the_socket_counts_after_a_stall_longer_than_the_timeout() -> None:
    ours, theirs = socket.socketpair()
    ours.setblocking(False)

    async def session() -> bytes:
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[bytes] = loop.create_future()
        loop.add_reader(ours, lambda: answer.set_result(ours.recv(10)))
        waiting = asyncio.create_task(wait_for_result(answer, 0.05))
        await asyncio.sleep(0)
        theirs.send(b"answer")
        time.sleep(0.2)  # the service stands still
        try:
            return await waiting
        finally:
            loop.remove_reader(ours)

    with ours, theirs:
        assert asyncio.run(session()) == b"answer"


def test_without_an_answer_it_is_a_timeout() -> None:
    async def session() -> None:
        await wait_for_result(asyncio.get_running_loop().create_future(), 0.01)

    with pytest.raises(TimeoutError):
        asyncio.run(session())
