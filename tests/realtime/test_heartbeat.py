"""The heartbeat continues while the GIL is held, and ends with its event loop."""

import select
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from backend.realtime import heartbeat
from backend.realtime.channel import Channel, channel_pair
from backend.realtime.commands import Heartbeat
from backend.realtime.heartbeat import HEARTBEAT_S, HeartbeatSender
from backend.realtime.ipc import decode_to_loop

pytestmark = pytest.mark.live


@pytest.fixture
def ends() -> Iterator[tuple[Channel, Channel]]:
    service, loop = channel_pair()
    heartbeat.compile_heartbeat()
    other = Channel(loop)
    yield service, other
    service.close()
    other.close()


def beats(channel: Channel) -> int:
    count = 0
    while (packet := channel.receive()) is not None:
        assert decode_to_loop(packet) == (0, Heartbeat())
        count += 1
    return count


@contextmanager
def beating(heart: HeartbeatSender) -> Iterator[HeartbeatSender]:
    thread = threading.Thread(target=heart.run)
    thread.start()
    yield heart
    heart.stop()
    thread.join()


def wait_for_a_beat(channel: Channel) -> None:
    assert select.select([channel], [], [], 20.0)[0]
    assert beats(channel) >= 1


def test_the_heartbeat_continues_while_the_gil_is_held(ends: tuple[Channel, Channel]) -> None:
    service, loop = ends
    with beating(HeartbeatSender(service)):
        wait_for_a_beat(loop)
        before = sys.getswitchinterval()
        sys.setswitchinterval(60.0)  # from here on nothing but waiting gives the lock away
        try:
            end = time.monotonic() + 20 * HEARTBEAT_S
            while time.monotonic() < end:
                pass
            assert beats(loop) >= 2
        finally:
            sys.setswitchinterval(before)


def test_the_heartbeat_is_not_faster_than_its_period(ends: tuple[Channel, Channel]) -> None:
    """It sleeps at least one period between heartbeats: a busy machine makes fewer of them, never more."""
    service, loop = ends
    begun = time.monotonic()
    with beating(HeartbeatSender(service)):
        wait_for_a_beat(loop)
        time.sleep(10 * HEARTBEAT_S)
        count, passed_s = beats(loop), time.monotonic() - begun
    assert 1 <= count <= passed_s / HEARTBEAT_S


def test_the_time_of_the_last_heartbeat_is_recent(ends: tuple[Channel, Channel]) -> None:
    """Heartbeats at all parts of a second: the time includes the whole seconds, not only the fraction."""
    service, loop = ends
    with beating(HeartbeatSender(service)) as heart:
        for _ in range(5):
            begun = time.monotonic()
            beats(loop)
            wait_for_a_beat(loop)
            assert 0.0 <= heart.age_s <= HEARTBEAT_S + time.monotonic() - begun
            time.sleep(0.17)


def test_the_heartbeat_ends_and_pauses_on_command(ends: tuple[Channel, Channel]) -> None:
    service, loop = ends
    with beating(HeartbeatSender(service)) as heart:
        wait_for_a_beat(loop)
        heart.pause(3600.0)
        while heart.age_s < 4 * HEARTBEAT_S:
            time.sleep(HEARTBEAT_S)
        beats(loop)
        assert not select.select([loop], [], [], 4 * HEARTBEAT_S)[0]


def test_the_heartbeat_stops_when_the_event_loop_hangs(
    ends: tuple[Channel, Channel], monkeypatch: pytest.MonkeyPatch
) -> None:
    service, loop = ends
    hours_ago = time.monotonic_ns() - 3600 * 10**9
    with monkeypatch.context() as past:
        past.setattr(time, "monotonic_ns", lambda: hours_ago)
        heart = HeartbeatSender(service)
    with beating(heart):
        assert not select.select([loop], [], [], 4 * HEARTBEAT_S)[0]
        heart.refresh()
        wait_for_a_beat(loop)
