"""Subscribers are called in order and by event type, even if one raises."""

from dataclasses import dataclass

import pytest

from backend.event_bus import EventBus, StateChanged


@dataclass(frozen=True)
class Counted:
    number: int


def test_subscribers_receive_events_of_their_type_in_order() -> None:
    bus, seen = EventBus(), []  # type: EventBus, list[tuple[str, int]]
    bus.subscribe(Counted, lambda counted: seen.append(("first", counted.number)))
    bus.subscribe(Counted, lambda counted: seen.append(("second", counted.number)))
    bus.subscribe(StateChanged, lambda _: seen.append(("state", 0)))
    bus.publish(Counted(1))
    bus.publish(StateChanged())
    bus.publish("nobody subscribes to texts")
    assert seen == [("first", 1), ("second", 1), ("state", 0)]


def test_a_failing_subscriber_does_not_block_others() -> None:
    bus, seen = EventBus(), []  # type: EventBus, list[int]

    def fail(counted: Counted) -> None:
        raise ValueError(f"{counted.number} is too many")

    bus.subscribe(Counted, fail)
    bus.subscribe(Counted, lambda counted: seen.append(counted.number))
    with pytest.raises(ValueError, match="7 is"):
        bus.publish(Counted(7))
    assert seen == [7]
