"""What is sent arrives as it was; what is malformed is refused with its number and the reason."""

import dataclasses
import json
import math
from typing import Any, get_args

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.loop import commands
from backend.loop.channel import (
    MAX_BYTES,
    Channel,
    ChannelClosedError,
    ChannelError,
    Failed,
    Ready,
    Setup,
    channel_pair,
    decode_from_loop,
    decode_to_loop,
    encode,
)
from backend.loop.commands import Accepted, RunProgram, SetMode, Shutdown
from backend.loop.mode import Mode
from backend.loop.program import Law, Program, Segment

COMMANDS = st.one_of([st.from_type(one) for one in (Setup, *get_args(commands.Command))])
EVENTS = st.one_of([st.from_type(one) for one in (Ready, Failed, *get_args(commands.Event))])
SEQUENCES = st.integers(0, 2**53)


def is_finite(value: Any) -> bool:
    if isinstance(value, dict):
        return all(is_finite(part) for part in value.values())
    if isinstance(value, list | tuple):
        return all(is_finite(part) for part in value)
    return not isinstance(value, float) or math.isfinite(value)


@given(message=COMMANDS, sequence=SEQUENCES)
@settings(max_examples=200, deadline=None)
def test_commands_arrive_as_they_were_or_are_refused(message: Any, sequence: int) -> None:
    if is_finite(dataclasses.asdict(message)):
        assert decode_to_loop(encode(message, sequence)) == (sequence, message)
    else:
        with pytest.raises(ChannelError, match="valid number"):
            decode_to_loop(encode(message, sequence))


@given(message=EVENTS, sequence=SEQUENCES)
@settings(max_examples=200, deadline=None)
def test_events_arrive_as_they_were(message: Any, sequence: int) -> None:
    if is_finite(dataclasses.asdict(message)):
        assert decode_from_loop(encode(message, sequence)) == (sequence, message)


def packet(**changes: Any) -> bytes:
    return json.dumps(
        {"kind": "SetReferences", "sequence": 7, "body": {"q_ref": 0.1, "S_ref": 10.0}} | changes
    ).encode()


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (packet(body={"q_ref": 0.1}), "S_ref: Field required"),
        (packet(body={"q_ref": 0.1, "S_ref": 10.0, "s_ref": 9.0}), "s_ref: Unexpected"),
        (packet(body={"q_ref": "0.1", "S_ref": 10.0}), "q_ref: Input should be a valid number"),
        (packet(body={"q_ref": True, "S_ref": 10.0}), "q_ref: Input should be a valid number"),
        (packet(body={"q_ref": float("nan"), "S_ref": 10.0}), "q_ref: Input should be a finite number"),
        (packet(body={"q_ref": 0.1, "S_ref": float("inf")}), "S_ref: Input should be a finite number"),
        (packet(extra=1), "extra: Extra inputs"),
        (packet(kind="Accepted"), "does not match"),
        (packet(kind="SetMode", body={"mode": "warp"}), "mode: Input should be 'off'"),
    ],
)
def test_malformed_commands_are_refused_by_number(bad: bytes, reason: str) -> None:
    with pytest.raises(ChannelError, match=reason) as refusal:
        decode_to_loop(bad)
    assert refusal.value.sequence == 7


def test_noise_is_refused_without_a_number() -> None:
    with pytest.raises(ChannelError) as refusal:
        decode_to_loop(b"\xff\x00noise")
    assert refusal.value.sequence == 0


@pytest.fixture
def ends() -> Any:
    ours, theirs = channel_pair()
    other = Channel(theirs)
    yield ours, other
    ours.close()
    other.close()


def test_packets_keep_order_and_borders_until_the_end(ends: tuple[Channel, Channel]) -> None:
    ours, theirs = ends
    assert theirs.receive() is None
    for sequence in range(50):
        assert ours.send(encode(SetMode(Mode.RUN, run=sequence), sequence))
    ours.close()
    for sequence in range(50):
        received = theirs.receive()
        assert received is not None
        assert decode_to_loop(received) == (sequence, SetMode(Mode.RUN, run=sequence))
    with pytest.raises(ChannelClosedError):
        theirs.receive()
    with pytest.raises(ChannelClosedError):
        theirs.send(encode(Shutdown()))


def test_sender_never_waits_for_a_reader_that_does_not_read(ends: tuple[Channel, Channel]) -> None:
    ours, theirs = ends
    sent = 0
    while ours.send(encode(Accepted(sent, 0), sent)):
        sent += 1
    for sequence in range(sent):
        received = theirs.receive()
        assert received is not None
        assert decode_from_loop(received)[0] == sequence
    assert ours.send(encode(Shutdown()))


def test_longest_program_fits_and_a_longer_one_is_refused(ends: tuple[Channel, Channel]) -> None:
    ours, theirs = ends
    segment = Segment(duration_s=0.123456789, q_ref=-1.0471975511965976, S_ref=12.345678901234567)
    one = RunProgram(Program(Law.CASCADE, (segment,)))
    per_segment = len(encode(dataclasses.replace(one, program=Program(Law.CASCADE, (segment, segment))))) - len(
        encode(one)
    )
    fitting = RunProgram(Program(Law.CASCADE, (segment,) * (MAX_BYTES // per_segment - 2)))
    assert ours.send(encode(fitting, 1))
    received = theirs.receive()
    assert received is not None
    assert decode_to_loop(received) == (1, fitting)
    longer = RunProgram(Program(Law.CASCADE, (segment,) * (MAX_BYTES // per_segment + 1)))
    with pytest.raises(ChannelError, match="fewer segments"):
        encode(longer, 2)
