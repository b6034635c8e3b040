"""The live stream on a ring buffer that the test fills: the messages to each client, independent of the others."""

import asyncio
import logging
from typing import cast

import numpy as np
import pytest
from fastapi import WebSocket, WebSocketDisconnect

from backend import wire
from backend.api.dependencies import serve_live_stream
from backend.realtime.ring_buffer import Ring
from backend.sample import FIELDS, INDEX
from backend.schemas.state import EventMessage, MarkKind, StateMessage
from backend.services.live_stream import QUEUE_FRAMES, LiveStream, StreamClient


def fill(ring: Ring, count: int) -> None:
    row = np.zeros(len(FIELDS))
    for _ in range(count):
        row[INDEX["tick"]] = ring.count
        row[INDEX["q"]] = ring.count / 1000.0
        ring.append(row)


class RecordingClient:
    """A websocket of the test: stores its messages, may stop reading."""

    def __init__(self) -> None:
        self.texts: list[str] = []
        self.frames: list[wire.Frame] = []
        self.reads = asyncio.Event()
        self.reads.set()
        self.gone = asyncio.Event()

    async def send_text(self, text: str) -> None:
        self.texts.append(text)

    async def send_bytes(self, frame: bytes) -> None:
        await self.reads.wait()
        self.frames.append(wire.unpack_frame(frame))

    async def receive_text(self) -> str:
        await self.gone.wait()
        raise RuntimeError("closed")

    @property
    def ticks(self) -> list[int]:
        return [tick for f in self.frames for tick in range(f.first_tick, f.first_tick + f.columns.shape[1])]


class InvalidClient(RecordingClient):
    """Sends an invalid message, and disconnects before the answer."""

    async def receive_text(self) -> str:
        return "ping?"

    async def close(self, _code: int, _reason: str) -> None:
        raise WebSocketDisconnect(1006)


class SilentClient(RecordingClient):
    """A page that pings once and then is silent."""

    closed = False
    pinged = False

    async def receive_text(self) -> str:
        if self.pinged:
            return await super().receive_text()
        self.pinged = True
        return '{"type": "ping", "id": 1}'

    async def close(self, _code: int, _reason: str) -> None:
        self.closed = True


class SlowClient(RecordingClient):
    """Sends invalid messages and reads late: a close waits for it, and after a close begins nothing is sent."""

    closing = closed = False

    def __init__(self) -> None:
        super().__init__()
        self.speaks = asyncio.Event()

    async def receive_text(self) -> str:
        await self.speaks.wait()
        return "ping?"

    async def send_bytes(self, frame: bytes) -> None:
        if self.closing:
            raise RuntimeError("a close message has been sent")
        self.frames.append(wire.unpack_frame(frame))

    async def close(self, code: int, _reason: str) -> None:
        self.closing = True
        await self.reads.wait()
        self.closed = code == 1008


def stream_on(ring: Ring) -> LiveStream:
    return LiveStream(lambda: ring, lambda: StateMessage.model_construct(type="state"))


async def served(stream: LiveStream, watcher: RecordingClient) -> None:
    await serve_live_stream(stream, cast(WebSocket, watcher))


async def settle() -> None:
    for _ in range(20):
        await asyncio.sleep(0)


def test_history_is_sent_first_and_each_tick_once() -> None:
    async def session() -> None:
        ring = Ring.create(65536)
        fill(ring, 40_000)
        stream, watcher = stream_on(ring), RecordingClient()
        serving = asyncio.create_task(served(stream, watcher))
        await settle()
        fill(ring, 100)
        stream.step(0.0)
        fill(ring, 50)
        stream.step(0.1)
        await settle()
        assert watcher.ticks == list(range(10_000, 40_150))
        assert '"type":"layout"' in watcher.texts[0]
        assert '"type":"state"' in watcher.texts[1]
        watcher.gone.set()
        await serving

    asyncio.run(session())


def test_a_slow_client_gets_the_number_of_missed_samples_and_delays_no_other() -> None:
    async def session() -> None:
        ring = Ring.create(65536)
        stream, slow, quick = stream_on(ring), RecordingClient(), RecordingClient()
        tasks = [asyncio.create_task(served(stream, watcher)) for watcher in (slow, quick)]
        await settle()
        slow.reads.clear()
        for turn in range(QUEUE_FRAMES + 30):
            fill(ring, 10)
            stream.step(float(turn))
            await settle()
        assert quick.ticks == list(range(10 * (QUEUE_FRAMES + 30)))
        slow.reads.set()
        await settle()
        fill(ring, 10)
        stream.step(1e3)
        await settle()
        missed = sum(frame.missed for frame in slow.frames)
        assert missed > 0
        assert len(slow.ticks) + missed == ring.count
        after = next(frame for frame in slow.frames if frame.missed)
        before = slow.frames[slow.frames.index(after) - 1]
        assert after.first_tick == before.first_tick + before.columns.shape[1] + after.missed
        for watcher in (slow, quick):
            watcher.gone.set()
        await asyncio.gather(*tasks)
        assert stream.clients == 0

    asyncio.run(session())


def test_a_silent_page_is_disconnected_and_a_silent_script_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def session() -> None:
        monkeypatch.setattr("backend.api.dependencies.PING_TIMEOUT_S", 0.05)
        stream, page, script = stream_on(Ring.create(1024)), SilentClient(), RecordingClient()
        left, there = (asyncio.create_task(served(stream, watcher)) for watcher in (page, script))
        await asyncio.wait_for(left, 60.0)
        assert page.closed
        assert '"pong"' in page.texts[-1]
        assert not there.done()
        assert stream.clients == 1
        script.gone.set()
        await there

    asyncio.run(session())


def test_a_client_gets_the_newest_state_and_every_mark() -> None:
    async def session() -> None:
        client = StreamClient()
        client.queue_state("old")
        client.queue_state("new")
        for name in ("a", "b"):
            client.queue_text(name)
        assert [await client.next() for _ in range(3)] == ["a", "b", "new"]

    asyncio.run(session())


def test_earlier_marks_are_sent_to_later_clients() -> None:
    async def session() -> None:
        ring = Ring.create(1024)
        stream, watcher = stream_on(ring), RecordingClient()
        stream.publish_mark(EventMessage(tick=7, kind=MarkKind.NOTE, text="before"))
        serving = asyncio.create_task(served(stream, watcher))
        await settle()
        assert any('"before"' in text for text in watcher.texts)
        watcher.gone.set()
        await serving

    asyncio.run(session())


def test_an_invalid_message_before_a_disconnect_causes_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    asyncio.run(served(stream_on(Ring.create(1024)), InvalidClient()))
    assert [record.message for record in caplog.records if record.levelno >= logging.WARNING] == []


def test_a_slow_client_with_an_invalid_message_gets_the_close() -> None:
    async def session() -> None:
        ring = Ring.create(1024)
        stream, slow = stream_on(ring), SlowClient()
        serving = asyncio.create_task(served(stream, slow))
        await settle()
        slow.reads.clear()
        slow.speaks.set()
        await settle()
        fill(ring, 10)
        stream.step(0.0)
        await settle()
        slow.reads.set()
        await serving
        assert slow.closed

    asyncio.run(session())


def test_a_new_loop_starts_a_new_time_axis() -> None:
    async def session() -> None:
        rings = [Ring.create(1024), Ring.create(1024)]
        stream = LiveStream(lambda: rings[-1] if restarted else rings[0], lambda: StateMessage.model_construct())
        watcher = RecordingClient()
        serving = asyncio.create_task(served(stream, watcher))
        fill(rings[0], 30)
        stream.step(0.0)
        await settle()
        restarted.append(True)
        fill(rings[1], 5)
        stream.step(1.0)
        await settle()
        assert watcher.ticks == [*range(30), *range(5)]
        assert sum('"type":"layout"' in text for text in watcher.texts) == 2
        watcher.gone.set()
        await serving

    restarted: list[bool] = []
    asyncio.run(session())
