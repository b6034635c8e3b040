"""What goes to the vendor's server, and what a client is given for it."""

import struct

import pytest

from backend.foxglove.bridge import MessageSlots, OtherVersionError, Publisher
from backend.services.live_stream import build_layout


def frame(content: bytes) -> bytes:
    return struct.pack("<BIQ", 1, 7, 123) + content


def test_a_ticket_is_turned_into_its_message_and_nothing_else_is() -> None:
    tickets = MessageSlots(count=3)
    given = [tickets.ticket_for(words) for words in (b"one", b"two", b"three", b"four")]
    assert [tickets.redeem(frame(ticket)) for ticket in given] == [None, *map(frame, (b"two", b"three", b"four"))]
    assert tickets.redeem(frame(struct.pack("<Q", 9))) is None  # none was ever given
    assert tickets.redeem(frame(b"{}")) is None
    assert tickets.redeem(b"\x02rest") == b"\x02rest"  # of another kind, as the time


def test_a_service_of_another_version_is_refused() -> None:
    publisher = Publisher("test", MessageSlots())
    try:
        told = build_layout()
        publisher.publish(told.model_dump_json())
        with pytest.raises(OtherVersionError, match="use one version of both"):
            publisher.publish(told.model_copy(update={"fields": told.fields[1:]}).model_dump_json())
        with pytest.raises(OtherVersionError):
            publisher.publish(told.model_copy(update={"period_s": 0.002}).model_dump_json())
    finally:
        publisher.close()
