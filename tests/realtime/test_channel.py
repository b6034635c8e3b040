"""Messages arrive unchanged; malformed messages are rejected with their number and the reason."""

import dataclasses
import json
import math
from typing import Any, get_args

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from backend.errors import OutOfRangeError
from backend.faults import Fault
from backend.realtime import commands, messages
from backend.realtime.channel import MAX_BYTES, Channel, ChannelClosedError, channel_pair
from backend.realtime.commands import Accepted, RunProgram, SetMode, Shutdown
from backend.realtime.ipc import (
    ChannelError,
    Failed,
    LongProgram,
    ProgramPart,
    ProgramParts,
    Ready,
    Setup,
    decode_from_loop,
    decode_to_loop,
    encode,
    packets,
)
from backend.realtime.modes import Cause, CommandRejectedError, HomingEnd, Mode
from backend.realtime.program import (
    MAX_SEGMENTS,
    MAX_TUNINGS,
    MAX_WALLS,
    EntryGains,
    Excitation,
    Law,
    MotorGains,
    Program,
    Segment,
    SetTuning,
    Shape,
)
from plant.dynamics import Obstacle
from plant.manual_input import ManualInput
from tests.refusals import refused

# As they are sent: a tuning is a packet of its own.
st.register_type_strategy(Program, st.builds(Program, tunings=st.just(())))
st.register_type_strategy(ProgramPart, st.builds(ProgramPart, tunings=st.tuples(st.from_type(SetTuning))))
COMMANDS = st.one_of([st.from_type(one) for one in (Setup, ProgramPart, *get_args(commands.Command))])
EVENTS = st.one_of([st.from_type(one) for one in (Ready, Failed, *get_args(commands.Event))])
SEQUENCES = st.integers(0, 2**53)


def is_finite(value: Any) -> bool:
    if isinstance(value, dict):
        return all(is_finite(part) for part in value.values())
    if isinstance(value, list | tuple):
        return all(is_finite(part) for part in value)
    return not isinstance(value, float) or math.isfinite(value)


@given(message=COMMANDS, sequence=SEQUENCES)
@example(message=commands.SimulateManualInput(ManualInput(F_limit=math.inf)), sequence=0)
@settings(max_examples=200, deadline=None)
def test_commands_are_decoded_unchanged_or_rejected(message: Any, sequence: int) -> None:
    parts = dataclasses.asdict(message)
    try:
        packet = encode(message, sequence)
    except ChannelError:
        assert len(json.dumps(parts, ensure_ascii=False, default=str).encode()) > MAX_BYTES // 2
        return
    if is_finite(parts):
        assert decode_to_loop(packet) == (sequence, message)
    else:
        with pytest.raises(ChannelError, match="finite number"):
            decode_to_loop(packet)


@given(message=EVENTS, sequence=SEQUENCES)
@settings(max_examples=200, deadline=None)
def test_events_are_decoded_unchanged(message: Any, sequence: int) -> None:
    if is_finite(dataclasses.asdict(message)):
        assert decode_from_loop(encode(message, sequence)) == (sequence, message)


@pytest.mark.parametrize("cause", [*Cause, *HomingEnd, *Fault])
def test_the_type_of_a_cause_survives_the_channel(cause: Cause | HomingEnd | Fault) -> None:
    """Not a member of another enum, nor a string: decisions depend on the type."""
    _, changed = decode_from_loop(encode(commands.ModeChanged(1, Mode.RUN, Mode.OFF, cause)))
    assert isinstance(changed, commands.ModeChanged)
    assert changed.cause is cause


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
def test_malformed_commands_are_rejected_with_their_number(bad: bytes, reason: str) -> None:
    with pytest.raises(ChannelError, match=reason) as refusal:
        decode_to_loop(bad)
    assert (refusal.value.sequence, refusal.value.message.code) == (7, "packet_not_valid")


def test_random_bytes_are_rejected_without_a_number() -> None:
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


def test_packets_keep_their_order_and_boundaries(ends: tuple[Channel, Channel]) -> None:
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


def test_the_sender_never_waits_for_a_blocked_reader(ends: tuple[Channel, Channel]) -> None:
    ours, theirs = ends
    sent = 0
    while ours.send(encode(Accepted(sent, 0), sent)):
        sent += 1
    for sequence in range(sent):
        received = theirs.receive()
        assert received is not None
        assert decode_from_loop(received)[0] == sequence
    assert ours.send(encode(Shutdown()))


def test_packets_never_exceed_the_limit_of_a_control_step(ends: tuple[Channel, Channel]) -> None:
    ours, theirs = ends
    segment = Segment(
        -1.0471975511965976e-100,
        -1.0471975511965976,
        12.345678901234567,
        -29.123456789012345,
        Shape.MULTISINE,
        load_A=-1.0471975511965976e-100,
        load_B=-1.0471975511965976e-100,
        period_s=-1.0471975511965976e-100,
        period_end_s=-1.0471975511965976e-100,
        count=1000,
        peak=-1.0471975511965976e-100,
        tuning=50,
        wall=50,
    )
    gains = EntryGains(*(-1.0471975511965976e-100 for _ in range(7)))
    motor = MotorGains(*(-1.0471975511965976e-100 for _ in range(4)))
    tuning = SetTuning(0.5, 0.5, motor, motor, (gains,) * 40, interpolate=False)
    walls = (Obstacle(-1.0, *(-1.0471975511965976e-100 for _ in range(3))),) * MAX_WALLS
    program = Program(Law.CASCADE, (segment,) * MAX_SEGMENTS, tunings=(tuning,) * MAX_TUNINGS, walls=walls)
    longest = RunProgram(program, 7)
    sent = packets(longest, 3)
    assert max(map(len, sent)) <= MAX_BYTES
    parts = ProgramParts()
    for packet in sent:
        assert ours.send(packet), "the road takes no more"
        received = theirs.receive()
        assert received is not None
        sequence, message = decode_to_loop(received)
        assert sequence == 3
        if isinstance(message, LongProgram):
            break
        assert isinstance(message, ProgramPart)
        parts.add(sequence, message)
    assert isinstance(message, LongProgram)
    assert parts.whole(3, message) == longest


def test_a_program_with_a_missing_packet_is_rejected() -> None:
    segment = Segment(duration_s=0.1, q_ref=0.0, S_ref=10.0)
    sent = packets(RunProgram(Program(Law.CASCADE, (segment,) * 30)), 2)
    parts = ProgramParts()
    _, first = decode_to_loop(sent[0])
    _, rest = decode_to_loop(sent[-1])
    assert isinstance(first, ProgramPart)
    assert isinstance(rest, LongProgram)
    parts.add(2, first)
    with refused(CommandRejectedError, "program_parts_missing", parts="segments", arrived=24, expected=30):
        parts.whole(2, rest)


def test_a_surplus_packet_of_a_program_is_rejected() -> None:
    segment = Segment(duration_s=0.1, q_ref=0.0, S_ref=10.0)
    *parts_sent, last = packets(RunProgram(Program(Law.CASCADE, (segment,) * MAX_SEGMENTS)), 2)
    parts, (_, rest) = ProgramParts(), decode_to_loop(last)
    arrived = 0
    for packet in (*parts_sent, parts_sent[0]):
        _, part = decode_to_loop(packet)
        assert isinstance(part, ProgramPart)
        parts.add(2, part)
        arrived += len(part.segments)
    assert isinstance(rest, LongProgram)
    with refused(
        CommandRejectedError, "program_parts_missing", parts="segments", arrived=arrived, expected=MAX_SEGMENTS
    ):
        parts.whole(2, rest)


def test_oversized_programs_and_packets_are_rejected_with_their_number() -> None:
    segment = Segment(duration_s=0.1, q_ref=0.0, S_ref=10.0)
    with pytest.raises(OutOfRangeError) as caught:
        packets(RunProgram(Program(Law.CASCADE, (segment,) * (MAX_SEGMENTS + 1))), 2)
    error = caught.value
    assert (error.label, error.value, error.maximum) == (messages.number_of_segments(), 1001, 1000)
    excitation = Excitation(amplitude_rad=0.1, chip_s=0.01, levels="+" * MAX_BYTES, periods=1)
    with refused(ChannelError, "packet_too_long", message_type="RunProgram", maximum_bytes=MAX_BYTES):
        packets(RunProgram(Program(Law.FORCE_HOLD, excitation=excitation)), 2)
