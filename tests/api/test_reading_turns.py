"""What connections send is parsed in turn, and a websocket that sends more than a page does is slowed and closed."""

import asyncio
from collections.abc import Coroutine
from typing import Any

import pytest

from backend.server.connections import (
    BYTES_AT_ONCE,
    BYTES_PER_S,
    FRAMES_AT_ONCE,
    FRAMES_PER_S,
    LONGEST_WAIT_S,
    READ_TIMEOUT_S,
    SOCKETS_AT_ONCE,
    SOCKETS_PER_S,
    Budget,
    ReadScheduler,
    WebsocketThrottle,
)


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
